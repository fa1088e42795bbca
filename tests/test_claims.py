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
    ledger = judge(claims, data, paper="p", study="s", calibrated=calibrated)
    assert list(ledger.columns) == COLUMNS
    assert set(ledger["verdict"]) <= set(VERDICTS)
    return ledger.iloc[0]


FORTY = np.linspace(2.0, 4.0, 41)


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


def test_a_printed_digit_stands_for_all_numbers_that_round_to_it() -> None:
    edge = FORTY.min()
    for printed, expected in (("1.96", "not reproduced"), ("2.0", "reproduced")):
        claim = {"kind": "value", "printed": printed, "quantity": A}
        assert verdict(claim, measures(a=np.linspace(edge, 4, 39)))["verdict"] == expected


def test_few_worlds_decide_nothing_against_a_paper() -> None:
    claim = {"kind": "value", "printed": "9.00", "quantity": A}
    assert verdict(claim, measures(a=[1, 2, 3, 4]))["verdict"] == "undecided"
    assert verdict({**claim, "printed": "2.50"}, measures(a=[1, 2, 3, 4]))["verdict"] == "reproduced"


def test_what_set_a_parameter_counts_for_nothing() -> None:
    row = verdict({"kind": "value", "printed": "3.00", "quantity": A}, measures(a=FORTY), c="set x = 1")
    assert (row["verdict"], row["reason"]) == ("calibrated", "set x = 1")


@pytest.mark.parametrize(
    ("true", "expected"), [(40, "holds"), (38, "holds"), (37, "depends"), (3, "depends"), (2, "fails")]
)
def test_an_ordering_holds_in_a_share_of_worlds(true: int, expected: str) -> None:
    a = np.where(np.arange(40) < true, 1.0, 3.0)
    row = verdict({"kind": "ordering", "quantities": [A, B]}, measures(a=a, b=np.full(40, 2.0)))
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


@pytest.mark.parametrize(("x", "expected"), [(1.03064, "exact"), (1.03066, "not reproduced")])
def test_exact_means_every_printed_digit(x: float, expected: str) -> None:
    assert (
        verdict({"kind": "exact", "printed": "1.0306", "quantity": A}, measures(a=[x]))["verdict"] == expected
    )


def test_no_number_and_words() -> None:
    assert verdict({"kind": "none", "quantity": A}, measures(a=FORTY))["verdict"] == "none given"
    row = verdict({"kind": "words", "reason": "no number"}, measures(a=FORTY))
    assert (row["verdict"], row["reason"]) == ("not testable", "no number")
    said = verdict({"kind": "words", "reason": "256", "verdict": "contradicts itself"}, measures(a=FORTY))
    assert said["verdict"] == "contradicts itself"


def test_a_row_that_is_not_configured_is_told() -> None:
    row = verdict({"kind": "value", "printed": "1.0", "quantity": B}, measures(a=FORTY))
    assert row["verdict"] == "not testable"
    assert "b" in row["reason"]


def test_a_metric_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(InputError, match="claim c"):
        verdict({"kind": "none", "quantity": {"algorithm": "a", "metric": "nonsense"}}, measures(a=FORTY))


def test_sweeps_give_points_and_the_best_setting() -> None:
    rows = [("f", "s", k, w, "mean_m", (k - 3 - w) ** 2) for k in (1.0, 3.0, 4.0, 5.0) for w in (0, 1)]
    data = pd.DataFrame(rows, columns=MEASURES)
    assert per_world(data, {"sweep": "s", "argmin": "mean_m"}, "c").tolist() == [3.0, 4.0]
    assert per_world(data, {"sweep": "s", "metric": "mean_m", "at": 5}, "c").tolist() == [4.0, 1.0]


def test_of_equal_settings_the_smallest_is_the_best() -> None:
    data = pd.DataFrame([("f", "s", k, 0, "mean_m", 1.0) for k in (5.0, 2.0)], columns=MEASURES)
    assert per_world(data, {"sweep": "s", "argmin": "mean_m"}, "c").tolist() == [2.0]
