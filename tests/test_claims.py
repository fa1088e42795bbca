"""The rules of the verdicts, each with numbers small enough to check by hand."""

from typing import Any

import numpy as np
import pandas as pd
import pytest

from positioning.errors import InputError
from positioning.evaluation.claims import COLUMNS, VERDICTS, judge, per_world
from positioning.evaluation.measures import MEASURES

A, B = {"algorithm": "a", "metric": "mean_m"}, {"algorithm": "b", "metric": "mean_m"}


def measures(**values: Any) -> pd.DataFrame:
    """One value a world for each algorithm."""
    rows = [
        ("f", name, np.nan, w, "mean_m", float(x)) for name, xs in values.items() for w, x in enumerate(xs)
    ]
    return pd.DataFrame(rows, columns=MEASURES)


def verdict(
    claim: dict[str, Any], data: pd.DataFrame, *others: dict[str, Any], **calibrated: str
) -> pd.Series:
    base = {"where": "Table 1", "what": "something", "study": "s", "unit": "m"}
    claims = [{**base, "id": "c", **claim}, *({**base, "id": f"o{i}", **o} for i, o in enumerate(others))]
    ledger = judge(claims, data, paper="p", study="s", family="f", calibrated=calibrated)
    assert list(ledger.columns) == COLUMNS
    assert set(ledger["verdict"]) <= set(VERDICTS)
    return ledger.iloc[0]


def test_a_wide_interval_says_so_and_changes_no_verdict() -> None:
    claim = {"kind": "value", "printed": "1.0", "quantity": A}
    wide = verdict(claim, measures(a=np.linspace(0.1, 9.0, 41)))
    assert wide["verdict"] == "reproduced"
    assert wide["reason"].endswith("; a wide interval: a weak test")
    narrow = verdict(claim, measures(a=np.linspace(0.5, 2.0, 41)))
    assert narrow["verdict"] == "reproduced"
    assert "weak" not in narrow["reason"]


FORTY = np.linspace(2.0, 4.0, 41)


def test_a_share_of_worlds_has_not_the_unit_of_its_limit() -> None:
    row = verdict({"kind": "bound", "at_most": "3.0", "quantity": A}, measures(a=FORTY))
    assert (row["unit"], row["rebuilt"]) == ("", pytest.approx(22 / 41))
    assert verdict({"kind": "value", "printed": "3.00", "quantity": A}, measures(a=FORTY))["unit"] == "m"


@pytest.mark.parametrize(
    ("printed", "expected"),
    [("3.00", "reproduced"), ("2.1", "reproduced"), ("4.20", "not reproduced"), ("1.50", "not reproduced")],
)
def test_value_inside_or_outside_the_central_95_percent(printed: str, expected: str) -> None:
    row = verdict({"kind": "value", "printed": printed, "quantity": A}, measures(a=FORTY))
    assert row["verdict"] == expected
    assert (row["rebuilt"], row["worlds"]) == (pytest.approx(3.0), 41)


def test_the_distance_is_told() -> None:
    row = verdict({"kind": "value", "printed": "5.00", "quantity": A}, measures(a=FORTY))
    assert "2 above the mean" in row["reason"]
    assert f"{2 / FORTY.std(ddof=1):.1f} standard deviations" in row["reason"]


@pytest.mark.parametrize(("printed", "expected"), [("1.96", "not reproduced"), ("2.0", "reproduced")])
def test_a_printed_digit_stands_for_all_numbers_that_round_to_it(printed: str, expected: str) -> None:
    data = measures(a=np.linspace(2.03, 4, 39))
    row = verdict({"kind": "value", "printed": printed, "quantity": A}, data)
    assert row["verdict"] == expected
    assert ("rounds to the end" in row["reason"]) == (expected == "reproduced")


def test_few_worlds_decide_nothing_against_a_paper() -> None:
    claim = {"kind": "value", "printed": "9.00", "quantity": A}
    assert verdict(claim, measures(a=[1, 2, 3, 4]))["verdict"] == "undecided"
    assert verdict({**claim, "printed": "2.50"}, measures(a=[1, 2, 3, 4]))["verdict"] == "reproduced"


