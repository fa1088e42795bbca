"""The workflow as its users meet it: what is planned after an edit, and that results repeat."""

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import ROOT, SMALL, Project, make_project

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("workflow")]

NEW = '''"""Always the middle of the training positions."""

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin


class Middle(RegressorMixin, BaseEstimator):
    """Always the middle of the training positions."""

    def __init__(self, *, shift_m=0.0):
        self.shift_m = shift_m

    def fit(self, rss_dbm, position_m):
        self.middle_ = np.mean(position_m, axis=0) + self.shift_m
        return self

    def predict(self, rss_dbm):
        return np.tile(self.middle_, (len(rss_dbm), 1))
'''
OUTCOMES = {
    "fingerprint_loo: score all rows",
    "fingerprint_loo: compare all algorithms",
    "fingerprint_loo: judge the paper's claims",
    "fingerprint_loo: draw the figures",
    "fingerprint_loo: write its page",
    "join all claims into one ledger",
    "compare all verdicts with the accepted ones",
    "write down what the numbers came from",
    "fingerprint_loo: write down what the numbers came from",
    "write front page, claims and method",
    "put all algorithms of a task beside each other",
    "set the whole report as a PDF",
    "all is there: reports/index.html",
}


def jobs(row: str) -> set[str]:
    return {f"fingerprint_loo: run {row} on worlds from 00000"}


def is_run(message: str) -> bool:
    return ": run " in message


def test_a_second_call_does_nothing(built: Project) -> None:
    assert "Nothing to be done" in (done := built.snakemake()).stdout + done.stderr


def test_a_new_algorithm_plans_only_its_own_jobs(copy: Project) -> None:
    (copy.folder / "algorithms/fingerprinting/middle.py").write_text(NEW, encoding="utf-8")
    copy.configure(lambda c: c["studies"]["fingerprint_loo"]["algorithms"].update(middle={"shift_m": 0.5}))
    planned = copy.plan()
    assert jobs("middle") <= planned
    assert planned - jobs("middle") <= OUTCOMES


def test_an_edited_algorithm_plans_only_its_rows(copy: Project) -> None:
    copy.edit(
        "algorithms/fingerprinting/rbf_network.py", "class RbfNetwork", "# A new thought.\nclass RbfNetwork"
    )
    assert {message for message in copy.plan() if is_run(message)} == {
        m for m in jobs("rbf_network") if is_run(m)
    }


def test_an_edited_helper_plans_all_rows_that_import_it_and_no_other(copy: Project) -> None:
    copy.edit("positioning/propagation.py", "import numpy as np", "import numpy as np  # noqa")
    assert {message for message in copy.plan() if is_run(message)} == {
        m for m in jobs("bayes_average") if is_run(m)
    }
    copy.edit("positioning/radial_basis.py", "import numpy as np", "import numpy as np  # noqa")
    expected = jobs("bayes_average") | jobs("rbf_network")
    assert {message for message in copy.plan() if is_run(message)} == {m for m in expected if is_run(m)}


def test_a_changed_setting_plans_only_its_row(copy: Project) -> None:
    copy.configure(lambda c: c["studies"]["fingerprint_loo"]["algorithms"].update(knn={"k": 5}))
    assert {message for message in copy.plan() if is_run(message)} == {m for m in jobs("knn") if is_run(m)}


def test_more_worlds_plan_only_the_new_batches(copy: Project) -> None:
    copy.configure(lambda c: c["studies"]["fingerprint_loo"].update(worlds=4))
    runs = {message for message in copy.plan() if is_run(message)}
    assert runs
    assert not any(message.endswith("00000") for message in runs)


def test_edited_figure_code_runs_no_algorithm(copy: Project) -> None:
    copy.edit(
        "positioning/presentation/style.py", "\nfrom collections", "\n# A nicer line.\nfrom collections"
    )
    planned = copy.plan()
    assert "fingerprint_loo: draw the figures" in planned
    assert planned <= OUTCOMES


def test_an_edited_readme_plans_nothing(copy: Project) -> None:
    (copy.folder / "README.md").write_text("# Another title\n", encoding="utf-8")
    assert copy.plan() == set()


