"""The plan: configuration checked before any job, code found, studies resolved."""

import copy
import subprocess
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from conftest import ROOT, SMALL
from planning import code
from planning.checks import check_schema
from planning.code import code_of, constructor_choices, constructor_parameters, fits, methods
from planning.config import check_limits, resolve
from planning.entries import algorithm_files
from planning.recordings import drop_absent, files_of

from positioning.errors import InputError
from positioning.evaluation.claims import quantities
from positioning.files import read_tree, write_tree
from positioning.simulation.settings import calibrated_settings
from positioning.tasks import NOT_ASKED


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def changed(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    config = copy.deepcopy(SMALL)
    change(config["studies"]["fingerprint_loo"])
    return config


def shipped() -> dict[str, Any]:
    return yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def tracker(study: dict[str, Any], settings: dict[str, Any]) -> None:
    study.update(algorithms={"wknn": {}, "a": {"use": "fingerprint_alone", **settings}})


def aligner(settings: dict[str, Any], sweep: dict[str, Any] | None = None) -> Callable[..., None]:
    def change(study: dict[str, Any]) -> None:
        line = {"use": "aligned_graph_slam"}
        study.update(algorithms={"wknn": {}, "a": {**line, **settings}}, sweeps={})
        if sweep is not None:
            study.update(sweeps={"b": {**line, "over": sweep}})

    return change


WRONG = {
    "number where a part's name is a number of things": (
        aligner({"access_points": {"use": "strongest"}}),
        ["algorithms.a.access_points", "a whole number or null"],
    ),
    "alignment that is no algorithm": (
        aligner({"alignment": "ransac_alignment"}),
        ["algorithms.a.alignment", "Write alignment: {use: ransac_alignment, ...}"],
    ),
    "alignment of another task": (
        aligner({"alignment": {"use": "wknn"}}),
        ["algorithms.a.alignment", "wknn is no alignment algorithm", "ransac_alignment"],
    ),
    "alignment that cannot be a part": (
        aligner({"alignment": {"use": "dead_reckoning", "task": "alignment"}}),
        ["algorithms.a.alignment", "no method placed", "aligned_graph_slam calls", "of ransac_alignment."],
    ),
    "control as a part": (
        aligner({"alignment": {"use": "control_rigid"}}),
        ["algorithms.a.alignment.use", "control_rigid may see the truth"],
    ),
    "setting of a part of the wrong kind": (
        aligner({"alignment": {"use": "ransac_alignment", "hypotheses": 1000.5}}),
        ["algorithms.a.alignment.hypotheses", "1000.5", "a whole number"],
    ),
    "word that is none of the allowed": (
        aligner({"cost": "sqared"}),
        ["algorithms.a.cost", "'sqared'", "did you mean 'squared'", "'squared', 'linear'"],
    ),
    "word that is none of the allowed, or nothing": (
        aligner({"loss": "cauchi"}),
        ["algorithms.a.loss", "did you mean 'cauchy'", "'dcs' or null"],
    ),
    "fraction where a whole number is needed": (
        aligner({"window": 2.5}),
        ["algorithms.a.window", "2.5", "a whole number"],
    ),
    "text where a truth value is needed": (
        aligner({"wifi_edges": "nope"}),
        ["algorithms.a.wifi_edges", "'nope'", "true or false"],
    ),
    "number that YAML reads as text": (
        aligner({"wifi_weight": "1e-4"}),
        ["algorithms.a.wifi_weight", "'1e-4' is text to YAML", "Write 0.0001 or 1.0e-4"],
    ),
    "number in quotes": (aligner({"window": "10"}), ["algorithms.a.window", "Write 10 without quotes"]),
    "swept fraction where a whole number is needed": (
        aligner({}, {"window": [5, 7.5]}),
        ["sweeps.b.over.window", "7.5", "a whole number"],
    ),
    "unknown parameter of a class without a constructor": (
        lambda s: s.update(algorithms={"wknn": {}, "dead_reckoning": {"task": "alignment", "step": 1}}),
        ["algorithms.dead_reckoning.step", "none to choose from"],
    ),
    "unknown key": (lambda s: s.update(wrolds=4), ["studies.fingerprint_loo.wrolds", "unknown", "'worlds'"]),
    "unknown algorithm": (
        lambda s: s["algorithms"].update(wkn={}),
        ["algorithms.wkn", "'wkn'", "mean 'wknn'"],
    ),
    "unknown use": (lambda s: s["algorithms"].update(a={"use": "kn"}), ["algorithms.a", "'kn'", "'knn'"]),
    "unknown parameter": (lambda s: s["algorithms"].update(knn={"kk": 4}), ["algorithms.knn.kk", "'k'"]),
    "unknown swept parameter": (
        lambda s: s["sweeps"]["knn_k"].update(over={"kay": [1]}),
        ["sweeps.knn_k.kay", "parameter of knn"],
    ),
    "unknown protocol": (
        lambda s: s["algorithms"].update(knn={"protocol": "leave_two_out"}),
        ["algorithms.knn.protocol", "'leave_two_out'", "'leave_one_out'"],
    ),
    "unknown task": (
        lambda s: s["algorithms"].update(a={"use": "sklearn.svm.SVR", "task": "fingerprint"}),
        ["algorithms.a.task", "'fingerprint'", "'fingerprinting'"],
    ),
    "no worlds": (lambda s: s.update(worlds=0), ["studies.fingerprint_loo.worlds", "0", "at least 1"]),
    "worlds as text": (lambda s: s.update(worlds="many"), ["fingerprint_loo.worlds", "'many'", "integer"]),
    "control of several tasks alone": (
        lambda s: s.update(algorithms={"control_centre": {}}, reference="control_centre", sweeps={}),
        ["algorithms.control_centre", "fingerprinting, tracking", "task:"],
    ),
    "unknown part": (
        lambda s: s.update(
            algorithms={"wknn": {}, "a": {"use": "trilateration_alone", "ranging": {"use": "path_los"}}}
        ),
        ["algorithms.a.ranging", "'path_los'", "'path_loss'"],
    ),
    "unknown setting of a part": (
        lambda s: s.update(
            algorithms={
                "wknn": {},
                "a": {"use": "trilateration_alone", "ranging": {"use": "path_loss", "nearest": 1}},
            }
        ),
        ["algorithms.a.ranging.nearest", "parameter of path_loss", "nearest_m"],
    ),
    "ranging that is no algorithm": (
        lambda s: s.update(algorithms={"wknn": {}, "pseudo_inverse": {"ranging": "path_loss"}}),
        ["algorithms.pseudo_inverse.ranging", "'path_loss'", "{use:"],
    ),
    "ranging of another task": (
        lambda s: s.update(algorithms={"wknn": {}, "pseudo_inverse": {"ranging": {"use": "least_squares"}}}),
        ["algorithms.pseudo_inverse.ranging", "no ranging algorithm"],
    ),
    "part without use": (
        lambda s: tracker(s, {"fingerprinting": {"columns": 4}}),
        ["algorithms.a.fingerprinting", "use is missing", "{use:"],
    ),
    "part as a bare name": (
        lambda s: tracker(s, {"fingerprinting": "knn"}),
        ["algorithms.a.fingerprinting", "'knn'", "Write fingerprinting: {use: knn, ...}"],
    ),
    "part of another task": (
        lambda s: tracker(s, {"fingerprinting": {"use": "strongest"}}),
        ["algorithms.a.fingerprinting", "strongest is no fingerprinting algorithm", "access_points"],
    ),
    "part of a part of another task": (
        lambda s: tracker(s, {"fingerprinting": {"use": "reduced", "access_points": {"use": "knn"}}}),
        ["a.fingerprinting.access_points", "knn is no access_points", "strongest"],
    ),
    "part whose use is no name": (
        lambda s: tracker(s, {"fingerprinting": {"use": 4}}),
        ["algorithms.a.fingerprinting.use", "4 is no name"],
    ),
    "class that a library does not have": (
        lambda s: s["algorithms"].update(a={"use": "sklearn.ensemble.RandomForestRegresor"}),
        ["algorithms.a.use", "did you mean 'RandomForestRegressor'", "installed"],
    ),
    "module that a library does not have": (
        lambda s: tracker(s, {"fingerprinting": {"use": "sklearn.ensembel.RandomForestRegressor"}}),
        ["algorithms.a.fingerprinting.use", "there is no sklearn.ensembel", "installed"],
    ),
    "library that is not installed": (
        lambda s: s["algorithms"].update(a={"use": "not_installed.part.Regressor"}),
        ["algorithms.a.use", "there is no not_installed", "installed"],
    ),
    "a choice of access points as a row": (
        lambda s: s["algorithms"].update(mine={"use": "strongest", "columns": 4}),
        ["algorithms.mine:", "part of a row", "mine: {use: reduced, access_points: {use: strongest}}"],
    ),
    "a fingerprinting row among trackers": (
        lambda s: s.update(
            algorithms={"riss": {}, "fingerprint_alone": {}, "control_centre": {}, "mine": {"use": "wknn"}}
        ),
        ["algorithms.mine:", "control_centre", "{use: fingerprint_alone, fingerprinting: {use: ...}}"],
    ),
    "fixes and ranging": (
        lambda s: s.update(
            algorithms={
                "wknn": {},
                "pseudo_inverse": {},
                "a": {"use": "particle_filter", "fixes": "pseudo_inverse", "ranging": {"use": "path_loss"}},
            }
        ),
        ["algorithms.a.ranging", "pseudo_inverse", "one of the two"],
    ),
    "fixes of a row that gives none": (
        lambda s: s.update(algorithms={"wknn": {}, "a": {"use": "particle_filter", "fixes": "wknn"}}),
        ["algorithms.a.fixes", "'wknn'", "trilateration row"],
    ),
    "steps of a row that builds on steps itself": (
        lambda s: s.update(
            algorithms={
                "foot_inertial": {},
                "a": {"use": "foot_cascaded_filter", "steps": "foot_inertial"},
                "b": {"use": "foot_cascaded_filter", "steps": "a"},
            }
        ),
        ["algorithms.b.steps", "'a'", "stands alone"],
    ),
    "steps and an inertial filter of its own": (
        lambda s: s.update(
            algorithms={
                "foot_inertial": {},
                "a": {
                    "use": "foot_cascaded_filter",
                    "steps": "foot_inertial",
                    "inertial": {"use": "foot_inertial"},
                },
            }
        ),
        ["algorithms.a.inertial", "foot_inertial", "one of the two"],
    ),
    "steps of a row that hands up none": (
        lambda s: s.update(
            algorithms={
                "fingerprint_alone": {},
                "a": {"use": "foot_cascaded_filter", "steps": "fingerprint_alone"},
            }
        ),
        ["algorithms.a.steps", "fingerprint_alone hands up no steps", "Name a row of foot_inertial"],
    ),
    **{
        f"steps for {use}, which ignores them": (
            lambda s, use=use: s.update(
                algorithms={"foot_inertial": {}, "a": {"use": use, "steps": "foot_inertial"}}
            ),
            ["algorithms.a.steps", f"{use} does not take", "no effect", "Leave it out"],
        )
        for use in ("foot_joint_filter", "foot_inertial", "fingerprint_alone")
    },
    "fixes of a row on fewer worlds": (
        lambda s: s.update(
            algorithms={
                "wknn": {},
                "pseudo_inverse": {"worlds": 1},
                "a": {"use": "particle_filter", "fixes": "pseudo_inverse"},
            }
        ),
        ["algorithms.a.fixes", "pseudo_inverse runs on 1 worlds only", "no more worlds"],
    ),
    "unknown family of a calibration": (
        lambda s: s["calibrate"][0].update(family="flor"),
        ["calibrate[0].family", "'flor'", "'floor'"],
    ),
    "seeds overlap": (
        lambda s: s["calibrate"][0].update(first_seed=1001),
        ["calibrate[0]", "1001 to 1002", "1000 to 1001", "first_seed"],
    ),
    "unknown setting": (lambda s: s.update(world={"grid": 2}), ["world.grid", "'grid_m'"]),
    "unknown family setting": (
        lambda s: s.update(families={"a": {"nois": 1}}),
        ["families.a.nois", "noise_db"],
    ),
    "unknown paper": (lambda s: s.update(paper="robosar"), [".paper", "'robosar'", "robo_sar"]),
    "unknown reference": (lambda s: s.update(reference="svm"), [".reference", "'svm'"]),
    "unknown claim": (lambda s: s["calibrate"][0].update(claim="table1.wknn"), ["claim", "table1.wknn.mean"]),
    "another row's claim": (
        lambda s: s["calibrate"][0].update(algorithm="knn"),
        ["calibrate[0].claim", "table1.wknn.mean", "knn"],
    ),
    "two kinds of worlds": (
        lambda s: s.update(recordings={"a": {"adapter": "x", "source": "y"}}),
        ["fingerprint_loo", "either worlds"],
    ),
    "unknown family of a row": (
        lambda s: s["algorithms"]["knn"].update(families=["floor", "flor"]),
        ["algorithms.knn.families", "'flor'", "'floor'"],
    ),
    "unknown family of a sweep": (
        lambda s: s["sweeps"]["knn_k"].update(families=["roof"]),
        ["knn_k.families", "'roof'", "floor"],
    ),
    "row without a family": (
        lambda s: s["algorithms"]["knn"].update(families=[]),
        ["algorithms.knn.families"],
    ),
    "name taken twice": (lambda s: s["sweeps"].update(knn=s["sweeps"]["knn_k"]), ["sweeps.knn", "Rename"]),
    "missing key": (lambda s: s.pop("batch"), ["fingerprint_loo", "batch", "missing"]),
    "capital name": (lambda s: s["algorithms"].update(KNN={"use": "knn"}), ["algorithms", "KNN"]),
    "truth asked for": (
        lambda s: s["algorithms"].update(control_centre={"site": 1}),
        ["control_centre.site", "parameter of control_centre"],
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_configuration_names_the_thing_the_limit_and_the_cure(case: str) -> None:
    change, parts = WRONG[case]
    with pytest.raises(InputError) as raised:
        resolve(changed(change))
    for part in parts:
        assert part in str(raised.value), f"{part!r} is not in {raised.value}"


def test_a_long_list_of_names_is_of_the_task_and_ends() -> None:
    with pytest.raises(InputError) as raised:
        resolve(changed(lambda s: s["algorithms"].update(a={"use": "qqq"})))
    assert "rbf_network" in str(raised.value)
    assert "riss" not in str(raised.value)
    assert "more" in raised.value.cure
    assert len(raised.value.cure) < 200


def test_names_of_libraries_are_checked_without_importing_them() -> None:
    code = (
        "import sys\n"
        "from planning.code import missing_of_library as missing\n"
        "names = ['sklearn.ensemble.RandomForestRegressor', 'sklearn.gaussian_process.kernels.RBF',"
        " 'sklearn.neural_network.MLPRegressor', 'scipy.spatial.cKDTree', 'math.floor']\n"
        "assert [missing(name) for name in names] == [None] * 5\n"
        "assert missing('sklearn.svm.SRV')[0] == 'sklearn.svm.SRV'\n"
        "assert 'sklearn' not in sys.modules and 'scipy' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT / "workflow", timeout=60)


def test_a_name_is_a_part_only_where_the_row_takes_one() -> None:
    settings = {"access_points": 35, "alignment": {"use": "ransac_alignment", "hypotheses": 500}}
    row = resolve(changed(aligner(settings, {"access_points": [9, 35]})), ROOT)
    found = row["fingerprint_loo"].rows
    assert found["a"].parameters["access_points"] == 35
    assert found["a"].sources == [
        "algorithms/alignment/aligned_graph_slam.py",
        "algorithms/alignment/ransac_alignment.py",
    ]


def test_the_small_configuration_is_right() -> None:
    study = resolve(SMALL)["fingerprint_loo"]
    assert study.batches() == ["00000"]
    assert study.members("00000") == {"worlds": [0, 1], "seeds": [1000, 1001], "families": study.families}
    assert study.families["floor"]["points"] == 257
    assert list(study.rows) == [*study.entries, "knn_k"]


def test_a_row_runs_in_the_families_that_it_names(tmp_path: Path) -> None:
    def two(study: dict[str, Any]) -> None:
        study.update(families={"floor": {}, "open": {}}, calibrate=[])
        study["algorithms"]["control_centre"]["families"] = ["open"]
        study["sweeps"]["knn_k"]["families"] = ["floor"]

    study = resolve(changed(two))["fingerprint_loo"]
    rows = {name: entry.settings() for name, entry in study.rows.items()}
    named = {name: row["families"] for name, row in rows.items() if row["families"]}
    assert named == {"control_centre": ["open"], "knn_k": ["floor"]}
    # The option is no parameter of the algorithm.
    assert "families" not in {**rows["control_centre"]["parameters"], **rows["knn_k"]["parameters"]}

    spec = spec_from_file_location("script_run", ROOT / "workflow/scripts/run.py")
    assert spec is not None
    assert spec.loader is not None
    script = module_from_spec(spec)
    spec.loader.exec_module(script)
    world = {
        "world": np.arange(2),
        "seed": np.arange(2),
        "site.corner_m": np.tile([[0.0, 0], [4, 2]], (2, 1, 1)),
    }
    world |= {"recording.time_s": np.tile(np.arange(3.0), (2, 1))}
    truth = {"world": np.arange(2), "seed": np.arange(2), "truth.position_m": np.zeros((2, 3, 2))}
    sides = {name: str(tmp_path / f"{name}.npz") for name in ("observed", "truth")}
    write_tree(sides["observed"], dict.fromkeys(("floor", "open"), world))
    write_tree(sides["truth"], dict.fromkeys(("floor", "open"), truth))
    row = {**rows["control_centre"], "task": "tracking"}
    for families, reasons in ((["open"], [NOT_ASKED, ""]), ([], ["", ""])):
        output = str(tmp_path / "row.npz")
        script.main("s", {**row, "families": families}, sides["observed"], sides["truth"], {}, output)
        steps = read_tree(output)
        assert list(steps) == ["floor/0", "open/0"]
        assert [str(step["skipped"]) for step in steps.values()] == reasons
        answered = [name for name, step in steps.items() if "estimate.position_m" in step]
        assert answered == [name for name, reason in zip(steps, reasons, strict=True) if not reason]


def test_a_row_whose_steps_were_not_found_is_skipped_with_their_reason(tmp_path: Path) -> None:
    spec = spec_from_file_location("script_run", ROOT / "workflow/scripts/run.py")
    assert spec is not None
    assert spec.loader is not None
    script = module_from_spec(spec)
    spec.loader.exec_module(script)
    world = {"world": np.arange(1), "seed": np.arange(1), "site.corner_m": np.array([[[0.0, 0], [4, 2]]])}
    world |= {"recording.time_s": np.arange(3.0)[None]}
    paths = {name: str(tmp_path / f"{name}.npz") for name in ("observed", "below", "row")}
    write_tree(paths["observed"], {"floor": world})
    write_tree(paths["below"], {"floor/0": {"skipped": np.asarray("it stands still"), "world": np.arange(1)}})
    row = {"name": "a", "use": "foot_cascaded_filter", "task": "tracking", "parameters": {}, "over": None}
    row |= {"options": {"steps": "feet"}, "worlds": None, "families": []}
    script.main("s", row, paths["observed"], None, {"steps": paths["below"]}, paths["row"])
    found = read_tree(paths["row"])["floor/0"]
    assert str(found["skipped"]) == "row feet, whose steps it takes, was skipped: it stands still"


@pytest.mark.parametrize("overlay", [None, "quick.yaml"])
def test_the_shipped_configuration_is_right(overlay: str | None) -> None:
    from snakemake.utils import update_config

    config = shipped()
    if overlay:
        update_config(config, yaml.safe_load((ROOT / "config" / overlay).read_text(encoding="utf-8")))
    assert set(resolve(config)) >= {"fingerprint_loo", "fingerprint_real"}


def test_every_claim_speaks_of_rows_that_are_configured() -> None:
    for study in resolve(shipped()).values():
        paper = yaml.safe_load((ROOT / f"data/papers/{study.paper}.yaml").read_text(encoding="utf-8"))
        ids = [claim["id"] for claim in paper["claims"]]
        assert len(ids) == len(set(ids))
        for claim in paper["claims"]:
            if claim["study"] == study.name:
                named = {q.get("algorithm", q.get("sweep")) for q in quantities(claim)}
                assert named <= set(study.rows) | own_rows(study.name), claim["id"]


def own_rows(study: str) -> set[str]:
    """Rows that are no algorithms: what a study's own measures tell of its worlds."""
    if not (ROOT / f"positioning/evaluation/studies/{study}.py").is_file():
        return set()
    return set(getattr(import_module(f"positioning.evaluation.studies.{study}"), "ROWS", ()))


TABLE_1 = {
    "svm": "3.04 0.10 2.75 3.96 5.12 6.09",
    "wknn": "3.06 0.10 2.84 3.93 5.16 5.79",
    "bayes_average": "3.35 0.11 3.04 4.39 5.61 6.61",
    "mlp": "3.18 0.11 2.82 4.01 5.4 6.73",
    "bayes_maximum_likelihood": "3.83 0.15 3.42 5.14 6.83 8.42",
    "rbf_network": "2.85 0.10 2.61 3.85 5.21 6.09",
    "nearest_neighbour": "3.61 0.10 3.81 5.28 6.11 7.4",
    "knn": "3.1 0.10 2.99 4.02 5.11 5.77",
    "rbf_network_nearest": "2.6 0.10 2.56 3.34 4.42 5.53",
}


def test_all_printed_numbers_of_table_1_are_claims() -> None:
    paper = yaml.safe_load((ROOT / "data/papers/robo_sar.yaml").read_text(encoding="utf-8"))
    cells = [c for c in paper["claims"] if c["id"].startswith("table1.")]
    metrics = ["mean_m", "se_m", "p50_m", "p75_m", "p90_m", "p95_m"]
    found = {(c["quantity"]["algorithm"], c["quantity"]["metric"]): c["printed"] for c in cells}
    expected = {
        (row, metric): digits
        for row, line in TABLE_1.items()
        for metric, digits in zip(metrics, line.split(), strict=True)
    }
    assert found == expected


def test_an_overlay_keeps_the_order_of_the_file_and_null_takes_out() -> None:
    base = shipped()
    merged = {
        "studies": {
            "fingerprint_loo": {
                "families": {
                    "open_floor": {"wall_loss_db": 0},
                    **base["studies"]["fingerprint_loo"]["families"],
                },
                "algorithms": {
                    "mine": {"use": "knn", "k": 2},
                    **base["studies"]["fingerprint_loo"]["algorithms"],
                },
                **{
                    k: v
                    for k, v in base["studies"]["fingerprint_loo"].items()
                    if k not in ("families", "algorithms")
                },
            },
            "fingerprint_real": None,
        },
        "folders": base["folders"],
    }
    merged["studies"]["fingerprint_loo"]["algorithms"]["mlp"] = None
    studies = resolve(merged)
    assert list(studies) == ["fingerprint_loo"]
    assert list(studies["fingerprint_loo"].families) == ["floor", "open_floor"]
    rows = list(studies["fingerprint_loo"].entries)
    assert rows[0] == "svm"
    assert rows[-1] == "mine"
    assert "mlp" not in rows


def test_a_study_that_only_an_overlay_names_is_told() -> None:
    with pytest.raises(InputError, match="overlay"):
        resolve({**SMALL, "studies": {**SMALL["studies"], "other": {"worlds": 4}}})


def test_batches_cover_all_worlds_and_a_sweep_over_fewer_needs_fewer() -> None:
    config = changed(lambda s: (s.update(worlds=5), s["sweeps"]["knn_k"].update(worlds=3)))
    study = resolve(config)["fingerprint_loo"]
    assert study.batches() == ["00000", "00002", "00004"]
    assert study.batches("knn_k") == ["00000", "00002"]
    assert [study.members(b)["worlds"] for b in study.batches()] == [[0, 1], [2, 3], [4]]


def test_settings_of_a_family_win_over_those_of_the_study_and_of_the_paper() -> None:
    config = changed(lambda s: s.update(world={"grid_m": 2.0}, families={"a": {}, "b": {"grid_m": 1.0}}))
    families = resolve(config)["fingerprint_loo"].families
    assert (families["a"]["grid_m"], families["b"]["grid_m"]) == (2.0, 1.0)


def test_controls_have_the_task_of_the_other_rows_and_parts_of_a_row_are_its_code() -> None:
    studies = resolve(shipped())
    assert studies["fingerprint_loo"].entries["control_oracle"].task == "fingerprinting"
    bluetooth = studies["bluetooth_robot"].entries
    assert bluetooth["control_oracle"].source == "algorithms/tracking/control_oracle.py"
    row = bluetooth["iterative_fractional_printed_path_loss"]
    assert row.options == {"ranging": {"use": "path_loss", "task": "ranging"}}
    assert row.sources == [
        "algorithms/trilateration/iterative_fractional_printed.py",
        "algorithms/ranging/path_loss.py",
    ]
    assert bluetooth["particle_filter"].options == {"fixes": "iterative_fractional_printed"}
    assert "fixes" not in bluetooth["particle_filter"].parameters


def test_a_calibrated_setting_holds_in_its_family_or_in_all() -> None:
    steps: list[dict[str, Any]] = [
        {"setting": "noise_db", "value": 4.0, "family": None},
        {"setting": "fringe_db", "value": 2.0, "family": "ambiguity"},
    ]
    assert calibrated_settings(steps, "ambiguity") == {"noise_db": 4.0, "fringe_db": 2.0}
    assert calibrated_settings(steps, "shadowing") == {"noise_db": 4.0}


def test_code_is_followed_through_local_imports_only() -> None:
    files = code_of("algorithms/fingerprinting/wknn.py")
    assert "algorithms/fingerprinting/wknn.py" in files
    assert "positioning/fingerprints.py" in files
    assert "positioning/__init__.py" in files
    assert "positioning/propagation.py" not in files
    assert all(file.startswith(("algorithms/", "positioning/")) for file in files)


def test_code_finds_imports_inside_functions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "positioning").mkdir()
    (tmp_path / "positioning/a.py").write_text("def f():\n    from positioning import b\n", encoding="utf-8")
    (tmp_path / "positioning/b.py").write_text("import numpy\nimport positioning.a\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert code_of("positioning/a.py") == ["positioning/a.py", "positioning/b.py"]


@pytest.mark.parametrize(
    "text",
    [
        "from positioning import (\n    b,\n)\n",
        "from positioning import (  # (old\n    a,  # (new)\n    b,\n)\n",
        "try:\n    x = 1\nexcept E: from positioning import b\n",
        "if x: import positioning.b\nelse: import numpy\n",
        "if x:\n    y = 1\nelse: import positioning.b\n",
        "from positioning \\\n    import b\n",
        "from positioning import \\\n    b\n",
        "x = 1; import positioning.b\n",
        "import numpy, positioning.b\n",
        '"""What to import\n\nfirst."""\nfrom positioning import b\nx = """\nNo import."""\n',
        'x = "import \\\n more"\nimport positioning.b  # "quoted"\n',
        '"""Words that import nothing:\n\nimport as you like (or not\n"""\nimport positioning.b\n',
    ],
)
def test_code_finds_imports_however_they_are_written(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "positioning").mkdir()
    (tmp_path / "positioning/a.py").write_text(text, encoding="utf-8")
    (tmp_path / "positioning/b.py").write_text("", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.py").write_text(text, encoding="utf-8")
    assert "positioning/b.py" in code_of("a.py")


def test_imports_found_in_lines_are_those_of_the_whole_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    files = [file for room in ("positioning", "workflow") for file in (ROOT / room).rglob("*.py")]
    sources = [str(file.relative_to(ROOT)) for file in files]
    quick = {source: code._imports.__wrapped__(source) for source in sources}
    assert sum(map(len, quick.values())) > 500
    monkeypatch.setattr(code, "_import_lines", code._parsed)
    for source in sources:
        assert set(quick[source]) == set(code._imports.__wrapped__(source)), source


def test_constructor_parameters_without_import(tmp_path: Path) -> None:
    file = tmp_path / "x.py"
    file.write_text("class X:\n    def __init__(self, *, a, b=1): ...\nclass Y(X): ...\n", encoding="utf-8")
    assert constructor_parameters(str(file), "X") == ["a", "b"]
    assert constructor_parameters(str(file), "Y") == ["a", "b"]
    more = "from numpy import ndarray\nclass N: ...\nclass Z(ndarray): ...\n@made\nclass D: ...\n"
    other = tmp_path / "y.py"
    other.write_text(more, encoding="utf-8")
    assert constructor_parameters(str(other), "N") == []
    # What a library or a decorator adds, only the import tells.
    assert constructor_parameters(str(other), "Z") is None
    assert constructor_parameters(str(other), "D") is None


def test_annotations_tell_what_a_parameter_may_be(tmp_path: Path) -> None:
    (tmp_path / "positioning").mkdir()
    (tmp_path / "positioning/words.py").write_text("Word = Literal['a', 'b']\n", encoding="utf-8")
    file = tmp_path / "x.py"
    file.write_text(
        "from positioning.words import Word as W\nThree = tuple[float, float, float]\n"
        "class X:\n    def __init__(self, *, n: int, x: float, t: bool, s: str, w: W | None, z: Three,"
        " r: tuple[int, ...], o: Other, p, m: Literal['median'] | float): ...\n",
        encoding="utf-8",
    )
    choices = constructor_choices(str(file), "X")
    assert choices is not None
    right = {
        "n": [3, -1],
        "x": [3, 0.5],
        "t": [True, False],
        "s": ["", "a"],
        "w": ["a", "b", None],
        "z": [[1, 2.5, 3]],
        "r": [[], [1, 2]],
        "o": [1, "a", {}],
        "p": [1, "a", {}],
        "m": ["median", 4, 4.5],
    }
    wrong = {
        "n": [2.5, 4.0, True, "3", None, {}],
        "x": ["1e-4", True, None, []],
        "t": [1, 0, "nope", None],
        "s": [1, None, True],
        "w": ["c", 1, True],
        "z": [[1, 2], 1, [1, 2, "a"]],
        "r": [[1, 2.5], 1],
        "m": ["mean", True, None],
    }
    for name, values in right.items():
        assert all(fits(value, choices[name]) for value in values), name
    for name, values in wrong.items():
        assert not any(fits(value, choices[name]) for value in values), name
    assert methods(str(ROOT / "algorithms/alignment/ransac_alignment.py"), "RansacAlignment") == {
        "__init__",
        "align",
        "placed",
    }


def test_a_plan_tells_what_its_rows_stand_for() -> None:
    for study in resolve(shipped()).values():
        for name, entry in study.describe()["entries"].items():
            assert bool(entry.get("meaning", "")) == (study.entries[name].source is not None), name
    entries = resolve(shipped())["riss_wifi"].describe()["entries"]
    assert entries["control_calibrated_riss"]["meaning"].startswith(
        "The mechanisation for somebody who knows"
    )


def test_the_template_is_no_algorithm() -> None:
    assert "template" not in algorithm_files()
    assert algorithm_files()["wknn"] == ["fingerprinting"]


def test_a_study_without_its_recordings_is_skipped_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    studies = resolve(shipped())
    kept = drop_absent(studies, tmp_path)
    assert "fingerprint_real" not in kept
    assert "fingerprint_loo" in kept
    said = capsys.readouterr().err.splitlines()
    recorded = [study for study in studies.values() if study.recordings]
    assert len(said) == len(recorded) > 1
    for line, study in zip(said, recorded, strict=True):
        assert all(part in line for part in (study.name, "skipped", "sources.csv", "realdata"))
        assert all(recording in line for recording in study.recordings)


def test_an_unregistered_source_is_all_that_its_folder_holds(tmp_path: Path) -> None:
    (tmp_path / "office").mkdir()
    (tmp_path / "office/survey.csv").write_text("x_m,y_m,a_dbm\n", encoding="utf-8")
    assert files_of("office", tmp_path) == [str(tmp_path / "office/survey.csv")]
    assert files_of("nowhere", tmp_path) == []


CLAIM = {"id": "a", "study": "s", "where": "w", "what": "x"}
WRONG_CLAIMS = [
    {**CLAIM, "kind": "value", "unit": "m", "quantity": {"algorithm": "a", "metric": "m"}},
    {**CLAIM, "kind": "value", "printed": 3.06, "unit": "m", "quantity": {"algorithm": "a", "metric": "m"}},
    {**CLAIM, "kind": "ordering"},
    {**CLAIM, "kind": "bound", "quantity": {"algorithm": "a", "metric": "m"}},
    {**CLAIM, "kind": "words"},
    {**CLAIM, "kind": "opinion"},
]


@pytest.mark.parametrize("claim", WRONG_CLAIMS)
def test_a_claim_without_what_its_kind_needs_is_refused(claim: dict[str, Any]) -> None:
    paper = {
        "key": "p",
        "short": "P",
        "authors": "a",
        "title": "t",
        "settings": {},
        "readings": {},
        "claims": [claim],
    }
    with pytest.raises(InputError, match=r"paper\.claims\.0"):
        check_schema(paper, ROOT / "workflow/schemas/paper.schema.yaml", "paper")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        ({"outside": ["0.9", "1.1"], "at_least": "0.5"}, "at_least stands beside it"),
        ({"outside": ["1.1", "0.9"]}, "1.1 and 0.9 descend"),
        ({"at_least": "10", "at_most": "9.5"}, "10 and 9.5 descend"),
    ],
)
def test_limits_that_no_number_or_every_number_keeps_to_are_refused(
    limits: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        check_limits({**CLAIM, "kind": "bound", **limits}, "paper.claims.a")


@pytest.mark.parametrize("limits", [{}, {"at_most": "1"}, {"at_least": "9.5", "at_most": "10"}])
def test_limits_that_ascend_are_let_through(limits: dict[str, Any]) -> None:
    check_limits({**CLAIM, "kind": "bound", **limits}, "paper.claims.a")