def test_what_set_a_parameter_counts_for_nothing() -> None:
    claim = {"kind": "value", "printed": "3.00", "quantity": A}
    row = verdict(claim, measures(a=FORTY), c="set x = 1")
    assert (row["verdict"], row["reason"]) == ("calibrated", "set x = 1")
    assert verdict(claim, measures(a=FORTY), claim, o0="set x = 1")["verdict"] == "calibrated"


@pytest.mark.parametrize(
    ("true", "expected"), [(40, "holds"), (38, "holds"), (37, "depends"), (3, "depends"), (2, "fails")]
)
def test_an_ordering_holds_in_a_share_of_worlds(true: int, expected: str) -> None:
    a = np.where(np.arange(40) < true, 1.0, 3.0)
    row = verdict({"kind": "ordering", "quantities": [A, B]}, measures(a=a, b=np.full(40, 2.0)))
    same = verdict({"kind": "smallest", "quantity": A, "than": [B]}, measures(a=a, b=np.full(40, 2.0)))
    assert (same["verdict"], same["rebuilt"]) == (row["verdict"], row["rebuilt"])
    assert (row["verdict"], row["rebuilt"]) == (expected, true / 40)
    assert row["low"] < true / 40 <= row["high"]
    assert f"{true} of 40" in row["reason"]


def test_worlds_are_paired_by_their_number() -> None:
    data = measures(a=[1, 2, 3, 4], b=[2, 3, 4, 5])
    shuffled = data.sample(frac=1, random_state=1)
    assert verdict({"kind": "ordering", "quantities": [A, B]}, shuffled)["rebuilt"] == 1.0


VALUE_A = {"kind": "value", "printed": "3.18", "quantity": A}
VALUE_B = {"kind": "value", "printed": "2.60", "quantity": B}


def test_a_paper_whose_own_numbers_break_its_claim_contradicts_itself() -> None:
    claim = {"kind": "ratio", "quantity": A, "to": B, "at_least": "1.30"}
    row = verdict(claim, measures(a=np.full(40, 4.0), b=np.full(40, 2.0)), VALUE_A, VALUE_B)
    assert row["verdict"] == "contradicts itself"
    assert "3.18 / 2.60 = 1.223" in row["reason"]
    assert "40 of 40" in row["reason"]


def test_own_numbers_that_agree_leave_the_verdict_to_the_worlds() -> None:
    claim = {"kind": "ordering", "quantities": [B, A]}
    row = verdict(claim, measures(a=np.full(40, 1.0), b=np.full(40, 2.0)), VALUE_A, VALUE_B)
    assert row["verdict"] == "fails"
    assert "2.60, 3.18" in row["reason"]


@pytest.mark.parametrize(("limit", "expected"), [("2.4", "holds"), ("2.3", "fails"), ("2.36", "holds")])
def test_a_bound_is_met_by_what_rounds_to_it(limit: str, expected: str) -> None:
    assert (
        verdict({"kind": "bound", "quantity": A, "at_most": limit}, measures(a=[2.36] * 40))["verdict"]
        == expected
    )


def test_both_ends_of_a_ratio_count() -> None:
    claim = {"kind": "ratio", "quantity": A, "to": B, "at_least": "0.95", "at_most": "1.05"}
    row = verdict(claim, measures(a=[1.0, 0.8, 1.2, 1.04], b=[1.0] * 4))
    assert row["rebuilt"] == 0.5


def test_outside_two_limits_is_the_rest_of_between_them() -> None:
    data = measures(a=[1.0, 0.9, 0.8, 1.1, 1.2, 1.04], b=[1.0] * 6)
    claim = {"kind": "ratio", "quantity": A, "to": B, "limit": "assumed"}
    within = verdict({**claim, "at_least": "0.9", "at_most": "1.1"}, data)
    outside = verdict({**claim, "outside": ["0.9", "1.1"]}, data)
    assert (within["rebuilt"], outside["rebuilt"]) == pytest.approx((4 / 6, 2 / 6))


