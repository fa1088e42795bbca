"""Settings of worlds and options of recordings, tried before any job: a wrong one has its place."""

import copy
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from planning import values
from planning.code import keywords
from planning.config import resolve
from planning.values import NOWHERE, check_options, check_values

from positioning.errors import InputError
from positioning.files import read_yaml

FILES = ("survey_csv", "walk_csv")
"""Adapters whose options are names of files, of which any may be right."""


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.fixture(scope="module")
def shipped() -> dict[str, Any]:
    config: dict[str, Any] = read_yaml(ROOT / "config/config.yaml")
    return config


def plan(config: dict[str, Any]) -> None:
    studies = resolve(config, ROOT)
    check_options(studies, ROOT)
    check_values(studies, config["studies"])


def told(shipped: dict[str, Any], change: Callable[[dict[str, Any]], Any]) -> InputError:
    config = copy.deepcopy(shipped)
    change(config["studies"])
    with pytest.raises(InputError) as caught:
        plan(config)
    return caught.value


def family(study: str, name: str, **settings: Any) -> Callable[[dict[str, Any]], None]:
    def change(studies: dict[str, Any]) -> None:
        studies[study]["families"][name] = {**(studies[study]["families"][name] or {}), **settings}

    return change


def recording(study: str, name: str, **options: Any) -> Callable[[dict[str, Any]], None]:
    return lambda studies: studies[study]["recordings"][name].update(options)


def in_all_worlds(**settings: Any) -> Callable[[dict[str, Any]], None]:
    return lambda studies: studies["bluetooth_robot"].update(world=settings)