def outputs(folder: Path) -> dict[str, str]:
    """Digests of everything that must repeat to the byte: tables, claims and figures; not times."""
    files = [
        *(p for p in (folder / "results/tables").glob("*.csv") if not p.stem.endswith("_times")),
        *(folder / "results/claims").glob("*.csv"),
        folder / "results/claims.csv",
        folder / "results/measures/fingerprint_loo.parquet",
        *(folder / "results/figures").rglob("*.svg"),
        *(folder / "results/figures").rglob("*.pdf"),
    ]
    assert len(files) > 8
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_results_repeat_to_the_byte_whatever_the_cores_and_the_batch(built: Project, tmp_path: Path) -> None:
    other = {**SMALL, "studies": {"fingerprint_loo": {**SMALL["studies"]["fingerprint_loo"], "batch": 1}}}
    project = make_project(tmp_path / "other", other)
    project.snakemake("--cores", "1")
    assert outputs(project.folder) == outputs(built.folder)


def test_one_study_can_be_named_as_a_target(copy: Project) -> None:
    shutil.rmtree(copy.folder / "reports")
    assert "fingerprint_loo: write its page" in copy.plan("fingerprint_loo")


def test_a_row_that_raises_is_named_and_the_others_are_kept(copy: Project) -> None:
    broken = NEW.replace("self.middle_ = ", "raise ZeroDivisionError('no middle')\n        self.middle_ = ")
    (copy.folder / "algorithms/fingerprinting/middle.py").write_text(broken, encoding="utf-8")

    def change(config: dict) -> None:
        config["studies"]["fingerprint_loo"]["algorithms"] |= {
            "middle": {"shift_m": 0.25},
            "nearest_neighbour": {"use": "knn", "k": 1},
        }

    copy.configure(change)
    done = copy.snakemake(check=False)
    said = done.stdout + done.stderr
    assert done.returncode != 0
    for part in ("study fingerprint_loo", "row middle", "shift_m", "0.25", "worlds [0, 1]", "no middle"):
        assert part in said
    assert (copy.folder / "results/estimates/fingerprint_loo/nearest_neighbour/00000.npz").is_file()
    assert not (copy.folder / "results/estimates/fingerprint_loo/middle/00000.npz").exists()
    assert not list((copy.folder / "results").rglob(".tmp-*"))
    (copy.folder / "algorithms/fingerprinting/middle.py").write_text(NEW, encoding="utf-8")
    assert {m for m in copy.plan() if is_run(m)} == {m for m in jobs("middle") if is_run(m)}


def test_a_library_class_by_its_dotted_name_is_a_row(copy: Project) -> None:
    line = {"use": "sklearn.tree.DecisionTreeRegressor", "max_depth": 4, "random_state": 1}
    copy.configure(lambda c: c["studies"]["fingerprint_loo"]["algorithms"].update(tree=line))
    copy.snakemake("results/tables/fingerprint_loo.csv")
    table = pd.read_csv(copy.folder / "results/tables/fingerprint_loo.csv").set_index("algorithm")
    assert 0 < table.loc["tree", "mean_m"] < table.loc["control_centre", "mean_m"]


def test_a_truncated_result_says_what_to_do(copy: Project) -> None:
    estimates = copy.folder / "results/estimates/fingerprint_loo/knn/00000.npz"
    estimates.write_bytes(estimates.read_bytes()[:200])
    done = copy.snakemake("results/tables/fingerprint_loo.csv", check=False)
    assert done.returncode != 0
    assert "knn/00000.npz" in done.stdout + done.stderr
    assert "Delete it" in done.stdout + done.stderr
    estimates.unlink()
    copy.snakemake("results/tables/fingerprint_loo.csv")


def test_wrong_configuration_stops_before_any_job(copy: Project) -> None:
    copy.configure(lambda c: c["studies"]["fingerprint_loo"]["algorithms"].update(wknnn={}))
    done = copy.snakemake("-n", check=False)
    assert done.returncode != 0
    said = done.stdout + done.stderr
    assert "'wknnn'" in said
    assert "did you mean 'wknn'" in said
    assert "Traceback" not in said