@pytest.mark.parametrize(("x", "met"), [(0.94, True), (0.96, False), (1.04, False), (1.06, True)])
def test_printed_limits_of_outside_stand_for_what_rounds_to_them(x: float, met: bool) -> None:
    claim = {"kind": "bound", "quantity": A, "outside": ["0.9", "1.1"]}
    assert verdict(claim, measures(a=[x] * 40))["rebuilt"] == met


@pytest.mark.parametrize(("printed", "contradicts"), [("1.00", True), ("1.20", False)])
def test_a_printed_number_between_the_limits_contradicts_a_claim_of_outside(
    printed: str, contradicts: bool
) -> None:
    claim = {"kind": "bound", "quantity": A, "outside": ["0.9", "1.1"], "limit": "assumed"}
    own = {**VALUE_A, "printed": printed}
    row = verdict(claim, measures(a=[0.5] * 40), own)
    assert (row["verdict"] == "contradicts itself") == contradicts
    assert "outside 0.9 to 1.1 is claimed" in row["reason"]


@pytest.mark.parametrize(("x", "expected"), [(1.03064, "exact"), (1.03066, "not reproduced")])
def test_exact_means_every_printed_digit(x: float, expected: str) -> None:
    assert (
        verdict({"kind": "exact", "printed": "1.0306", "quantity": A}, measures(a=[x]))["verdict"] == expected
    )


def test_no_number_and_words() -> None:
    assert verdict({"kind": "none", "quantity": A}, measures(a=FORTY))["verdict"] == "none given"
    row = verdict({"kind": "words", "reason": "no number"}, measures(a=FORTY))
    assert (row["verdict"], row["reason"]) == ("not testable", "no number")


def test_a_row_that_is_not_configured_is_told() -> None:
    row = verdict({"kind": "value", "printed": "1.0", "quantity": B}, measures(a=FORTY))
    assert row["verdict"] == "not testable"
    assert "b" in row["reason"]


def test_few_worlds_decide_no_condition() -> None:
    row = verdict({"kind": "ordering", "quantities": [A, B]}, measures(a=[1.0] * 4, b=[2.0] * 4))
    assert (row["verdict"], row["rebuilt"]) == ("undecided", 1.0)


@pytest.mark.parametrize(
    ("printed", "expected"), [("9.0", "not reproduced"), ("3.2", "undecided"), ("2.0", "reproduced")]
)
def test_a_dozen_worlds_need_normal_values_against_a_number(printed: str, expected: str) -> None:
    values = np.linspace(1, 3, 12)
    row = verdict({"kind": "value", "printed": printed, "quantity": A}, measures(a=values))
    assert row["verdict"] == expected
    assert ("prediction interval" in row["reason"]) == (expected != "reproduced")


def test_a_dozen_worlds_judge_a_condition_and_tell_how_sure_that_is() -> None:
    claim = {"kind": "ordering", "quantities": [A, B]}
    row = verdict(claim, measures(a=[1.0] * 12, b=[2.0] * 12))
    assert row["verdict"] == "holds"
    assert "0.74 to 1.00 with 95 %" in row["reason"]
    assert verdict(claim, measures(a=[1.0] * 12, b=[2.0] * 11 + [0.0]))["verdict"] == "depends"


def test_a_printed_tie_is_no_contradiction() -> None:
    claim = {"kind": "ordering", "quantities": [A, B]}
    data = measures(a=[1.0] * 40, b=[2.0] * 40)
    tied = [{**VALUE_A, "printed": "6.09"}, {**VALUE_B, "printed": "6.09"}]
    assert verdict(claim, data, *tied)["verdict"] == "holds"
    apart = [{**VALUE_A, "printed": "6.10"}, {**VALUE_B, "printed": "6.09"}]
    assert verdict(claim, data, *apart)["verdict"] == "contradicts itself"


