"""Calibration: where its search ends, whose settings hold in a trial, and what it refuses."""

import copy
import importlib.util
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import ROOT, SMALL
from planning.config import resolve

from positioning.errors import InputError
from positioning.files import read_json
from positioning.model import Worlds

SPEC = importlib.util.spec_from_file_location("script_calibrate", ROOT / "workflow/scripts/calibrate.py")
assert SPEC is not None
assert SPEC.loader is not None
calibrate = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(calibrate)
# Other processes look its functions up by name.
sys.modules["script_calibrate"] = calibrate

Trials = list[dict[str, Any]]


@pytest.fixture
def trials(monkeypatch: pytest.MonkeyPatch) -> Trials:
    """A study whose row is off by what the world's noise says, and the settings of every trial."""
    seen: Trials = []

    def simulate(settings: Mapping[str, Any], rngs: Sequence[np.random.Generator]) -> Worlds:
        seen.append(dict(settings))
        return Worlds({"noise_db": np.full(len(rngs), settings["noise_db"])}, {})

    def run(make: Any, observed: Mapping[str, Any], *others: Any) -> SimpleNamespace:
        return SimpleNamespace(estimates=observed)

    def score(estimates: Mapping[str, Any], truth: Mapping[str, Any]) -> dict[str, Any]:
        return {"error_m": curve(estimates["noise_db"])[:, None]}

    parts = {
        "positioning.simulation.study": SimpleNamespace(simulate=simulate),
        "positioning.tasks.fingerprinting": SimpleNamespace(run=run, score=score),
    }
    monkeypatch.setattr(calibrate, "import_module", parts.__getitem__)
    return seen


def curve(noise_db: Any) -> Any:
    return np.asarray(noise_db) ** 1.5 + 1.0


def step(printed: str, **changes: Any) -> dict[str, Any]:
    row = {"name": "wknn", "use": "wknn", "task": "fingerprinting", "parameters": {}, "options": {}}
    return {
        "setting": "noise_db",
        "between": [0.5, 12],
        "metric": "mean_m",
        "claim": "table1.wknn.mean",
        "family": None,
        "settings": {},
        "row": row,
        "printed": printed,
        "seeds": [7, 8],
        **changes,
    }


def found(
    tmp_path: Path, *steps: dict[str, Any], families: Any = None, processes: int = 1
) -> list[dict[str, Any]]:
    output = tmp_path / "calibration.json"
    calibrate.main(
        "study", families or {"floor": {"noise_db": 3.0, "grid_m": 1.0}}, steps, processes, str(output)
    )
    return list(read_json(output))


@pytest.mark.parametrize("printed", ["9.0", "3.40", "20.7413"])
def test_the_search_ends_where_the_printed_number_is_near(
    tmp_path: Path, trials: Trials, printed: str
) -> None:
    (result,) = found(tmp_path, step(printed))
    assert result["reached"] == pytest.approx(float(printed), rel=calibrate.NEAR, abs=5e-5)
    assert result["reached"] == pytest.approx(curve(result["value"]), abs=5e-5)
    assert result["value"] == pytest.approx((float(printed) - 1) ** (2 / 3), rel=2 * calibrate.NEAR)
    tried = [trial["noise_db"] for trial in trials]
    assert result["settings_tried"] == len(tried) == len(set(tried))
    # All but the last are further off, and so the search went on.
    assert all(abs(curve(value) / float(printed) - 1) > calibrate.NEAR for value in tried[:-1])
    assert tried[-1] == result["value"]


def test_a_step_of_the_measure_ends_the_search_at_three_decimals(
    tmp_path: Path, trials: Trials, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(globals(), "curve", lambda noise_db: np.where(noise_db < 4.3217, 1.0, 3.0))
    (result,) = found(tmp_path, step("2.0"))
    assert result["value"] == pytest.approx(4.3217, abs=1.5e-3)
    assert result["settings_tried"] == len(trials) < 30


def test_settings_of_a_step_hold_in_its_trials_alone(tmp_path: Path, trials: Trials) -> None:
    first, second = found(tmp_path, step("9.0", settings={"grid_m": 4.0}), step("9.0", setting="noise_db"))
    count = first["settings_tried"]
    assert {trial["grid_m"] for trial in trials[:count]} == {4.0}
    assert {trial["grid_m"] for trial in trials[count:]} == {1.0}
    assert (first["settings"], second["settings"]) == ({"grid_m": 4.0}, {})


def test_a_printed_number_outside_the_range_is_refused(tmp_path: Path, trials: Trials) -> None:
    with pytest.raises(InputError, match=r"the printed 1\.2 is not between them"):
        found(tmp_path, step("1.2"))
    assert [trial["noise_db"] for trial in trials] == [0.5, 12.0]


def planned(change: Callable[[dict[str, Any]], Any], monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.chdir(ROOT)
    config = copy.deepcopy(SMALL)
    change(config["studies"]["fingerprint_loo"]["calibrate"][0])
    study = resolve(config)["fingerprint_loo"]
    return study.calibration_steps([{"id": "table1.wknn.mean", "printed": "3.04"}])[0]


def test_a_plan_hands_the_settings_on(monkeypatch: pytest.MonkeyPatch) -> None:
    assert planned(lambda c: None, monkeypatch)["settings"] == {}
    settings = {"grid_m": 2.0}
    assert planned(lambda c: c.update(settings=settings), monkeypatch)["settings"] == settings


@pytest.mark.parametrize(("name", "cure"), [("grid", "'grid_m'"), ("noise_db", "other setting")])
def test_settings_that_are_unknown_or_calibrated_are_refused(
    name: str, cure: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match=r"calibrate\[0\]\.settings") as raised:
        planned(lambda c: c.update(settings={name: 2.0}), monkeypatch)
    assert cure in str(raised.value)


def test_worlds_shared_out_among_processes_give_the_same(tmp_path: Path, trials: Trials) -> None:
    steps = (step("9.0", seeds=[7, 8, 9]),)
    assert (
        found(tmp_path, *steps, processes=2)
        == found(tmp_path, *steps)
        == found(tmp_path, *steps, processes=5)
    )
