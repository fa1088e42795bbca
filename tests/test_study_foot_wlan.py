"""The study's own measures with known answers, the arithmetic of the paper, and what its worlds must show."""

from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

from positioning.evaluation.studies import foot_real
from positioning.evaluation.studies.foot_wlan import measures
from positioning.files import read_yaml
from positioning.geometry import rotated
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.foot_wlan import simulate
from positioning.tasks import tracking

PAPER = read_yaml(ROOT / "data/papers/foot_wlan.yaml")
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["foot_wlan"].items()}
NAN, EPOCHS = np.nan, 9
PATH_M = np.stack([np.arange(EPOCHS, dtype=float), np.zeros(EPOCHS)], axis=-1)[None]
MARKED = np.array([1, 1, 0, 1, 1, 0, 1, 1, 0], dtype=bool)
TRUTH = {
    "world": np.array([7]),
    "truth.position_m": np.where(MARKED[None, :, None], PATH_M, NAN),
    "truth.on_point_m": np.where(~MARKED[None, :, None], PATH_M, NAN),
    "truth.path_m": PATH_M,
    "truth.heading_rad": np.zeros((1, EPOCHS)),
    "truth.stance_time_s": np.array([[[0, 1], [2, 3], [4, 5], [NAN, NAN]]]),
}


def made(rows: dict[str, list[float]], module: Any = measures, **extra: Any) -> pd.DataFrame:
    """Measures of rows whose tracks lie so far north of the true path."""
    estimates = {}
    for row, offset_m in rows.items():
        position_m = PATH_M + np.array(offset_m)[None, :, None] * [0.0, 1.0]
        step = {"world": np.array([7]), "value": np.asarray(NAN), "skipped": np.asarray("")}
        step |= {"estimate.position_m": position_m}
        step |= {f"estimate.extra_{name}": np.asarray(values) for name, values in extra.items()}
        estimates[f"results/estimates/s/{row}/00000.npz"] = {"ring/0": step}
    return module(estimates, {"d/00000/observed.npz": {"ring": {}}, "d/00000/truth.npz": {"ring": TRUTH}})


def value(frame: pd.DataFrame, metric: str, row: str = "row") -> float:
    found = frame[(frame["metric"] == metric) & (frame["algorithm"] == row)]
    assert found[["family", "world"]].to_numpy().tolist() == [["ring", 7]]
    return float(found["x"].iloc[0])


def test_shares_and_laps_are_those_of_the_marks() -> None:
    # At marks 0.2, 0.4, 1.0, 4.5, 1.5, 5.0; at calibration points 2, 3 and 4.
    frame = made({"row": [0.2, 0.4, 2.0, 1.0, 4.5, 3.0, 1.5, 5.0, 4.0]})
    errors = np.array([0.2, 0.4, 1.0, 4.5, 1.5, 5.0])
    assert value(frame, "within_05m") == pytest.approx(2 / 6)
    assert value(frame, "over_4m") == pytest.approx(2 / 6)
    assert value(frame, "about_1m") == pytest.approx(2 / 6)
    assert value(frame, "sd_m") == pytest.approx(errors.std())
    assert value(frame, "on_points_m") == pytest.approx(3)
    assert value(frame, "first_lap_m") == pytest.approx(0.3)
    assert value(frame, "last_lap_m") == pytest.approx(5.0)
    assert "wlan_correlation" not in set(frame["metric"])


def test_errors_are_correlated_with_those_of_wlan() -> None:
    wlan = [1.0, 2, 0, 3, 5, 0, 1, 0, 0]
    frame = made(
        {"wlan": wlan, "row": [2 * x + 1 for x in wlan], "level": [1.0] * 9, "turned": [9 - x for x in wlan]}
    )
    assert value(frame, "wlan_correlation") == pytest.approx(1)
    assert value(frame, "wlan_correlation", "turned") == pytest.approx(-1)
    # An error that does not vary has no correlation, and wlan none with itself.
    assert set(frame[frame["metric"] == "wlan_correlation"]["algorithm"]) == {"row", "turned"}