def test_the_guide_s_own_commands_add_an_algorithm(built: Project, tmp_path: Path) -> None:
    """Every bash block of docs/add-an-algorithm.md, as it stands, in a copy with few worlds."""
    project = make_project(tmp_path / "guide")
    text = yaml.safe_dump(SMALL, sort_keys=False, default_flow_style=None)
    assert "      wknn: {k: 6}\n" in text
    (project.folder / "config/config.yaml").write_text(text, encoding="utf-8")
    folders = {"data": "data/quick", "results": "results/quick", "reports": "reports/quick"}
    overlay = {"quick": True, "folders": folders}
    (project.folder / "config/quick.yaml").write_text(yaml.safe_dump(overlay), encoding="utf-8")
    guide = (ROOT / "docs/add-an-algorithm.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```bash\n(.*?)^```", guide, flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) == 5
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": str(project.folder)}
    said = [
        subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block],
            cwd=project.folder,
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for block in blocks
    ]
    header, row = said[2].strip().splitlines()[-2:]
    mine = dict(zip(header.split(","), row.split(","), strict=True))
    assert (mine["algorithm"], mine["worlds"]) == ("my_method", "2")
    assert 1 < float(mine["mean_m"]) < 8
    assert said[4].splitlines()[-1].startswith("kernel_ridge,")
    page = (project.folder / "reports/quick/fingerprint_loo.html").read_text(encoding="utf-8")
    assert "my_method" in page
    assert "kernel_ridge" in page


STUDY = '''"""Worlds of a toy study."""

import numpy as np

from positioning.model import Site, Survey, Truth, Worlds


def simulate(settings, rngs):
    position = np.stack([rng.uniform(0, settings["side_m"], (12, 2)) for rng in rngs])
    rss = -30.0 - 2.0 * position
    site = Site(corner_m=np.tile([[0.0, 0.0], [settings["side_m"]] * 2], (len(rngs), 1, 1)))
    survey = Survey(rss_dbm=rss, position_m=position)
    return Worlds({**site.to_arrays(), **survey.to_arrays()}, Truth(position_m=position).to_arrays())
'''
MEASURES = '''"""A measure of the toy study's own."""

import pandas as pd


def measures(estimates, worlds):
    assert len(estimates) == 2 and len(worlds) == 2
    return pd.DataFrame(
        [("square", "wknn", float("nan"), world, "answer", 42.0) for world in range(2)],
        columns=["family", "algorithm", "value", "world", "metric", "x"],
    )
'''
PAPER = """
key: toy
short: A toy
authors: N. N.
title: A toy
settings:
  toy: {side_m: {value: 9.0, unit: m, where: nowhere}}
readings: {}
claims:
  - {id: toy.answer, study: toy, where: nowhere, what: the answer, kind: exact, printed: "42.0", unit: "1",
     quantity: {algorithm: wknn, metric: answer}}
"""


def test_a_study_is_added_by_files_alone(copy: Project) -> None:
    """Nothing in workflow/ is touched: a simulation, a measure, a paper and a config entry."""
    (copy.folder / "positioning/simulation/toy.py").write_text(STUDY, encoding="utf-8")
    studies = copy.folder / "positioning/evaluation/studies"
    studies.mkdir(exist_ok=True)
    (studies / "toy.py").write_text(MEASURES, encoding="utf-8")
    (copy.folder / "data/papers/toy.yaml").write_text(PAPER, encoding="utf-8")
    toy = {"paper": "toy", "worlds": 2, "first_seed": 5, "batch": 2, "families": {"square": {}}}
    toy |= {"algorithms": {"wknn": {"k": 2}, "control_centre": {}}}
    copy.configure(lambda c: c["studies"].update(toy=toy))
    copy.snakemake()
    claims = pd.read_csv(copy.folder / "results/claims.csv").set_index("claim")
    assert claims.loc["toy.answer", "verdict"] == "exact"
    assert (copy.folder / "reports/toy.html").is_file()
    assert list((copy.folder / "results/figures/toy").glob("*.svg"))
