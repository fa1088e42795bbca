"""The flight study's own measures with known answers, and what the filter must show on its worlds."""

from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from scipy.spatial.transform import Rotation

from algorithms.tracking.flight_gps_inertial import FlightGpsInertial
from algorithms.tracking.flight_slam import FlightSlam
from positioning.evaluation.claims import judge
from positioning.evaluation.measures import MEASURES
from positioning.evaluation.studies import flight_real
from positioning.evaluation.studies.sar_flight import LIMIT_M, SETTLED_S, measures, nees_of
from positioning.evaluation.tracks import Answer, answers
from positioning.files import read_yaml
from positioning.inertial.geodetic import attitude_of, roll_pitch_yaw
from positioning.registry import factory
from positioning.seeds import stream
from positioning.simulation.sar_flight import simulate
from positioning.tasks import tracking

PAPER = read_yaml(ROOT / "data/papers/robo_sar.yaml")
SETTINGS = {name: setting["value"] for name, setting in PAPER["settings"]["sar_flight"].items()}
FAMILIES = {
    name: {setting: value for setting, value in family.items() if setting != "meaning"}
    for name, family in read_yaml(ROOT / "config/config.yaml")["studies"]["sar_flight"]["families"].items()
}
FIRST_SEED, WORLDS = 790_000, 24
"""Seeds of no study."""

NAN = np.nan
TIME_S = np.arange(0.0, 101.0, 10.0)
EPOCHS, BEGIN_S, END_S = len(TIME_S), 50.0, 80.0
PATH_M = np.stack([2.0 * TIME_S, 100.0 - TIME_S], axis=-1)
HEIGHT_M = np.full(EPOCHS, 9.0)
VELOCITY = np.tile([-1.0, 2.0, 0.0], (EPOCHS, 1))
ATTITUDE_RAD = np.tile([0.1, -0.2, 2.0], (EPOCHS, 1))
OBSERVED = {
    "world": np.array([7]),
    "recording.time_s": TIME_S[None],
    "recording.gps_outage_s": np.array([[BEGIN_S, END_S]]),
}
TRUTH = {
    "world": np.array([7]),
    "truth.position_m": PATH_M[None],
    "truth.height_m": HEIGHT_M[None],
    "truth.velocity_m_per_s": VELOCITY[None],
    "truth.attitude_rad": ATTITUDE_RAD[None],
}
EXACT = {
    "height_m": HEIGHT_M[None],
    "velocity_m_per_s": VELOCITY[None],
    "attitude_rad": ATTITUDE_RAD[None],
    "covariance_9": np.tile(np.eye(9), (1, EPOCHS, 1, 1)),
}


