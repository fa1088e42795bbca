"""Write down what the numbers came from: commit, versions, machine, configuration, time by rule."""

import csv
import hashlib
import json
import platform
import subprocess
from collections import defaultdict
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from positioning.files import write_json
from positioning.joblog import logging_to

PACKAGES = ("numpy", "scipy", "scikit-learn", "pandas", "matplotlib", "snakemake", "pyarrow")


def main(
    config: Mapping[str, Any],
    benchmarks: str,
    batches: Mapping[str, Mapping[str, Sequence[str]]],
    study: str | None,
    output: str,
) -> None:
    """Collect and write, for one study or for all; outside a git checkout the commit is unknown."""
    commit = _git("rev-parse", "HEAD") or "unknown"
    seconds: dict[str, float] = defaultdict(float)
    memory: dict[str, float] = defaultdict(float)
    for path in sorted(Path(benchmarks).rglob("*.tsv")):
        rule, *rest = path.relative_to(benchmarks).with_suffix("").parts
        if study is not None and rest[0] != study:
            continue
        if len(rest) == 3 and rest[2] not in batches.get(rest[0], {}).get(rest[1], ()):
            continue  # left behind by a build with other rows or batches
        with path.open(encoding="utf-8", newline="") as lines:
            for line in csv.DictReader(lines, delimiter="\t"):
                seconds[rule] += float(line["s"])
                used = line.get("max_rss", "-")
                memory[rule] = max(memory[rule], 0.0 if used in ("-", "NA") else float(used))
    write_json(
        output,
        {
            "commit": commit,
            "dirty": bool(_git("status", "--porcelain", "--untracked-files=no")),
            "config_digest": hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest(),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in PACKAGES},
            "system": f"{platform.system()} {platform.machine()}",
            "processor": _processor(),
            "seconds_by_rule": {rule: round(value, 1) for rule, value in seconds.items()},
            "peak_memory_mb_by_rule": {rule: round(value) for rule, value in memory.items()},
        },
    )


def _git(*arguments: str) -> str:
    try:
        done = subprocess.run(["git", *arguments], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return done.stdout.strip()


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.config,
            snakemake.params.benchmarks,
            snakemake.params.batches,
            snakemake.wildcards.get("study"),
            snakemake.output[0],
        )
