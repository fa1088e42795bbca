"""What a study's page tells in words: worlds, rows, sweeps, settings; and the digits of intervals."""

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from planning.config import resolve

from positioning.errors import InputError
from positioning.files import read_yaml
from positioning.presentation import pages, tables
from positioning.presentation.study_lines import (
    breakable,
    coded,
    in_words,
    row_lines,
    scene_line,
    setting_lines,
    sweep_lines,
    world_lines,
)

PAPER: dict[str, Any] = {
    "noise_db": {"value": 4.5, "unit": "dB, standard deviation", "assumed": True, "why": "as `x` <has>"},
    "points": {"value": 257, "unit": "places", "where": "section 6"},
    "scene": {"value": "walks", "unit": "word", "where": "section 4"},
}
FAMILIES = {
    "calm": {"noise_db": 4.5, "points": 257, "scene": "walks"},
    "odd": {"noise_db": 2.0, "points": 257, "scene": "lines"},
}
STEP = {"setting": "noise_db", "family": "calm", "value": 3.25}
MINUS = "\N{MINUS SIGN}"


def shipped() -> dict[str, Any]:
    config = read_yaml("config/config.yaml")
    assert isinstance(config, dict)
    return config


def entry(use: str, meaning: str = "", **rest: Any) -> dict[str, Any]:
    return {"use": use, "task": "tracking", "parameters": {}, "options": {}, "meaning": meaning, **rest}


def test_backticks_become_code_and_nothing_else_is_obeyed() -> None:
    assert coded("a `b_c` & <i>") == "a <code>b_c</code> &amp; &lt;i&gt;"
    assert breakable("a_b<") == "<code>a_<wbr>b&lt;</code>"


def test_algorithms_inside_settings_read_like_calls_without_their_task() -> None:
    part = {"use": "knn", "task": "fingerprinting", "k": 4}
    value = {"use": "reduced", "task": "fingerprinting", "regressor": part, "columns": None}
    assert in_words(value) == "reduced (regressor = knn (k = 4), columns = none)"
    assert in_words({"use": "knn", "task": "fingerprinting"}) == "knn"
    assert in_words([1, 2.0]) == "1, 2"
    assert in_words([[1, 2.5], [3, 4]]) == "(1, 2.5), (3, 4)"


def test_families_tell_the_values_that_calibration_gave_and_no_others() -> None:
    plan = {"recordings": {}, "families": FAMILIES, "meanings": {"odd": "along a `line`"}}
    calm, odd = world_lines(plan, PAPER, [STEP])
    assert calm["changed"] == [{"name": "noise_db", "text": "3.25 dB", "calibrated": True}]
    assert odd["changed"] == [
        {"name": "noise_db", "text": "2 dB", "calibrated": False},
        {"name": "scene", "text": "lines", "calibrated": False},
    ]
    assert (calm["meaning"], odd["meaning"]) == ("", "Along a <code>line</code>.")


def test_recordings_of_one_kind_share_a_line() -> None:
    plan = {
        "recordings": {name: {} for name in "abxcde"},
        "families": {},
        "meanings": {**dict.fromkeys("abcde", "A foot."), "x": "A rover."},
    }
    assert world_lines(plan, {}, []) == [
        {"names": ["a", "b", "c"], "more": 2, "meaning": "A foot.", "changed": []},
        {"names": ["x"], "more": 0, "meaning": "A rover.", "changed": []},
    ]


def test_variants_tell_what_differs_from_the_first_row_of_their_algorithm() -> None:
    rows = row_lines(
        {
            "filter": entry("particle_filter", "Samples.", parameters={"count": 5, "sigma_m": 1.5}),
            "wide": entry("particle_filter", "Samples.", parameters={"count": 5, "sigma_m": 3.0}),
            "other": entry("particle_filter", parameters={"count": 5}, options={"fixes": "f"}, worlds=20),
            "same": entry("graph_slam", "`ParticleFilter` without `OtherThing`.", families=["odd"]),
            "library": entry("sklearn.svm.SVR"),
            "control_x": entry("control_x", "The truth."),
        }
    )
    told = {row["name"]: row["what"] for row in rows}
    assert told["filter"] == "Samples. With count = 5, sigma_m = 1.5."
    assert told["wide"] == "Like <code>filter</code>, but with sigma_m = 3."
    assert told["other"] == (
        "Like <code>filter</code>, but with fixes = f and <code>sigma_m</code> as by default."
        " Only on 20 worlds."
    )
    assert told["same"] == ("<code>filter</code> without <code>other_thing</code>. Only in <code>odd</code>.")
    assert told["library"] == "<code>SVR</code> of the library sklearn."
    assert [row["name"] for row in rows if row["is_control"]] == ["control_x"]


def test_rows_of_one_algorithm_in_two_tasks_are_no_variants() -> None:
    rows = row_lines({"a": entry("control_centre", "One."), "b": entry("control_centre", "Two.", task="x")})
    assert [row["what"] for row in rows] == ["One.", "Two."]


