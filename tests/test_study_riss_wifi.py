"""The study's own measures with known answers, and the arithmetic of the paper."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

from positioning.evaluation.studies.riss_wifi import measures
from positioning.files import read_yaml

PAPER = read_yaml(ROOT / "data/papers/riss_wifi.yaml")
FAMILY, NAN = "one", np.nan
PATH_M = np.array([[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [NAN, NAN]]])
ASKED_M = np.where(np.array([1, 0, 1, 1, 0], dtype=bool)[None, :, None], PATH_M, NAN)


def printed(claim: str) -> float:
    return next(float(c["printed"]) for c in PAPER["claims"] if c["id"] == claim)


def made(offset_m: list[float], skipped: str = "", **extra: Any) -> pd.DataFrame:
    """Measures of one row whose track lies so far east of the true path."""
    position_m = PATH_M + np.array(offset_m)[None, :, None] * [1.0, 0.0]
    step = {"world": np.array([7]), "value": np.asarray(NAN), "skipped": np.asarray(skipped)}
    step |= {"estimate.position_m": position_m} if not skipped else {}
    step |= {f"estimate.extra_{name}": np.asarray(values) for name, values in extra.items()}
    truth = {"world": np.array([7]), "truth.position_m": ASKED_M, "truth.path_m": PATH_M}
    return measures(
        {"results/estimates/s/row/00000.npz": {f"{FAMILY}/0": step}},
        {"data/s/00000/observed.npz": {FAMILY: {}}, "data/s/00000/truth.npz": {FAMILY: truth}},
    )


def value(frame: pd.DataFrame, metric: str) -> float:
    found = frame[frame["metric"] == metric]
    assert found[["family", "algorithm", "world"]].to_numpy().tolist() == [[FAMILY, "row", 7]]
    return float(found["x"].iloc[0])


def test_shares_and_ends_are_those_of_the_waypoints() -> None:
    frame = made([1.0, 50.0, 3.0, 4.0, 9.0], weight_evaluations=[[10.0, 20.0, NAN, 5.0, NAN]])
    assert value(frame, "within_1m") == pytest.approx(1 / 3)
    assert value(frame, "worst_rms_m") == pytest.approx(np.sqrt((9 + 16) / 2))
    assert value(frame, "final_m") == 4
    assert value(frame, "path_mean_m") == pytest.approx((1 + 50 + 3 + 4) / 4)
    assert value(frame, "weight_evaluations") == 35
    assert value(frame, "first_quarter_m") == 1
    assert value(frame, "first_half_m") == pytest.approx((1 + 50) / 2)
    assert value(frame, "second_half_m") == pytest.approx((3 + 4) / 2)


def test_a_track_that_is_off_by_a_constant_is_smooth() -> None:
    assert value(made([2.0] * 5), "jump_m") == 0
    assert value(made([0.0, 3.0, 0.0, 4.0, 0.0]), "jump_m") == pytest.approx(np.sqrt((9 + 9 + 16) / 3))


def test_what_does_not_exist_is_left_out() -> None:
    frame = made([0.5] * 5)
    assert value(frame, "within_1m") == 1
    assert not frame["metric"].isin(["worst_rms_m", "weight_evaluations"]).any()
    assert made([0.0] * 5, skipped="no survey").empty


def test_the_printed_numbers_of_the_paper_bind_each_other() -> None:
    """What the readings say: the least error of the others, and how many may be within 2 m."""
    rmse = printed("table2.adaptive_fast_mixture.rmse")
    share = printed("accuracy.share")
    least = [np.sqrt((r**2 - share * 1.0) / (1 - share)) for r in (rmse - 0.05, rmse)]
    assert least == pytest.approx([2.38, 2.49], abs=0.005)
    assert least[1] < printed("table2.adaptive_fast_mixture.max")
    for row, most in (("wifi_fos", 0.23), ("wifi_full", 0.48)):
        largest = printed(f"table2.{row}.max")
        half_unit = {"wifi_fos": 0.005, "wifi_full": 0.05}[row]
        squared = (printed(f"table2.{row}.rmse") - half_unit) ** 2
        assert (largest**2 - squared) / (largest**2 - 2.0**2) == pytest.approx(most, abs=0.01)
    reduction = 1 - rmse / printed("table2.wifi_fos.rmse")
    assert reduction == pytest.approx(0.47, abs=0.005)
