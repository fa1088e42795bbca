"""A small project for tests of the workflow: the real code, few worlds, few rows."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[1]
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PARTS = [
    "Snakefile",
    "workflow",
    "profiles",
    "config",
    "algorithms",
    "positioning",
    "data/papers",
    "data/sources.csv",
    "data/algorithms.csv",
]
SMALL: dict[str, Any] = {
    "folders": {"data": "data", "results": "results", "reports": "reports", "realdata": "absent"},
    "studies": {
        "fingerprint_loo": {
            "title": "Small",
            "paper": "robo_sar",
            "worlds": 2,
            "first_seed": 1000,
            "batch": 2,
            "reference": "wknn",
            "families": {"floor": {}},
            "calibrate": [
                {
                    "setting": "noise_db",
                    "between": [0.5, 12],
                    "algorithm": "wknn",
                    "metric": "mean_m",
                    "claim": "table1.wknn.mean",
                    "worlds": 2,
                    "first_seed": 900000,
                }
            ],
            "algorithms": {
                "wknn": {"k": 6},
                "knn": {"k": 4},
                "rbf_network": {"neurons": 5},
                "bayes_average": {"grid_step_m": 1.5},
                "control_centre": {},
            },
            "sweeps": {"knn_k": {"use": "knn", "over": {"k": [1, 4, 8]}, "worlds": 2}},
        }
    },
}


@dataclass(frozen=True)
class Project:
    """A copy of the project in a folder of its own."""

    folder: Path

    def snakemake(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Call snakemake in the copy; the copy's own code is what its jobs import."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "PYTHONDONTWRITEBYTECODE": "1"}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            [sys.executable, "-m", "snakemake", *arguments],
            cwd=self.folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        if check:
            assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-8000:]
        return done

    def plan(self, *targets: str) -> set[str]:
        """Return what a dry run would do: the messages of its jobs."""
        done = self.snakemake("-n", *targets)
        return set(re.findall(r"^Job \d+: (.*)$", done.stdout + done.stderr, flags=re.MULTILINE))

    def configure(self, change: Callable[[dict[str, Any]], None]) -> None:
        """Change the copy's configuration."""
        path = self.folder / "config/config.yaml"
        config = yaml.safe_load(path.read_text(encoding="utf-8"))
        change(config)
        path.write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")

    def edit(self, path: str, before: str, after: str) -> None:
        """Replace text in a file of the copy; it must be there."""
        file = self.folder / path
        text = file.read_text(encoding="utf-8")
        assert before in text, f"{path} holds no {before!r}"
        file.write_text(text.replace(before, after), encoding="utf-8")


def make_project(folder: Path, config: dict[str, Any] = SMALL) -> Project:
    """Copy the project's code into ``folder`` with another configuration."""
    for part in PARTS:
        source, target = ROOT / part, folder / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, target)
    (folder / "README.md").write_text("# A copy\n", encoding="utf-8")
    (folder / "config/config.yaml").write_text(yaml.safe_dump(config, sort_keys=False), encoding="utf-8")
    return Project(folder)


@pytest.fixture(scope="session")
def built(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A small project that was built once; tests take copies of it."""
    project = make_project(tmp_path_factory.mktemp("built") / "a folder with spaces")
    project.snakemake()
    return project


@pytest.fixture
def copy(built: Project, tmp_path: Path) -> Project:
    """A copy of the built project, to be changed at will."""
    shutil.copytree(built.folder, tmp_path / "project", symlinks=True)
    return Project(tmp_path / "project")