def trees(off_m: Any, row: str, value: float, extra: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Archives of a row whose track lies so far east of the path, and of its world."""
    position_m = PATH_M[None] + np.asarray(off_m, dtype=float)[..., None] * [1.0, 0.0]
    step = {"world": np.array([7]), "value": np.asarray(value), "skipped": np.asarray("")}
    step |= {"estimate.position_m": position_m}
    step |= {f"estimate.extra_{name}": np.asarray(values) for name, values in extra.items()}
    return (
        {f"results/estimates/s/{row}/00000.npz": {"white/0": step}},
        {"d/00000/observed.npz": {"white": OBSERVED}, "d/00000/truth.npz": {"white": TRUTH}},
    )


def made(off_m: Any, row: str = "row", value: float = NAN, **extra: Any) -> pd.DataFrame:
    return measures(*trees(off_m, row, value, extra))


def answer(**extra: Any) -> Answer:
    return next(answers(*trees(np.zeros(EPOCHS), "row", NAN, EXACT | extra)))


def value_of(frame: pd.DataFrame, metric: str) -> float:
    found = frame[frame["metric"] == metric]
    assert found[["family", "world"]].to_numpy().tolist() == [["white", 7]]
    return float(found["x"].iloc[0])


OFF_M = np.array([50.0, 40.0, 30.0, 1.0, 2.0, 3.0, 2.0, 5.0, 1.0, 7.0, 90.0])
"""At 0, 10, ..., 100 s."""


def test_the_outage_begins_after_its_begin_and_ends_with_its_end() -> None:
    frame = made(OFF_M)
    # At 60, 70 and 80 s.
    assert value_of(frame, "outage_mean_m") == pytest.approx((2 + 5 + 1) / 3)
    assert value_of(frame, "outage_max_m") == pytest.approx(5)
    assert value_of(frame, "outage_final_m") == pytest.approx(1)
    assert value_of(frame, "outage_below_limit") == pytest.approx(2 / 3)
    # At 30, 40 and 50 s: settled, and GPS is still there.
    assert SETTLED_S == 30.0
    assert value_of(frame, "gps_mean_m") == pytest.approx(2)
    assert value_of(frame, "gps_rms_m") == pytest.approx(np.sqrt((1 + 4 + 9) / 3))


@pytest.mark.parametrize(
    ("length_s", "inside_m"), [(10.0, [2]), (20.0, [2, 5]), (40.0, [2, 5, 1, 7]), (50.0, [2, 5, 1, 7, 90])]
)
def test_a_sweep_over_the_outage_changes_its_length_and_not_its_begin(
    length_s: float, inside_m: list[float]
) -> None:
    frame = made(OFF_M, "outage_anything", length_s)
    assert value_of(frame, "outage_mean_m") == pytest.approx(np.mean(inside_m))
    assert value_of(frame, "outage_max_m") == pytest.approx(max(inside_m))
    assert value_of(frame, "outage_final_m") == pytest.approx(inside_m[-1])
    assert value_of(frame, "gps_mean_m") == pytest.approx(2)
    assert (frame["value"] == length_s).all()


def test_a_sweep_over_something_else_leaves_the_outage() -> None:
    assert value_of(made(OFF_M, "noise_gps", 100.0), "outage_mean_m") == pytest.approx(8 / 3)


@pytest.mark.parametrize(("begin_s", "end_s"), [(61.0, 69.0), (NAN, NAN), (200.0, 240.0)])
def test_an_outage_without_an_epoch_has_no_error(begin_s: float, end_s: float) -> None:
    estimates, worlds = trees(OFF_M, "row", NAN, EXACT)
    observed = OBSERVED | {"recording.gps_outage_s": np.array([[begin_s, end_s]])}
    worlds["d/00000/observed.npz"] = {"white": observed}
    for frame in (measures(estimates, worlds), flight_real.measures(estimates, worlds)):
        assert not frame["metric"].str.startswith("outage").any()


def test_a_recording_has_the_errors_in_its_outage_where_its_truth_is_known() -> None:
    height_m = HEIGHT_M + np.array([0, 0, 0, 0, 0, 0, 1.0, -4.0, 2.0, 0, 99.0])
    estimates, worlds = trees(OFF_M, "row", NAN, EXACT | {"height_m": height_m[None]})
    frame = flight_real.measures(estimates, worlds)
    whole = measures(estimates, worlds)
    assert sorted(frame["metric"]) == [
        "outage_final_m",
        "outage_height_m",
        "outage_max_m",
        "outage_mean_m",
    ]
    for metric in frame["metric"]:
        assert value_of(frame, metric) == value_of(whole, metric)
    # Without a true place at 80 s the last error is that at 70 s.
    true_m = PATH_M.copy()
    true_m[8] = NAN
    worlds["d/00000/truth.npz"] = {"white": TRUTH | {"truth.position_m": true_m[None]}}
    frame = flight_real.measures(estimates, worlds)
    assert value_of(frame, "outage_mean_m") == pytest.approx(3.5)
    assert value_of(frame, "outage_final_m") == pytest.approx(5)


def test_innovations_of_a_drive_are_told_with_and_without_an_outage() -> None:
    estimates, worlds = trees(OFF_M, "row", NAN, {"nis_gps": [0.05]})
    assert value_of(flight_real.measures(estimates, worlds), "nis_gps") == 0.05
    whole = {name: values for name, values in OBSERVED.items() if name != "recording.gps_outage_s"}
    worlds["d/00000/observed.npz"] = {"white": whole}
    frame = flight_real.measures(estimates, worlds)
    assert frame["metric"].tolist() == ["nis_gps"]


def test_a_track_lags_by_the_time_that_it_is_behind() -> None:
    # The robot flies 2 m/s east and 1 m/s south; the row stands 3, 1 and 2 m east of where it is.
    lag_s = -np.mean([1.0, 2.0, 3.0]) * 2 / 5
    assert value_of(made(OFF_M), "gps_lag_s") == pytest.approx(lag_s)
    late_m = np.stack([-2.0 * np.full(EPOCHS, 0.7), np.full(EPOCHS, 0.7)], axis=-1)
    estimates, worlds = trees(np.zeros(EPOCHS), "row", NAN, {})
    (step,) = (tree["white/0"] for tree in estimates.values())
    step["estimate.position_m"] = PATH_M[None] + late_m
    assert value_of(measures(estimates, worlds), "gps_lag_s") == pytest.approx(0.7)
    still = TRUTH | {"truth.velocity_m_per_s": np.zeros((1, EPOCHS, 3))}
    worlds["d/00000/truth.npz"] = {"white": still}
    assert "gps_lag_s" not in set(measures(estimates, worlds)["metric"])


@pytest.mark.parametrize(
    ("claim_id", "lags_s"),
    [
        ("flight.lag.large", {-0.21: False, -0.19: True, 0.0: True, 0.19: True, 0.21: False}),
        ("flight.lag.small", {-0.3: False, 0.04: False, 0.06: True, 3.0: True}),
    ],
)
def test_a_lag_is_judged_at_one_point_of_the_sweep(claim_id: str, lags_s: dict[float, bool]) -> None:
    (claim,) = [c for c in PAPER["claims"] if c["id"] == claim_id]
    tried = read_yaml(ROOT / "config/config.yaml")["studies"]["sar_flight"]["sweeps"]["noise_gps"]["over"]
    assert claim["quantity"]["at"] in tried["noise_factor"]
    for lag_s, met in lags_s.items():
        frame = pd.DataFrame(
            [
                ("white", "noise_gps", factor, world, "gps_lag_s", lag_s if own else 9.0 * (-1) ** world)
                for factor in tried["noise_factor"]
                for own in [factor == claim["quantity"]["at"]]
                for world in range(WORLDS)
            ],
            columns=MEASURES,
        )
        ledger = judge([claim], frame, paper="p", study="s", family="white", calibrated={})
        assert ledger["rebuilt"].tolist() == [float(met)]
        assert ledger["verdict"].tolist() == ["holds" if met else "fails"]


def test_the_share_below_the_limit_counts_epochs_of_the_outage() -> None:
    assert value_of(made(np.full(EPOCHS, LIMIT_M - 0.01)), "outage_below_limit") == 1
    assert value_of(made(np.full(EPOCHS, LIMIT_M + 0.01)), "outage_below_limit") == 0


def test_the_limit_is_that_of_the_claims() -> None:
    limits = {c["at_most"] for c in PAPER["claims"] if c["id"].startswith("flight.landing")}
    assert limits == {str(LIMIT_M)}


def test_heights_and_innovations_and_condition() -> None:
    height_m = HEIGHT_M + np.array([0, 0, 0, 0, 0, 0, 1.0, -4.0, 2.0, 0, 99.0])
    frame = made(
        OFF_M,
        **(EXACT | {"height_m": height_m[None]}),
        nis_gps=[1.2],
        nis_fix=[NAN],
        innovation_condition=[1e5],
    )
    assert value_of(frame, "outage_height_m") == pytest.approx(4)
    assert value_of(frame, "nis_gps") == 1.2
    assert value_of(frame, "condition") == pytest.approx(5)
    # No fix came: there is no value, which is not the same as a value of zero.
    assert not frame["metric"].isin(["nis_fix", "nis_sighting"]).any()


def test_what_a_row_does_not_tell_is_left_out() -> None:
    assert not made(OFF_M)["metric"].isin(["gps_nees", "outage_nees", "outage_height_m", "condition"]).any()


def test_a_right_answer_has_no_error_squared() -> None:
    np.testing.assert_allclose(nees_of(answer()), 0, atol=1e-20)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("state", "name", "off"),
    [
        (0, "north", [0.0, 0.6]),
        (1, "east", [0.6, 0.0]),
        (2, "height", -0.6),
        (3, "velocity_m_per_s", [0.6, 0.0, 0.0]),
        (5, "velocity_m_per_s", [0.0, 0.0, 0.6]),
    ],
)
def test_position_and_velocity_are_weighed_by_their_own_variance(
    state: int, name: str, off: Any, sign: float
) -> None:
    """North, east and down; the height is up."""
    variance = np.arange(1.0, 10.0)
    changed: dict[str, Any] = {"covariance_9": np.tile(np.diag(variance), (1, EPOCHS, 1, 1))}
    if name == "height":
        changed["height_m"] = EXACT["height_m"] + sign * off
    elif name == "velocity_m_per_s":
        changed[name] = EXACT[name] + sign * np.asarray(off)
    found = answer(**changed)
    if name in ("north", "east"):
        estimates = {**found.estimates, "position_m": found.estimates["position_m"] + sign * np.array(off)}
        found = found._replace(estimates=estimates)
    np.testing.assert_allclose(nees_of(found), 0.36 / variance[state])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_correlated_position_and_height_tell_the_sign_of_down(sign: float) -> None:
    """North and down too large together are likely where they are correlated, and unlikely otherwise."""
    covariance = np.eye(9)
    covariance[0, 2] = covariance[2, 0] = 0.8 * sign
    found = answer(covariance_9=np.tile(covariance, (1, EPOCHS, 1, 1)), height_m=EXACT["height_m"] - 0.5)
    north = {**found.estimates, "position_m": found.estimates["position_m"] + [0.0, 0.5]}
    np.testing.assert_allclose(
        nees_of(found._replace(estimates=north)), 2 * (0.25 - sign * 0.8 * 0.25) / (1 - 0.64)
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_attitude_error_has_the_convention_of_the_filter(axis: int, sign: float) -> None:
    """The navigated attitude is (I - E) C: an error of either sign, correlated with the velocity."""
    turned = np.zeros(3)
    turned[axis] = sign * 0.05
    true = attitude_of(ATTITUDE_RAD)
    navigated = Rotation.from_rotvec(-turned).as_matrix() @ true
    covariance = np.eye(9)
    covariance[3, 6 + axis] = covariance[6 + axis, 3] = 0.8
    found = answer(
        attitude_rad=roll_pitch_yaw(navigated)[None],
        velocity_m_per_s=EXACT["velocity_m_per_s"] + [0.05, 0.0, 0.0],
        covariance_9=np.tile(covariance, (1, EPOCHS, 1, 1)),
    )
    # The two errors agree in sign where the filter says so.
    np.testing.assert_allclose(nees_of(found), 2 * 0.05**2 * (1 - sign * 0.8) / (1 - 0.64), rtol=1e-9)
    skew = np.cross(np.eye(3), turned)
    np.testing.assert_allclose((np.eye(3) - skew) @ true, navigated, atol=2e-3)


def test_an_epoch_that_is_not_known_has_no_error_squared_and_spoils_no_other() -> None:
    height_m = EXACT["height_m"].copy()
    height_m[0, 4] = NAN
    nees = nees_of(answer(height_m=height_m))
    assert np.isnan(nees[0, 4])
    assert np.isfinite(np.delete(nees[0], 4)).all()


def test_nees_is_averaged_under_gps_and_in_the_outage_apart() -> None:
    scale = np.array([NAN, NAN, NAN, 1.0, 2.0, 4.0, 1.0, 0.5, 0.25, NAN, NAN])
    covariance = EXACT["covariance_9"] / np.where(np.isnan(scale), 1e-9, scale)[None, :, None, None]
    frame = made(np.full(EPOCHS, 3.0), **(EXACT | {"covariance_9": covariance}))
    assert value_of(frame, "gps_nees") == pytest.approx(9 * 7 / 3)
    assert value_of(frame, "outage_nees") == pytest.approx(9 * 1.75 / 3)


@cache
def flown(row: str, family: str) -> pd.DataFrame:
    """Measures of a row on worlds drawn like those of the study."""
    seeds = range(FIRST_SEED, FIRST_SEED + WORLDS)
    worlds = simulate({**SETTINGS, **FAMILIES[family]}, [stream(seed, "sar_flight") for seed in seeds])
    outcome = tracking.run(
        factory(row, "tracking", {}),
        worlds.observed,
        None,
        {},
        [stream(seed, "sar_flight", row) for seed in seeds],
    )
    index = {"world": np.arange(WORLDS)}
    step: dict[str, Any] = {**index, "value": np.asarray(NAN), "skipped": np.asarray(outcome.skipped)}
    step |= {f"estimate.{name}": values for name, values in outcome.estimates.items()}
    return measures(
        {f"e/{row}/00000.npz": {f"{family}/0": step}},
        {
            "d/00000/observed.npz": {family: index | worlds.observed},
            "d/00000/truth.npz": {family: index | worlds.truth},
        },
    )


def mean_of(row: str, family: str, metric: str) -> float:
    frame = flown(row, family)
    values = frame.loc[frame["metric"] == metric, "x"]
    assert len(values) == WORLDS
    return float(values.mean())


@pytest.mark.slow
@pytest.mark.parametrize("row", ["flight_gps_inertial", "flight_slam"])
def test_with_white_noise_alone_the_filter_is_consistent(row: str) -> None:
    assert 7.5 < mean_of(row, "ideal", "gps_nees") < 11
    for sensor in ("gps", "sighting") if row == "flight_slam" else ("gps",):
        assert 0.93 < mean_of(row, "ideal", f"nis_{sensor}") < 1.07, sensor


@pytest.mark.slow
def test_biases_that_nine_states_do_not_know_show_in_the_consistency() -> None:
    assert mean_of("flight_gps_inertial", "white", "gps_nees") > 100


def test_the_seeds_are_apart_from_those_of_the_study_and_the_filter_models_ideal_worlds() -> None:
    study = read_yaml(ROOT / "config/config.yaml")["studies"]["sar_flight"]
    assert study["first_seed"] + study["worlds"] <= FIRST_SEED
    # What the filter takes for granted is what the ideal worlds have.
    for algorithm in (FlightGpsInertial(), FlightSlam()):
        settings = algorithm.settings()
        density = SETTINGS["accelerometer_noise_density_m_per_s2_sqrt_hz"]
        assert settings.force_noise_m_per_s2_per_rt_hz == density
        turn = np.radians(SETTINGS["gyro_noise_density_deg_per_s_sqrt_hz"])
        assert settings.rate_noise_rad_per_s_per_rt_hz == pytest.approx(turn, rel=0.01)
        assert list(settings.gps_sigma_m) == SETTINGS["gps_white_m"]
        assert list(settings.gps_velocity_sigma_m_per_s) == SETTINGS["gps_velocity_m_per_s"]
    zero = {name for name, value in FAMILIES["ideal"].items() if not np.any(value)}
    assert zero == set(FAMILIES["ideal"])