@pytest.mark.parametrize(("printed", "expected"), [("3.35", "fails"), ("3.18", "contradicts itself")])
def test_a_quotient_of_rounded_numbers_is_a_span(printed: str, expected: str) -> None:
    """3.35 / 2.6 may be anything from 1.262 to 1.316, 3.18 / 2.6 at most 1.249."""
    claim = {"kind": "ratio", "quantity": A, "to": B, "at_least": "1.30"}
    numbers = [{**VALUE_A, "printed": printed}, {**VALUE_B, "printed": "2.6"}]
    assert verdict(claim, measures(a=[1.0] * 40, b=[1.0] * 40), *numbers)["verdict"] == expected


def test_the_smallest_of_several() -> None:
    claim = {"kind": "smallest", "quantity": A, "than": [B, {"algorithm": "c", "metric": "mean_m"}]}
    data = measures(a=[1.0, 1.0], b=[2.0, 2.0], c=[3.0, 0.5])
    row = verdict(claim, data)
    assert row["rebuilt"] == 0.5


def test_a_limit_of_ours_is_exact() -> None:
    claim = {"kind": "bound", "quantity": A, "at_most": "1.05"}
    data = measures(a=[1.054] * 40)
    assert verdict(claim, data)["verdict"] == "holds"
    assert verdict({**claim, "limit": "assumed"}, data)["verdict"] == "fails"


def test_the_family_is_the_one_asked_for() -> None:
    other = measures(a=np.full(40, 9.0)).assign(family="other")
    data = pd.concat([other, measures(a=FORTY)])
    claim = {"kind": "value", "printed": "3.00", "quantity": A}
    assert verdict(claim, data)["verdict"] == "reproduced"
    assert verdict({**claim, "quantity": {**A, "family": "other"}}, data)["verdict"] == "not reproduced"
    only = verdict(claim, other)
    assert only["verdict"] == "not testable"
    assert "a" in only["reason"]


def test_quantities_without_a_world_in_common_are_told() -> None:
    data = pd.concat([measures(a=[1.0]), measures(b=[2.0]).assign(world=7)])
    assert "no world in common" in verdict({"kind": "ordering", "quantities": [A, B]}, data)["reason"]


def swept(best: list[float], tried: list[float]) -> pd.DataFrame:
    rows = [("f", "s", v, w, "mean_m", float(v != b)) for w, b in enumerate(best) for v in tried]
    return pd.DataFrame(rows, columns=MEASURES)


def test_the_best_setting_is_one_that_was_tried() -> None:
    claim = {"kind": "value", "printed": "4", "quantity": {"sweep": "s", "argmin": "mean_m"}}
    data = swept([8.0] * 30 + [5.0] * 10, [1.0, 4.0, 5.0, 8.0])
    row = verdict(claim, data)
    assert row["verdict"] == "not reproduced"
    assert (row["rebuilt"], row["low"], row["high"]) == (8.0, 5.0, 8.0)
    assert "best in 0 of 40 worlds" in row["reason"]
    assert "at an end of what was tried: 8 in 30" in row["reason"]
    assert verdict({**claim, "printed": "5"}, data)["verdict"] == "reproduced"


def test_a_metric_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(InputError, match="claim c"):
        verdict({"kind": "none", "quantity": {"algorithm": "a", "metric": "nonsense"}}, measures(a=FORTY))


def test_sweeps_give_points_and_the_best_setting() -> None:
    rows = [("f", "s", k, w, "mean_m", (k - 3 - w) ** 2) for k in (1.0, 3.0, 4.0, 5.0) for w in (0, 1)]
    data = pd.DataFrame(rows, columns=MEASURES)
    assert per_world(data, {"sweep": "s", "argmin": "mean_m"}, "f", "c").tolist() == [3.0, 4.0]
    assert per_world(data, {"sweep": "s", "metric": "mean_m", "at": 5}, "f", "c").tolist() == [4.0, 1.0]


def test_of_equal_settings_the_smallest_is_the_best() -> None:
    data = pd.DataFrame([("f", "s", k, 0, "mean_m", 1.0) for k in (5.0, 2.0)], columns=MEASURES)
    assert per_world(data, {"sweep": "s", "argmin": "mean_m"}, "f", "c").tolist() == [2.0]