def test_headings_are_compared_on_the_circle_and_steps_with_strides() -> None:
    frame = made(
        {"row": [0.0] * 9},
        heading_rad=[[2 * np.pi + 0.1] * 4 + [-0.1] * 5],
        step_time_s=[[2.0, 4.0, 4.5, NAN]],
    )
    assert value(frame, "heading_deg") == pytest.approx(np.degrees(0.1))
    assert value(frame, "steps_per_stride") == pytest.approx(3 / 2)


def test_the_shape_of_a_track_does_not_depend_on_its_frame() -> None:
    bent = [0.0, 1, 0, 1, 0, 1, 0, 1, 0]
    frame = made({"row": bent}, foot_real.measures)
    truth = TRUTH["truth.position_m"]
    position_m = PATH_M + np.array(bent)[None, :, None] * [0.0, 1.0]
    step = {"world": np.array([7]), "value": np.asarray(NAN), "skipped": np.asarray("")}
    step["estimate.position_m"] = rotated(position_m, 1.0) + np.array([30.0, -5.0])
    turned = foot_real.measures(
        {"r/row/00000.npz": {"ring/0": step}},
        {"d/00000/observed.npz": {"ring": {}}, "d/00000/truth.npz": {"ring": {"truth.position_m": truth}}},
    )
    assert value(turned, "rigid_mean_m") == pytest.approx(value(frame, "rigid_mean_m"))
    assert 0.3 < value(frame, "rigid_mean_m") < 0.6
    assert value(made({"row": [3.0] * 9}, foot_real.measures), "rigid_mean_m") == pytest.approx(0, abs=1e-9)


def test_the_printed_numbers_are_those_of_the_paper() -> None:
    printed = {c["id"]: c["printed"] for c in PAPER["claims"] if "printed" in c}
    assert printed["wlan.mean"] == "3.1777"
    assert printed["fused.mean"] == "1.6468"
    limits = {c["id"]: (c.get("at_least"), c.get("at_most")) for c in PAPER["claims"] if c["kind"] == "bound"}
    assert limits["wlan.small"] == ("0.2", None)
    assert limits["fused.large"] == (None, "0.05")


def test_what_is_calibrated_does_not_move_the_inertial_rows() -> None:
    """The scan noise reaches the calibrated row alone, and those that listen to WLAN."""
    one, other = (
        simulate(SETTINGS | {"scan_noise_db": noise_db}, [stream(3, "foot_wlan")]).observed
        for noise_db in (2, 9)
    )
    run = factory("foot_inertial", "tracking", {"detector": "shoe"})
    first, second = (
        tracking.run(run, observed, None, {}, [stream(3, "foot")]).estimates["position_m"]
        for observed in (one, other)
    )
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(one["recording.rss_dbm"], other["recording.rss_dbm"], equal_nan=True)


@pytest.mark.slow
def test_strides_are_counted_and_inertial_navigation_alone_stays_near() -> None:
    """With the field's detector; that of the paper misses both limits in these worlds, as the page tells."""
    seeds = range(990_000, 990_020)
    worlds = simulate(SETTINGS, [stream(seed, "foot_wlan") for seed in seeds])
    stances = np.isfinite(worlds.truth["truth.stance_time_s"][..., 0]).sum(axis=1)
    mean_m = {}
    for offset_rad in (0.0, np.radians(10)):
        make = factory(
            "foot_inertial", "tracking", {"detector": "shoe", "misalignment_offset_rad": offset_rad}
        )
        rngs = [stream(seed, "foot") for seed in seeds]
        estimates = tracking.run(make, worlds.observed, None, {}, rngs).estimates
        mean_m[offset_rad] = np.nanmean(tracking.score(estimates, worlds.truth)["error_m"])
        steps = np.isfinite(estimates["extra_step_time_s"]).sum(axis=1) / (stances - 1)
        assert (steps > 0.98).all()
        assert (steps < 1.02).all()
    straight, turned = mean_m.values()
    assert straight < 3
    assert turned > 3