def test_sweeps_tell_what_stays_fixed_and_where_they_are_drawn() -> None:
    full = entry("knn", parameters={"k": 1, "p": 2}, over=["k", [1.0, 2.0]], worlds=3)
    first, second = sweep_lines({"k_sweep": full, "short": ["k", [1.0, 4.0, 10.0]]}, {"k_sweep": "fig2"})
    assert (first["use"], first["setting"], first["over"], first["count"]) == ("knn", "k", "1, 2", 2)
    assert first["fixed"] == "p = 2; only on 3 worlds"
    assert (first["figure"], second["figure"]) == ("fig2", "")
    assert (second["over"], second["fixed"]) == ("1, 4, 10", "")


def test_settings_stand_in_two_lists_with_what_is_used_instead() -> None:
    found = setting_lines(PAPER, FAMILIES, [STEP])
    assert [line["name"] for line in found["reported"]] == ["points", "scene"]
    (noise,) = found["assumed"]
    assert noise["where"] == "as <code>x</code> &lt;has&gt;"
    assert noise["used"] == [
        {"text": "3.25", "calibrated": True, "families": ["calm"]},
        {"text": "2", "calibrated": False, "families": ["odd"]},
    ]
    assert found["reported"][0]["used"] == []
    everywhere = setting_lines(PAPER, FAMILIES, [{**STEP, "family": None}])["assumed"][0]["used"]
    assert everywhere == [{"text": "3.25", "calibrated": True, "families": []}]


def test_a_calibration_that_reaches_the_assumed_value_is_still_marked() -> None:
    used = setting_lines(PAPER, {"calm": FAMILIES["calm"]}, [{**STEP, "value": 4.5}])["assumed"][0]["used"]
    assert used == [{"text": "4.5", "calibrated": True, "families": []}]


def test_time_is_told_by_rule_with_shares_and_sum() -> None:
    told = pages._seconds_by_rule({"seconds_by_rule": {"score": 1.0, "run": 3.0}})
    assert told == [("run", "3.0 s", "75 %"), ("score", "1.0 s", "25 %"), ("all", "4.0 s", "100 %")]
    assert pages._seconds_by_rule({}) == []


@pytest.mark.parametrize(
    ("low", "high", "printed", "least", "shown"),
    [
        (0.637149, 1.51255, "0.948", 2, "0.637 to 1.51"),
        (12.345, 123.456, "", 2, "12.3 to 123"),
        (12.345, 123.456, "12.34", 2, "12.35 to 123.5"),
        (-12.345, 1234.5, "", 2, f"{MINUS}12.3 to 1234"),
        (20.2, 41.7, "31", 0, "20 to 42"),
        (0.0042, 9.999, "", 2, "0.00 to 10.0"),
        (float("nan"), 1.0, "", 2, ""),
    ],
)
def test_intervals_have_three_digits_or_those_of_the_printed_number(
    low: float, high: float, printed: str, least: int, shown: str
) -> None:
    assert tables.span(low, high, printed, least) == shown


@given(st.floats(0, 9999), st.sampled_from(["", "1", "12.5", "1.2345"]))
def test_ends_of_intervals_are_rounded_and_not_cut(value: float, printed: str) -> None:
    text = tables.span(value, value, printed).partition(" to ")[0]
    digits = len(text.replace(".", "").lstrip("0"))
    whole = len(text.partition(".")[0].lstrip("0"))
    assert digits <= max(3, whole, len(printed.replace(".", "")))
    assert float(text) == pytest.approx(value, abs=0.5 * 10 ** -len(text.partition(".")[2]) * 1.000001)


def test_shipped_studies_tell_every_world_and_every_row() -> None:
    for name, study in resolve(shipped()).items():
        plan = study.describe()
        assert all(row["what"] for row in row_lines(plan["entries"])), name
        if study.recordings:
            assert set(plan["meanings"]) == set(study.recordings), name
            assert all(plan["meanings"].values()), name
        else:
            assert scene_line(plan["scene"]), name
            assert len(study.families) == 1 or all(plan["meanings"].values()), name
            assert all("meaning" not in family for family in study.families.values()), name


def test_what_a_family_means_is_words_and_no_setting() -> None:
    config = shipped()
    families = {"floor": {"meaning": "As it is.", "points": 30}, "bare": {}}
    config["studies"] = {"fingerprint_loo": {**config["studies"]["fingerprint_loo"], "families": families}}
    study = resolve(config)["fingerprint_loo"]
    assert study.meanings == {"floor": "As it is.", "bare": ""}
    assert study.families["floor"]["points"] == 30
    assert "meaning" not in str(study.members("00000"))
    families["floor"] = {"meaning": 3}
    with pytest.raises(InputError, match=r"fingerprint_loo\.families\.floor\.meaning"):
        resolve(config)


def test_styles_of_studies_load_nothing() -> None:
    style = Path("positioning/presentation/templates/study.css").read_text(encoding="utf-8")
    assert "url(" not in style
    assert "@import" not in style