WRONG = {
    "too little": (
        family("bluetooth_robot", "shadowing", fringe_db=-1),
        ["studies.bluetooth_robot.families.shadowing.fringe_db: -1 is not at least 0", "within the limits"],
    ),
    "too much": (
        family("riss_wifi", "aged", gone_share=2),
        ["studies.riss_wifi.families.aged.gone_share: 2 is not at least 0 and at most 1"],
    ),
    "a word for a number": (
        family("riss_wifi", "aged", gone_share="two"),
        ["families.aged.gone_share: 'two' is not a finite number. Give a number"],
    ),
    "an unknown word": (
        family("graph_slam", "walks", dead_reckoning="magic"),
        ["families.walks.dead_reckoning: 'magic' is not one of: model, imu"],
    ),
    "in all families": (
        in_all_worlds(fringe_period_m=0),
        ["studies.bluetooth_robot.world.fringe_period_m: 0 is not above 0"],
    ),
    "against a setting of the paper": (
        family("bluetooth_robot", "ambiguity", iterations_least=1000),
        ["families.ambiguity, setting iterations_most of data/papers/bluetooth_robot.yaml", "1000"],
    ),
    "an end of a calibration": (
        lambda studies: studies["bluetooth_robot"]["calibrate"][1].update(between=[-1, 12]),
        ["studies.bluetooth_robot.calibrate[1].between: -1 is not at least 0"],
    ),
    "a setting of calibration worlds": (
        lambda studies: studies["foot_wlan"]["calibrate"][0]["settings"].update(imu="maybe"),
        ["studies.foot_wlan.calibrate[0].settings.imu: 'maybe' is neither on nor off. Give on or off"],
    ),
    "an unknown adapter": (
        recording("bluetooth_real", "anchors_ble", adapter="rss_multilaterations"),
        ["recordings.anchors_ble.adapter: ", "did you mean 'rss_multilateration'"],
    ),
    "a module that is no adapter": (
        recording("bluetooth_real", "anchors_ble", adapter="register"),
        ["there is no adapter of positioning/recordings/ named 'register'"],
    ),
    "an unknown option": (
        recording("bluetooth_real", "anchors_ble", windows_s=1.0),
        ["recordings.anchors_ble.windows_s: ", "did you mean 'window_s'", "Known are technology, window_s"],
    ),
    "a missing option": (
        lambda studies: studies["fingerprint_real"]["recordings"]["dsi1"].pop("name"),
        ["recordings.dsi1.name: the option is missing", "wifi_fingerprint_collection.py tells its meaning"],
    ),
    "text for a number": (
        recording("bluetooth_real", "anchors_ble", window_s="1.0"),
        ["recordings.anchors_ble.window_s: ", "text to YAML", "Write 1.0 without quotes"],
    ),
    "no such scenario": (
        recording("bluetooth_real", "room_1_ble", scenario=9),
        ["studies.bluetooth_real.recordings.room_1_ble.scenario: 9 is none of 1, 2"],
    ),
    "no such technology": (
        recording("bluetooth_real", "room_1_ble", technology="blu"),
        ["recordings.room_1_ble.technology: 'blu' is none of ble, wifi, zigbee"],
    ),
    "no such walk": (
        recording("foot_real", "corridor_31", walk=99),
        ["studies.foot_real.recordings.corridor_31.walk: 99 is none of 31, 33, 34, 36"],
    ),
    "a negative time": (
        recording("bluetooth_real", "anchors_ble", window_s=-1),
        ["recordings.anchors_ble.window_s: -1 is no positive length of time. Give seconds above zero"],
    ),
    "less than the adapter needs": (
        recording("flight_real", "rover", align_s=1),
        ["studies.flight_real.recordings.rover.align_s: 1 is not a number from 10 s on"],
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_value_is_told_with_its_place(name: str, shipped: dict[str, Any]) -> None:
    change, words = WRONG[name]
    text = str(told(shipped, change))
    for word in words:
        assert word in text, text


def test_the_shipped_configuration_passes(shipped: dict[str, Any]) -> None:
    plan(shipped)


def synthetic() -> list[str]:
    studies: dict[str, Any] = read_yaml(ROOT / "config/config.yaml")["studies"]
    return [name for name, study in studies.items() if "recordings" not in study]


@pytest.mark.parametrize("name", synthetic())
def test_a_simulation_reads_its_settings_before_it_draws(name: str, shipped: dict[str, Any]) -> None:
    """The trial with no world at all, on which the check rests."""
    simulate = import_module(f"positioning.simulation.{name}").simulate
    settings = next(iter(resolve(shipped, ROOT)[name].families.values()))
    with pytest.raises(InputError, match="there is no world to draw"):
        simulate(settings, [])
    missed = []
    for setting in settings:
        with pytest.raises(InputError) as caught:
            simulate({**settings, setting: "senseless"}, [])
        if not caught.value.thing.startswith(f"setting {setting}"):
            missed.append(f"{setting}: {caught.value}")
    assert [line for line in missed if "no world to draw" not in line] == []
    # Settings that nobody reads are no settings; those of another choice than this family's may be few.
    assert len(missed) <= 0.2 * len(settings), missed


def options() -> Iterator[tuple[str, str]]:
    for path in sorted((ROOT / "positioning/recordings").glob("*.py")):
        if path.stem not in FILES:
            for option, keyword in (keywords(str(path), "load") or {}).items():
                if keyword.choices is not None:
                    yield path.stem, option


@pytest.mark.parametrize(("adapter", "option"), list(options()))
def test_an_adapter_looks_at_its_options_before_it_looks_for_files(
    adapter: str, option: str, shipped: dict[str, Any]
) -> None:
    """The trial in a folder that cannot exist, on which the check rests."""
    load = import_module(f"positioning.recordings.{adapter}").load
    lines = [
        {key: value for key, value in line.items() if key not in ("adapter", "source")}
        for study in shipped["studies"].values()
        for line in study.get("recordings", {}).values()
        if line["adapter"] == adapter
    ]
    choices = (keywords(str(ROOT / f"positioning/recordings/{adapter}.py"), "load") or {})[option].choices
    senseless = "senseless" if choices and choices[0].kind == "str" else -1000
    things = []
    for line in lines:
        with pytest.raises(InputError) as caught:
            load(NOWHERE, **{**line, option: senseless})
        things.append(caught.value.thing)
    # Which options count may depend on the others.
    assert f"{adapter}, option {option}" in things


def test_the_folder_of_the_trial_cannot_exist() -> None:
    assert not NOWHERE.exists()
    with pytest.raises(OSError, match="ot a directory"):
        NOWHERE.mkdir(parents=True)


@pytest.mark.parametrize(
    "error",
    [TypeError("a world is needed"), InputError("rngs", "there is none", "Give one"), FileNotFoundError("x")],
)
def test_what_speaks_of_no_setting_is_left_to_the_job(
    error: Exception, shipped: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*args: Any, **settings: Any) -> None:
        raise error

    monkeypatch.setattr(values, "_function", lambda module, name: fails)
    check_values(resolve(shipped, ROOT), shipped["studies"])


def test_a_module_that_does_not_import_is_left_to_the_job() -> None:
    assert values._function("positioning.simulation.no_such_study", "simulate") is None


def test_keywords_of_a_function_are_read_without_importing_it(tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(
        "import no_such_library\n\n\n"
        "def load(folder, *, name: str, window_s: float = 1.0, parts=()): ...\n"
        "def free(folder, **options): ...\n",
        encoding="utf-8",
    )
    found = keywords(str(file), "load")
    assert found is not None
    assert {name: keyword.needed for name, keyword in found.items()} == {
        "name": True,
        "window_s": False,
        "parts": False,
    }
    assert found["parts"].choices is None
    assert [choice.kind for choice in found["window_s"].choices or ()] == ["float"]
    assert keywords(str(file), "free") is None
    assert keywords(str(file), "absent") is None
