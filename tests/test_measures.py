"""Tables and paired differences from raw errors, small enough to check by hand."""

import numpy as np
import pandas as pd
import pytest

from positioning.evaluation.measures import PAIRED, TABLE, measure, paired, published_numbers, table
from positioning.tasks import NOT_ASKED


def errors(values: dict[tuple[str, int], list[float]], value: float = np.nan) -> pd.DataFrame:
    rows = [(f, value, w, s, e) for (f, w), es in values.items() for s, e in enumerate(es)]
    return pd.DataFrame(rows, columns=["family", "value", "world", "sample", "error_m"])


A = errors({("z", 0): [1.0, 3.0], ("z", 1): [2.0, 4.0], ("b", 0): [5.0, 5.0], ("b", 1): [7.0, 9.0]})
B = errors({("z", 0): [2.0, 3.0], ("z", 1): [2.0, 6.0], ("b", 0): [5.0, 4.0], ("b", 1): [8.0, 9.0]})


def metric(frame: pd.DataFrame, name: str) -> list[float]:
    return frame[frame["metric"] == name]["x"].tolist()


def test_one_value_a_world_in_the_order_of_the_families() -> None:
    found = measure(A, "a")
    assert found["family"].unique().tolist() == ["z", "b"]
    assert metric(found, "mean_m") == [2.0, 3.0, 5.0, 8.0]
    assert metric(found, "max_m") == [3.0, 4.0, 5.0, 9.0]


def test_the_order_of_rows_in_files_does_not_matter() -> None:
    shuffled = A[A["family"] == "z"].sample(frac=1, random_state=0)
    pd.testing.assert_frame_equal(measure(shuffled, "a"), measure(A[A["family"] == "z"], "a"))


def test_steps_of_a_sweep_stay_apart() -> None:
    both = pd.concat([errors({("z", 0): [1.0]}, 4.0), errors({("z", 0): [3.0]}, 2.0)])
    found = measure(both, "s")
    assert found[found["metric"] == "mean_m"][["value", "x"]].to_numpy().tolist() == [[2.0, 3.0], [4.0, 1.0]]


def test_table_rows_means_spread_and_reasons() -> None:
    measures = pd.concat([measure(A, "a"), measure(B[B["family"] == "z"], "b")])
    published = {("z", "a"): {"mean_m": "3.1"}}
    found = table(measures, ["b", "a"], ["z", "b"], {("b", "b"): "no walls"}, published)
    assert list(found.columns) == [*TABLE, "published_mean_m", "note"]
    assert found[["family", "algorithm"]].to_numpy().tolist() == [
        ["z", "b"],
        ["z", "a"],
        ["b", "b"],
        ["b", "a"],
    ]
    row = found.iloc[1]
    assert (row["worlds"], row["n"], row["mean_m"]) == (2, 2, 2.5)
    assert row["sd_worlds_m"] == pytest.approx(np.std([2.0, 3.0], ddof=1))
    assert (row["mean_low_m"], row["mean_high_m"]) == (2.0, 3.0)
    assert row["published_mean_m"] == "3.1"
    assert found.iloc[2]["note"] == "no walls"
    assert np.isnan(found.iloc[2]["mean_m"])


def test_a_row_has_no_line_in_a_family_that_it_does_not_name() -> None:
    measures = pd.concat([measure(A, "a"), measure(B[B["family"] == "z"], "b")])
    reasons = {("b", "b"): NOT_ASKED}
    found = table(measures, ["b", "a"], ["z", "b"], reasons, {})
    assert found[["family", "algorithm"]].to_numpy().tolist() == [["z", "b"], ["z", "a"], ["b", "a"]]
    assert (found["note"] == "").all()
    # Any other reason is a line of its own, and no reason at all is one too.
    for others in ({("b", "b"): "no walls"}, {}):
        assert len(table(measures, ["b", "a"], ["z", "b"], others, {})) == 4


def test_pairs_are_worlds_where_there_are_several() -> None:
    found = paired({"a": A, "b": B}, ["a", "b"], ["z", "b"]).set_index(["family", "algorithm"])
    assert list(found.reset_index()[PAIRED].columns) == PAIRED
    row = found.loc[("z", "a")]
    assert (row["difference_m"], row["share_smaller"], row["n"], row["unit"]) == (-0.75, 1.0, 2, "world")
    assert found.loc[("z", "b"), "difference_m"] == 0.75


def test_pairs_are_samples_in_a_single_recording() -> None:
    one = errors({("r", 0): [1.0, 2.0, 3.0]})
    other = errors({("r", 0): [1.0, 3.0, 5.0]})
    row = paired({"a": one, "b": other}, ["a", "b"], ["r"]).iloc[0]
    assert (row["difference_m"], row["n"], row["unit"]) == (-1.0, 3, "sample")
    assert row["share_smaller"] == pytest.approx(2.5 / 3)


def test_published_numbers_are_those_of_rows_not_of_sweeps() -> None:
    claims = [
        {"kind": "value", "printed": "3.06", "quantity": {"algorithm": "a", "metric": "mean_m"}},
        {"kind": "value", "printed": "4", "quantity": {"sweep": "k", "argmin": "mean_m"}},
        {"kind": "none", "quantity": {"algorithm": "a", "metric": "p50_m"}},
    ]
    assert published_numbers(claims, ["z"]) == {("z", "a"): {"mean_m": "3.06"}}


def test_rows_are_paired_at_the_samples_at_which_both_have_an_error() -> None:
    first = errors({("z", 0): [1.0, 2.0, 9.0], ("z", 1): [4.0, 4.0, 4.0]})
    second = errors({("z", 0): [2.0, 2.0], ("z", 1): [5.0, 5.0]})
    row = paired({"a": first, "b": second}, ["a", "b"], ["z"]).iloc[0]
    assert (row["difference_m"], row["n"]) == (-0.75, 2)


def test_rows_of_another_quantity_are_not_paired() -> None:
    found = paired({"a": A, "b": B}, ["a", "b"], ["z"], {"a": "distance", "b": "position"})
    assert found.empty
