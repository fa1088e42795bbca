"""Join estimates with the truth: raw errors, one row a sample, nothing averaged."""

import os
import shutil
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

import numpy as np

from positioning.files import Tree, read_tree, write_errors
from positioning.joblog import logging_to


def main(tasks: Mapping[str, str], estimates: Sequence[str], truths: Sequence[str], output: str) -> None:
    """Write the folder ``output`` as a whole: ``<row>/<batch>.parquet`` for each file of estimates.

    Parameters
    ----------
    tasks
        Task by row.
    estimates
        Files ``<row>/<batch>.npz``.
    truths
        Files ``<batch>/truth.npz``.
    output
        The folder.
    """
    target = Path(output)
    temporary = target.with_name(f".tmp-{os.getpid()}-{target.name}")
    true = {Path(path).parent.name: read_tree(path) for path in truths}
    temporary.mkdir(parents=True)
    try:
        for path in map(Path, estimates):
            row, batch = path.parent.name, path.stem
            (temporary / row).mkdir(exist_ok=True)
            score_row(tasks[row], path, true[batch], temporary / row / f"{batch}.parquet")
        shutil.rmtree(target, ignore_errors=True)
        temporary.replace(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def score_row(task: str, estimates: Path, truths: Tree, output: Path) -> None:
    """Write ``family, value, world, sample, error_m`` and components of one row on one batch of worlds."""
    score = import_module(f"positioning.tasks.{task}").score
    columns: dict[str, list[np.ndarray]] = {}
    skipped = {}
    for branch, step in read_tree(estimates).items():
        family = branch.rpartition("/")[0]
        if str(step["skipped"]):
            skipped[family] = str(step["skipped"])
            continue
        count = len(step["world"])
        found = {
            name.removeprefix("estimate."): v for name, v in step.items() if name.startswith("estimate.")
        }
        errors = score(found, {name: values[:count] for name, values in truths[family].items()})
        shape = errors["error_m"].shape
        asked = ~np.isnan(errors["error_m"])
        labels = {
            "family": np.full(shape, family),
            "value": np.full(shape, step["value"]),
            "world": np.broadcast_to(step["world"][:, None], shape).astype(np.int32),
            "sample": np.broadcast_to(np.arange(shape[1], dtype=np.int32), shape),
        }
        for name, values in {**labels, **errors}.items():
            columns.setdefault(name, []).append(values[asked])
    empty = {"family": "U1", "value": float, "world": np.int32, "sample": np.int32, "error_m": float}
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    write_errors(output, joined or {name: np.empty(0, dtype) for name, dtype in empty.items()}, skipped)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.tasks,
            snakemake.input.estimates,
            snakemake.input.truths,
            snakemake.output[0],
        )
