"""The adapters of recordings by robots: facts of their descriptions, defects, frames, motion, refusals."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat, savemat
from sklearn.neighbors import KNeighborsRegressor

from positioning.errors import InputError
from positioning.filters.plane import check_stack
from positioning.model import Recording, Site, Survey
from positioning.recordings import ble_flat_robot, robot_range_odometry, robot_rssi_odometry
from positioning.recordings.register import find_file, read_register
from positioning.recordings.robot_range_odometry import motion_between

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
RANGES = REALDATA / "robot_range_odometry"
NODES = REALDATA / "robot_rssi_odometry"
FLAT = REALDATA / "ble_flat_robot"


def needs(folder):
    return pytest.mark.skipif(not folder.is_dir(), reason=f"no recordings in {folder} (REPOSITION_REALDATA)")


def other_run(name):
    return "exp4" if name == "exp3" else "exp3"


CASES = [
    *(
        pytest.param(robot_range_odometry, RANGES, {"name": name, **options}, marks=needs(RANGES))
        for name in ("plaza1", "labyrinth")
        for options in ({}, {"window_s": 0.05}, {"offset_from_first_s": 10.0})
    ),
    *(
        pytest.param(
            robot_rssi_odometry, NODES, {"name": name, "calibration": other_run(name)}, marks=needs(NODES)
        )
        for name in robot_rssi_odometry.RUNS
    ),
    *(pytest.param(ble_flat_robot, FLAT, {"run": run}, marks=needs(FLAT)) for run in (1, 2, 3, 4)),
]

MOTION = ("turn_before_rad", "advance_m", "turn_after_rad")


def driven_m(observed, heading_rad=0.0):
    """Dead reckoning from the origin along the turns and advances, [n] complex metres."""
    before_rad, advance_m, after_rad = (observed[f"recording.{name}"][0] for name in MOTION)
    turned_rad = heading_rad + np.cumsum(before_rad + after_rad)
    course_rad = turned_rad - after_rad
    return np.cumsum(advance_m * np.exp(1j * course_rad))


def turned_rad(observed):
    return np.cumsum(observed["recording.turn_before_rad"][0] + observed["recording.turn_after_rad"][0])


def true_way_m(truth):
    """The true path from its first place, [n] complex metres."""
    place_m = truth["truth.position_m"][0]
    return (place_m - place_m[0]) @ [1, 1j]


def path_m(truth):
    return np.abs(np.diff(true_way_m(truth))).sum()


def fitted_rms_m(driven, way):
    """How far dead reckoning is from the truth with the best of all start headings."""
    return np.sqrt(np.mean(np.abs(driven * np.exp(1j * np.angle(np.vdot(driven, way))) - way) ** 2))


def path_loss(distance_m, rss_dbm):
    heard = np.isfinite(rss_dbm)
    slope, level_dbm = np.polyfit(np.log10(distance_m[heard]), rss_dbm[heard], 1)
    residual_db = rss_dbm[heard] - level_dbm - slope * np.log10(distance_m[heard])
    return level_dbm, -slope / 10, residual_db.std()


# ---- all three


@pytest.mark.parametrize(("adapter", "folder", "options"), CASES)
def test_one_world_of_the_agreed_arrays(adapter, folder, options):
    observed, truth = adapter.load(folder, **options)
    epochs, beacons = truth["truth.distance_m"].shape[1:]
    shapes = {
        "site.corner_m": (1, 2, 2),
        "site.access_point_m": (1, beacons, 2),
        "recording.time_s": (1, epochs),
    }
    if adapter is not robot_range_odometry:
        (_, pairs) = observed["calibration.rss_dbm"].shape
        shapes |= dict.fromkeys(("calibration.distance_m", "calibration.rss_dbm"), (1, pairs))
        shapes["recording.rss_dbm"] = (1, epochs, beacons)
    else:
        shapes["recording.range_m"] = (1, epochs, beacons)
    if adapter is not robot_range_odometry:
        (_, places, _) = observed["survey.position_m"].shape
        shapes |= {"survey.position_m": (1, places, 2), "survey.rss_dbm": (1, places, beacons)}
    if adapter is not ble_flat_robot:
        (_, readings) = observed["recording.motion_time_s"].shape
        shapes |= {f"recording.{name}": (1, epochs) for name in MOTION}
        shapes |= {
            f"recording.{name}": (1, readings)
            for name in ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s")
        }
        shapes |= {"recording.start_heading_rad": (1,), "recording.start_position_m": (1, 2)}
    else:
        (_, points, _) = observed["survey.rss_dbm"].shape
        shapes |= {
            "survey.rss_dbm": (1, points, 6),
            "survey.position_m": (1, points, 2),
            "site.wall_m": (1, 37, 2, 2),
        }
    assert {name: values.shape for name, values in observed.items()} == shapes
    assert {name: values.shape for name, values in truth.items()} == {
        "truth.position_m": (1, epochs, 2),
        "truth.distance_m": (1, epochs, beacons),
    }
    gaps = ("recording.rss_dbm", "recording.range_m", "survey.rss_dbm", "recording.start_heading_rad")
    for name, values in {**observed, **truth}.items():
        assert values.dtype == float
        assert name in gaps or np.isfinite(values).all(), name
    # What the trackers ask of a recording.
    assert_array_equal(check_stack(Recording.from_arrays(observed), Site.from_arrays(observed)), [epochs])
    offset_m = truth["truth.position_m"][0][:, None] - observed["site.access_point_m"][0]
    assert_allclose(truth["truth.distance_m"][0], np.hypot(offset_m[..., 0], offset_m[..., 1]), atol=1e-9)
    for name in ("calibration.rss_dbm", "recording.rss_dbm", "survey.rss_dbm"):
        if name in observed:
            assert -96 < np.nanmin(observed[name]) < np.nanmax(observed[name]) < -15
            assert (observed.get("calibration.distance_m") > 0).all()


@pytest.mark.parametrize(
    ("adapter", "folder", "every"),
    [
        pytest.param(
            robot_range_odometry,
            RANGES,
            [{"name": name} for name in robot_range_odometry.NAMES],
            marks=needs(RANGES),
        ),
        pytest.param(
            robot_rssi_odometry,
            NODES,
            [{"name": name, "calibration": other_run(name)} for name in robot_rssi_odometry.RUNS],
            marks=needs(NODES),
        ),
        pytest.param(ble_flat_robot, FLAT, [{}], marks=needs(FLAT)),
    ],
)
def test_the_register_has_the_files_that_are_read_and_no_other(monkeypatch, adapter, folder, every):
    read = set()

    def noted(where, file):
        read.add(file)
        return find_file(where, file)

    monkeypatch.setattr(adapter, "find_file", noted)
    for options in every:
        adapter.load(folder, **options)
    assert read == {record.file for record in read_register() if record.source == folder.name}


@pytest.mark.parametrize(
    ("adapter", "options", "words"),
    [
        (robot_range_odometry, {"name": "plaza2"}, ["option name", "'plaza2'", "plaza1, labyrinth"]),
        (robot_range_odometry, {"window_s": 0.0}, ["option window_s", "0.0 is no positive length"]),
        (robot_range_odometry, {"window_s": float("nan")}, ["option window_s", "nan is no positive"]),
        (robot_range_odometry, {"offset_from_first_s": -1.0}, ["offset_from_first_s", "-1.0 is no length"]),
        (robot_range_odometry, {"offset_from_first_s": float("inf")}, ["offset_from_first_s", "inf is no"]),
        (robot_range_odometry, {}, ["Plaza1.mat", "no such file"]),
        (robot_range_odometry, {"name": "labyrinth"}, ["labyrinth_Indoor_UWB_Input.txt", "no such file"]),
        (robot_rssi_odometry, {"name": "exp5"}, ["option name", "'exp5'", "exp1, exp2, exp2.1"]),
        (robot_rssi_odometry, {"calibration": "exp5"}, ["option calibration", "'exp5'"]),
        (robot_rssi_odometry, {"name": "exp3"}, ["option calibration", "exp3 is the run itself"]),
        (robot_rssi_odometry, {}, ["combined_sync_data_exp2.csv", "no such file"]),
        (ble_flat_robot, {"run": 5}, ["option run", "5 is none of 1, 2, 3, 4"]),
        (ble_flat_robot, {"window_s": -1.0}, ["option window_s", "-1.0 is no positive length"]),
        (ble_flat_robot, {"cell_m": 0.0}, ["option cell_m", "0.0 is no positive length"]),
        (ble_flat_robot, {}, ["anchors.csv", "no such file"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path, adapter, options, words):
    with pytest.raises(InputError) as caught:
        adapter.load(tmp_path, **options)
    assert all(word in str(caught.value) for word in words)


# ---- motion between epochs


STEPS = st.lists(
    st.tuples(st.floats(-1.5, 1.5), st.floats(-0.5, 0.5), st.floats(0.05, 2.0)), min_size=1, max_size=30
)


@settings(max_examples=300, deadline=None)
@given(steps=STEPS, data=st.data())
def test_turn_advance_turn_leads_where_the_odometry_leads(steps, data):
    turn_rad, forward_m, duration_s = np.array(steps).T
    time_s = np.concatenate([[0.0], np.cumsum(duration_s)])
    epoch_s = np.array(
        sorted(data.draw(st.sets(st.floats(0.0, float(time_s[-1])), min_size=2, max_size=10), label="epochs"))
    )
    before_rad, advance_m, after_rad = motion_between(epoch_s, time_s, turn_rad, forward_m)
    assert before_rad[0] == advance_m[0] == after_rad[0] == 0
    assert (np.abs(before_rad) <= np.pi / 2 + 1e-9).all()

    # Step by step, with complex numbers.
    place, heading = [0j], [0.0]
    for turn, forward in zip(turn_rad, forward_m, strict=True):
        place.append(place[-1] + forward * np.exp(1j * (heading[-1] + turn / 2)))
        heading.append(heading[-1] + turn)
    expected = np.interp(epoch_s, time_s, np.real(place)) + 1j * np.interp(epoch_s, time_s, np.imag(place))
    expected_rad = np.interp(epoch_s, time_s, heading)
    place_m, heading_rad = expected[0], expected_rad[0]
    for epoch in range(1, len(epoch_s)):
        place_m += advance_m[epoch] * np.exp(1j * (heading_rad + before_rad[epoch]))
        heading_rad += before_rad[epoch] + after_rad[epoch]
        assert abs(place_m - expected[epoch]) < 1e-9
        assert abs(heading_rad - expected_rad[epoch]) < 1e-9


def test_motion_of_a_quarter_circle_a_way_back_and_a_rest():
    time_s = np.linspace(0, 1, 1001)
    turn_rad, forward_m = np.full(1000, np.pi / 2 / 1000), np.full(1000, 3 * np.pi / 2 / 1000)
    ends_s = np.array([0.0, 1.0])
    # A chord of the quarter circle of radius 3 m to the left: 45 degrees from the start heading.
    for sign in (1, -1):
        before_rad, advance_m, after_rad = motion_between(ends_s, time_s, turn_rad, sign * forward_m)
        assert_allclose(advance_m, [0, sign * 3 * np.sqrt(2)], rtol=1e-6)
        assert_allclose([before_rad, after_rad], [[0, np.pi / 4]] * 2, rtol=1e-9)
    before_rad, advance_m, after_rad = motion_between(ends_s, time_s, 4 * turn_rad, 0 * forward_m)
    assert_allclose([before_rad, advance_m, after_rad], [[0, 0], [0, 0], [0, 2 * np.pi]], atol=1e-12)
    # Beyond its times the robot stands.
    _, advance_m, _ = motion_between(np.array([-1.0, 0.0, 1.0, 5.0]), time_s, 0 * turn_rad, forward_m)
    assert_allclose(advance_m, [0, 0, 3 * np.pi / 2, 0], atol=1e-12)


# ---- robots with ranges


def raw_plaza():
    return loadmat(RANGES / "Plaza1.mat")


def range_error_m(observed, truth):
    error_m = observed["recording.range_m"][0] - truth["truth.distance_m"][0]
    return error_m[np.isfinite(error_m)]


@needs(RANGES)
def test_plaza_has_the_counts_and_the_bias_of_its_description():
    # So short a window leaves nearly every range an epoch of its own.
    observed, truth = robot_range_odometry.load(RANGES, window_s=1e-3)
    error_m = range_error_m(observed, truth)
    assert observed["recording.gyro_rad_per_s"].shape == (1, 9658 - 1)
    assert 3529 - 3 <= len(error_m) <= 3529
    assert_allclose([error_m.mean(), error_m.std()], [2.79, 1.15], atol=0.006)
    distance_m = truth["truth.distance_m"][0][np.isfinite(observed["recording.range_m"][0])]
    slope, level_m = np.polyfit(distance_m, error_m, 1)
    assert_allclose([slope, level_m], [0.069, 0.03], atol=0.01)
    # In windows of a second the robot drives on, but the picture is the same.
    error_m = range_error_m(*robot_range_odometry.load(RANGES))
    assert_allclose([error_m.mean(), error_m.std()], [2.80, 1.13], atol=0.006)


@needs(RANGES)
def test_plaza_beacons_are_those_of_the_numbers_not_of_the_rows():
    assert_array_equal(raw_plaza()["TL"][:, 0], [0, 1, 6, 5])
    observed, truth = robot_range_odometry.load(RANGES, window_s=0.05)
    expected_m = [[-46.623, 11.026], [11.036, -6.959], [-17.665, 59.009], [22.053, 23.848]]
    assert_allclose(observed["site.access_point_m"][0], expected_m, atol=5e-4)
    for beacon in range(4):
        error_m = (observed["recording.range_m"] - truth["truth.distance_m"])[0, :, beacon]
        assert_allclose(np.nanmean(error_m), 2.79, atol=0.2)
        assert np.nanstd(error_m) < 1.3
    swapped_m = observed["recording.range_m"][0][:, [0, 1, 3, 2]] - truth["truth.distance_m"][0]
    assert np.nanstd(swapped_m[:, 2:]) > 10


@needs(RANGES)
def test_plaza_ranges_out_of_order_come_to_their_own_times():
    time_s = raw_plaza()["TD"][:, 0]
    assert np.count_nonzero(np.diff(time_s) < 0) == 2
    assert np.diff(time_s).min() < -60
    observed, truth = robot_range_odometry.load(RANGES, window_s=0.05)
    epoch_s = observed["recording.time_s"][0]
    assert (np.diff(epoch_s) > 0).all()
    # The stretches that stood in the wrong place fit the path at their own times.
    start_s = raw_plaza()["GT"][0, 0]
    moved = (epoch_s > 5039 - start_s) & (epoch_s < 5103 - start_s)
    error_m = (observed["recording.range_m"] - truth["truth.distance_m"])[0, moved]
    assert np.isfinite(error_m).sum() > 100
    assert np.nanstd(error_m) < 1.3


@needs(RANGES)
def test_plaza_offset_of_the_first_part_is_taken_off_the_rest():
    first_s = 200.0
    raw, raw_truth = robot_range_odometry.load(RANGES)
    observed, truth = robot_range_odometry.load(RANGES, offset_from_first_s=first_s)
    kept = raw["recording.time_s"][0] >= first_s
    assert 0.05 < np.mean(~kept) < 0.15
    assert_allclose(observed["recording.time_s"][0], raw["recording.time_s"][0, kept])
    assert_array_equal(truth["truth.position_m"][0], raw_truth["truth.position_m"][0, kept])
    offset_m = (raw["recording.range_m"][0, kept] - observed["recording.range_m"][0]).ravel()
    assert_allclose(offset_m[np.isfinite(offset_m)], np.nanmean(offset_m), atol=1e-9)
    # It is the mean over single ranges: in windows of a second it is nearly the same.
    first_m = (raw["recording.range_m"] - raw_truth["truth.distance_m"])[0, ~kept]
    assert_allclose(np.nanmean(offset_m), np.nanmean(first_m), atol=0.05)
    error_m = range_error_m(observed, truth)
    assert abs(error_m.mean()) < 0.15
    assert_allclose(error_m.std(), 1.10, atol=0.03)
    # The motion has no second reason to begin late, and the start is that of the epochs.
    assert_array_equal(observed["recording.motion_time_s"], raw["recording.motion_time_s"])
    assert_array_equal(observed["recording.start_position_m"], truth["truth.position_m"][:, 0])
    way_m = true_way_m(truth)
    assert_allclose(
        np.angle(driven_m(observed, observed["recording.start_heading_rad"][0])[60]),
        np.angle(way_m[60]),
        atol=0.1,
    )
    for seconds in (1.0, 1e9):
        with pytest.raises(InputError, match=rf"the first {seconds} s hold (0|3529) of 3529 ranges"):
            robot_range_odometry.load(RANGES, offset_from_first_s=seconds)


@needs(RANGES)
def test_plaza_odometry_keeps_to_the_path_in_the_frame_of_the_beacons():
    pose, step, reckoned = (raw_plaza()[key] for key in ("GT", "DR", "DRp"))
    observed, truth = robot_range_odometry.load(RANGES)
    way_m = true_way_m(truth)
    offset_m = np.abs(driven_m(observed, observed["recording.start_heading_rad"][0]) - way_m)
    assert_allclose([offset_m[-1], np.sqrt(np.mean(offset_m**2))], [4.45, 2.01], atol=0.02)
    # The file's own dead reckoning ends elsewhere.
    assert_allclose(np.linalg.norm(reckoned[-1, 1:3] - pose[-1, 1:3]), 36.9, atol=0.05)
    time_s = observed["recording.motion_time_s"][0]
    odometer_m = np.trapezoid(observed["recording.odometer_m_per_s"][0], time_s)
    assert_allclose(odometer_m, 1861.3, atol=0.5)
    assert_allclose(np.linalg.norm(np.diff(pose[:, 1:3], axis=0), axis=1).sum(), 1859, atol=0.5)
    # Turns and true headings are one and the same measurement.
    difference_rad = step[:, 2] - np.diff(pose[:, 3])
    assert np.abs(np.angle(np.exp(1j * difference_rad))).max() < 1e-12


@needs(RANGES)
def test_labyrinth_has_the_counts_and_errors_of_its_description():
    observed, truth = robot_range_odometry.load(RANGES, name="labyrinth", window_s=0.05)
    error_m = range_error_m(observed, truth)
    assert len(error_m) == 233
    assert_allclose(
        [error_m.mean(), np.median(error_m), np.percentile(error_m, 95)], [0.12, 0.10, 0.30], atol=0.006
    )
    assert_allclose(path_m(truth), 9.2, atol=0.05)
    assert_allclose(observed["recording.time_s"][0, -1], 30, atol=0.3)
    assert_array_equal(
        observed["site.access_point_m"][0], [[-0.02, -0.01], [-0.02, 2.365], [2.385, 2.36], [2.385, -0.005]]
    )
    assert_array_equal(np.isfinite(observed["recording.range_m"][0]).sum(axis=1), 1)
    assert np.isnan(observed["recording.start_heading_rad"]).all()
    assert_array_equal(
        np.isfinite(robot_range_odometry.load(RANGES, name="labyrinth").observed["recording.range_m"]), True
    )


@needs(RANGES)
def test_labyrinth_wheels_are_left_and_right_and_half_the_base_apart():
    """So the path is followed to 0.06 m; taken as described, turns are twice as much to the other side."""
    observed, truth = robot_range_odometry.load(RANGES, name="labyrinth", window_s=0.05)
    assert fitted_rms_m(driven_m(observed), true_way_m(truth)) < 0.065
    time_s = observed["recording.motion_time_s"][0]
    duration_s = np.diff(time_s)
    turn_rad, forward_m = (
        duration_s * (observed[f"recording.{name}"][0, 1:] + observed[f"recording.{name}"][0, :-1]) / 2
        for name in ("gyro_rad_per_s", "odometer_m_per_s")
    )
    assert_allclose(forward_m.sum(), 9.35, atol=0.01)
    for factor in (-2, -1, 2):
        motion = motion_between(time_s, time_s, factor * turn_rad, forward_m)
        other = {f"recording.{name}": part[None] for name, part in zip(MOTION, motion, strict=True)}
        assert fitted_rms_m(driven_m(other), true_way_m(truth)) > 0.5


POSES = np.array([[100.0, 0, 0, 3.0], [101, 2, 0, 3.2], [102, 4, 0, 3.4], [103, 4, 3, -2.68]])
PLAZA = {
    "GT": POSES,
    "DR": np.array([[101.0, 2.0, 0.2], [102, 2, 0.2], [103, 3, 0.2]]),
    "TL": np.array([[7.0, 8.0, 9.0], [2, 1, 1], [5, 0, 10]]),
    # Ranges before, behind and out of order.
    "TD": np.array(
        [
            [99.9, 1, 7, 1.0],
            [102.6, 1, 7, 30.0],
            [102.8, 1, 7, 32.0],
            [101.2, 1, 2, 20.0],
            [101.3, 1, 5, 25.0],
            [103.1, 1, 7, 1.0],
        ]
    ),
}


def test_plaza_of_a_written_file(tmp_path):
    savemat(tmp_path / "Plaza1.mat", PLAZA)
    observed, truth = robot_range_odometry.load(tmp_path)
    assert_array_equal(observed["site.access_point_m"], [[[1, 1], [0, 10], [8, 9]]])
    assert_array_equal(observed["site.corner_m"], [[[0, 1], [8, 10]]])
    assert_allclose(observed["recording.time_s"], [[1.25, 2.7]])
    assert_allclose(observed["recording.range_m"], [[[20, 25, np.nan], [np.nan, np.nan, 31]]])
    assert_allclose(truth["truth.position_m"], [[[2.5, 0], [4, 2.1]]])
    assert_allclose(truth["truth.distance_m"][0, 1], np.hypot([3, 4, 4], [1.1, 7.9, 6.9]))
    assert_allclose(observed["recording.start_position_m"], [[2.5, 0]])
    assert_allclose(observed["recording.start_heading_rad"], [3.25])
    assert_allclose(observed["recording.motion_time_s"], [[0.5, 1.5, 2.5]])
    assert_allclose(observed["recording.odometer_m_per_s"], [[2, 2, 3]])
    assert_allclose(observed["recording.gyro_rad_per_s"], [[0.2, 0.2, 0.2]])
    # Turned by 0.2 rad a second; the pieces are 1.5 m and 2.1 m long, at 0.3 and 0.5 rad from the first pose.
    assert_allclose(turned_rad(observed), [0, 0.29])
    driven = 1.5 * np.exp(1j * (0.3 - 0.25)) + 2.1 * np.exp(1j * (0.5 - 0.25))
    assert_allclose(driven_m(observed), [0, driven])
    # The error of the first part is that at the times of its ranges, not of its epoch.
    first = robot_range_odometry.load(tmp_path, offset_from_first_s=2.0).observed
    offset_m = np.mean([20 - np.hypot(1.4, 1), 25 - np.hypot(2.6, 10)])
    assert_allclose(first["recording.range_m"], [[[np.nan, np.nan, 31 - offset_m]]])
    assert_array_equal(first["recording.advance_m"], [[0]])
    # The heading does not jump where the recorded one does, from 3.4 to -2.68 rad.
    assert_allclose(first["recording.start_heading_rad"], [3.4 + 0.7 * (2 * np.pi - 2.68 - 3.4)])
    # Windows begin where the first part ends.
    late = robot_range_odometry.load(tmp_path, offset_from_first_s=1.25, window_s=1.5).observed
    assert_allclose(late["recording.time_s"], [[(1.3 + 2.6) / 2, 2.8]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"TL": PLAZA["TL"][:2]}, "TD has a beacon that TL has not"),
        ({"TL": PLAZA["TL"][[0, 1, 2, 2]]}, "TL has a beacon twice"),
        ({"DR": PLAZA["DR"][:2]}, "DR has not the times of GT"),
        ({"GT": POSES[[0, 2, 1, 3]], "DR": PLAZA["DR"][[1, 0, 2]]}, "the time of GT does not increase"),
        ({"TD": PLAZA["TD"] * np.nan}, "a value of TD is not finite"),
        ({"TD": PLAZA["TD"][:, :3]}, "TD has the shape"),
        ({"TD": None}, "TD"),
    ],
)
def test_plaza_damaged_files_are_named(tmp_path, changes, message):
    arrays = {key: values for key, values in {**PLAZA, **changes}.items() if values is not None}
    savemat(tmp_path / "Plaza1.mat", arrays)
    with pytest.raises(InputError, match=rf"Plaza1\.mat: .*{message}"):
        robot_range_odometry.load(tmp_path)


def test_plaza_file_of_another_format_is_named(tmp_path):
    (tmp_path / "Plaza1.mat").write_text("no matrix at all, " * 20)
    with pytest.raises(InputError, match=r"Plaza1\.mat: the arrays GT, DR, TL, TD cannot be read"):
        robot_range_odometry.load(tmp_path)


LABYRINTH = """range2 10.2 2.5 0.01 3 0 9 0
odom2diff 10.0 0.9 1.1 0 0.1 0 0 0
range2 10.4 1.5 0.01 0 4 4 0
odom2diff 11.0 0.9 1.1 0 0.1 0 0 0
odom2diff 12.0 -1.0 -1.0 0 0.1 0 0 0
range2 11.9 3.5 0.01 3 0 9 0
"""
LABYRINTH_TRUTH = "point2 10.0 1 1 0 0 0 0\npoint2 12.0 3 1 0 0 0 0\n"


def write_labyrinth(folder, measured=LABYRINTH, truth=LABYRINTH_TRUTH):
    (folder / "labyrinth_Indoor_UWB_Input.txt").write_text(measured)
    (folder / "labyrinth_Indoor_UWB_GT.txt").write_text(truth)


def test_labyrinth_of_a_written_file(tmp_path):
    write_labyrinth(tmp_path)
    observed, truth = robot_range_odometry.load(tmp_path, name="labyrinth")
    assert_array_equal(observed["site.access_point_m"], [[[0, 4], [3, 0]]])
    assert_allclose(observed["recording.time_s"], [[0.3, 1.9]])
    assert_allclose(observed["recording.range_m"], [[[1.5, 2.5], [np.nan, 3.5]]])
    assert_allclose(truth["truth.position_m"], [[[1.3, 1], [2.9, 1]]])
    # Right minus left, over twice the length: 1 rad/s to the left.
    assert_allclose(observed["recording.gyro_rad_per_s"], [[1, 1, 0]])
    assert_allclose(observed["recording.odometer_m_per_s"], [[1, 1, -1]])
    # Between the rates lie trapezia: 1 rad and 1 m in the first second, 0.5 rad and 0 m in the second.
    assert_allclose(turned_rad(observed), [0, 0.7 + 0.45])
    assert_allclose(observed["recording.advance_m"], [[0, 0.7]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"measured": LABYRINTH + "imu 3 4\n"}, r"Input\.txt: .*the line 'imu 3 4' is none of them"),
        ({"measured": LABYRINTH + "range2 10.5 2.5 0.01\n"}, r"Input\.txt: .*the line 'range2 10\.5"),
        ({"measured": LABYRINTH.replace("2.5", "far")}, r"Input\.txt: .*'far'"),
        ({"measured": LABYRINTH.replace("2.5", "nan")}, r"Input\.txt: .*not finite"),
        ({"measured": LABYRINTH.replace("0 4 4", "0 4 9")}, r"Input\.txt: .*a module has two"),
        ({"measured": LABYRINTH.replace("0 0.1 0", "0 0.0 0")}, r"Input\.txt: .*not positive"),
        ({"measured": LABYRINTH.replace("odom2diff 12", "odom2diff 9")}, r"Input\.txt: .*do not increase"),
        ({"measured": LABYRINTH.replace("range2", "point2")}, r"Input\.txt: .*is none of them"),
        ({"truth": ""}, r"GT\.txt: .*has no line"),
    ],
)
def test_labyrinth_damaged_files_are_named(tmp_path, changes, message):
    write_labyrinth(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
        robot_range_odometry.load(tmp_path, name="labyrinth")


# ---- the robot among four nodes


@needs(NODES)
@pytest.mark.parametrize(
    ("name", "rows", "length_m", "odometer_m", "turn"),
    [
        ("exp1", 22, 0.9, 0.7, None),
        ("exp2", 153, 11.0, 8.7, 0.42),
        ("exp2.1", 101, 11.3, 9.3, 0.69),
        ("exp2.3", 149, 10.5, 9.0, 0.96),
        ("exp3", 177, 19.6, 15.0, 0.94),
        ("exp3.1", 179, 18.3, 16.0, 1.16),
        ("exp3.3", 156, 12.5, 11.0, 0.94),
        ("exp4", 147, 9.5, 8.1, 0.89),
        ("exp4.1", 123, 9.8, 8.5, 0.89),
        ("exp4.3", 129, 9.8, 8.6, 1.05),
    ],
)
def test_nodes_rows_paths_and_turns(name, rows, length_m, odometer_m, turn):
    """Counts and lengths of the recordings' description; the last is the course's turn per recorded one."""
    observed, truth = robot_rssi_odometry.load(NODES, name=name, calibration=other_run(name))
    time_s, speed_m_per_s, gyro_rad_per_s = (
        observed[f"recording.{key}"][0] for key in ("motion_time_s", "odometer_m_per_s", "gyro_rad_per_s")
    )
    assert time_s.shape == (rows,)
    assert_array_equal(time_s, observed["recording.time_s"][0])
    assert time_s[0] == 0
    assert_allclose(np.diff(time_s), 1, atol=0.012)
    assert_allclose(path_m(truth), length_m, atol=0.056)
    # The lengths of the description count ways back, of which one run has 0.13 m.
    advance_m = observed["recording.advance_m"][0]
    assert_allclose(np.abs(advance_m).sum(), odometer_m, atol=0.056)
    assert_allclose(advance_m.sum(), np.abs(advance_m).sum(), atol=0.3 if name == "exp3.3" else 0.01)
    assert_allclose(np.trapezoid(speed_m_per_s, time_s), advance_m.sum(), atol=0.02)
    assert 0.75 < np.abs(advance_m).sum() / path_m(truth) < 0.9
    assert_allclose(gyro_rad_per_s / 0.05, np.round(gyro_rad_per_s / 0.05), atol=1e-6)
    assert_allclose(turned_rad(observed)[-1], np.trapezoid(gyro_rad_per_s, time_s), atol=1e-9)
    way_m = np.diff(true_way_m(truth))
    moving = (np.abs(way_m[1:]) > 0.03) & (np.abs(way_m[:-1]) > 0.03)
    if turn is None:
        assert not gyro_rad_per_s[1:-1][moving].any()
        return
    course_rad = np.angle(way_m[1:][moving] / way_m[:-1][moving])
    recorded_rad = gyro_rad_per_s[1:-1][moving]
    assert_allclose(recorded_rad @ course_rad / (recorded_rad @ recorded_rad), turn, atol=0.006)


@needs(NODES)
@pytest.mark.parametrize("name", robot_rssi_odometry.RUNS[1:])
def test_nodes_strengths_fall_with_the_distance(name):
    observed, truth = robot_rssi_odometry.load(NODES, name=name, calibration=other_run(name))
    rss_dbm, distance_m = observed["recording.rss_dbm"][0], truth["truth.distance_m"][0]
    assert np.isnan(rss_dbm).sum() <= 3
    correlation = [
        np.corrcoef(np.log(metres[np.isfinite(dbm)]), dbm[np.isfinite(dbm)])[0, 1]
        for metres, dbm in zip(distance_m.T, rss_dbm.T, strict=True)
    ]
    assert -0.85 < min(correlation) < max(correlation) < -0.42
    level_dbm, exponent, residual_db = path_loss(
        observed["calibration.distance_m"][0], observed["calibration.rss_dbm"][0]
    )
    expected = (-38.6, 1.60, 4.2) if name == "exp3" else (-39.2, 1.52, 4.2)
    assert_allclose([level_dbm, exponent, residual_db], expected, atol=0.06)


@needs(NODES)
def test_nodes_a_dead_node_and_a_row_that_is_cut_off():
    observed, truth = robot_rssi_odometry.load(NODES, name="exp1")
    assert_array_equal(np.isnan(observed["recording.rss_dbm"][0]).sum(axis=0), [0, 1, 2, 22])
    observed, truth = robot_rssi_odometry.load(NODES, name="exp3", calibration="exp1")
    assert_array_equal(np.isnan(observed["recording.rss_dbm"][0]).sum(axis=0), [0, 1, 1, 1])
    assert_array_equal(observed["recording.rss_dbm"][0, -1], [-46, np.nan, np.nan, np.nan])
    assert observed["calibration.rss_dbm"].shape == (1, 4 * 22 - 25)
    # The path leaves the box of the nodes, most in this run.
    over_m = truth["truth.position_m"][0] - observed["site.corner_m"][0, 1]
    assert_allclose(over_m.max(), 0.26, atol=0.005)


NODE_HEADER = (
    "temp_step,temp_sec,temp_nsec,robot_odom_x,robot_odom_y,robot_odom_w,robot_pos_x,robot_pos_y,robot_pos_w,"
    "vel_x,vel_y,vel_w," + ",".join(f"rssi{i},lqi{i},noise{i},status{i}" for i in range(1, 5))
)


def node_row(second, nanosecond, travelled, x, y, turn, readings):
    nodes = ", ".join(f"{dbm},70.0,-256.0, {status}" for dbm, status in readings)
    place = f"{travelled},  0.0,  1.0,  {x},  {y},  0.7"
    return f"  1, {second},  {nanosecond},  {place},  0.2,  0.0,  {turn},{nodes}"


HEARD = [(-40.0, 1), (-41.0, 1), (-42.0, 1), (0.0, 0)]
ROWS = [
    node_row(1652324502, 900000000, 52.0, 1.0, 1.0, 0.0, HEARD),
    node_row(1652324504, 100000000, 52.3, 1.0, 1.3, 0.5, [(-50.0, 1)] * 4),
    node_row(1652324505, 300000000, 52.2, 1.0, 1.2, 0.5, [(-50.0, 0)] * 4),
]


def write_nodes(folder, own=ROWS, other=ROWS[:2]):
    for name, rows in (("exp2", own), ("exp3", other)):
        (folder / f"combined_sync_data_{name}.csv").write_text("\n".join([NODE_HEADER, *rows]) + "\n")


def test_nodes_of_a_written_file(tmp_path):
    write_nodes(tmp_path)
    observed, truth = robot_rssi_odometry.load(tmp_path)
    assert_allclose(observed["recording.time_s"], [[0, 1.2, 2.4]], atol=1e-12)
    assert_array_equal(observed["recording.rss_dbm"], [[[-40, -41, -42, np.nan], [-50] * 4, [np.nan] * 4]])
    assert_array_equal(truth["truth.position_m"], [[[1, 1], [1, 1.3], [1, 1.2]]])
    assert_array_equal(observed["recording.start_position_m"], [[1, 1]])
    assert_array_equal(observed["recording.gyro_rad_per_s"], [[0, 0.5, 0.5]])
    assert_allclose(observed["recording.odometer_m_per_s"], [[0.3 / 1.2, 0.2 / 2.4, -0.1 / 1.2]])
    assert_allclose(observed["recording.advance_m"], [[0, 0.3, -0.1]])
    assert_allclose(observed["recording.turn_before_rad"], [[0, 0.15, 0.3]])
    assert_allclose(observed["recording.turn_after_rad"], [[0, 0.15, 0.3]])
    assert_array_equal(observed["calibration.rss_dbm"], [[-40, -41, -42, *[-50] * 4]])
    assert_allclose(observed["calibration.distance_m"][0, :2], np.hypot([1, 1], [1, 0.75]))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (ROWS[:1], "there are fewer than two rows"),
        ([*ROWS, ROWS[0]], "the time does not increase"),
        ([*ROWS, ROWS[2].replace("52.2", "")], "a cell is empty"),
        ([*ROWS, ROWS[2].replace("52.2", "inf")], "a cell is empty or not finite"),
        ([*ROWS, ROWS[2].replace("52.2", "far")], "'far'"),
        ([ROWS[0], ROWS[1].replace("-50.0", "50.0")], "not below 0 dBm"),
    ],
)
def test_nodes_damaged_files_are_named(tmp_path, rows, message):
    write_nodes(tmp_path, own=rows)
    with pytest.raises(InputError, match=rf"file combined_sync_data_exp2\.csv: .*{message}"):
        robot_rssi_odometry.load(tmp_path)
    write_nodes(tmp_path, other=rows)
    with pytest.raises(InputError, match=rf"file combined_sync_data_exp3\.csv: .*{message}"):
        robot_rssi_odometry.load(tmp_path)


# ---- the flat


def filled(rss_dbm):
    return np.where(np.isnan(rss_dbm), -95, rss_dbm)


@pytest.fixture(scope="module")
def every_row():
    """All rows of the four runs, each an epoch: they are a third of a second apart."""
    return [ble_flat_robot.load(FLAT, run=run, window_s=0.2) for run in (1, 2, 3, 4)]


@needs(FLAT)
def test_flat_rows_of_the_runs_and_gaps_of_the_anchors(every_row):
    strengths = [worlds.observed["recording.rss_dbm"][0] for worlds in every_row]
    assert [len(dbm) for dbm in strengths] == [1707, 1371, 490, 536]
    missing = np.isnan(np.concatenate(strengths)).mean(axis=0)
    assert 0.035 < missing.min() < missing.max() < 0.16
    for run, fewer in enumerate((572, 460, 164, 181)):
        observed, truth = every_row[run]
        time_s = observed["recording.time_s"][0]
        assert time_s[0] == 0
        assert_allclose(np.diff(time_s).min(), 1 / 3, atol=0.002)
        low_m, high_m = observed["site.corner_m"][0]
        assert_array_equal([low_m, high_m], [[0, 0], [9.07, 7.1]])
        assert (truth["truth.position_m"] > low_m).all()
        assert (truth["truth.position_m"] < high_m).all()
        thinned = ble_flat_robot.load(FLAT, run=run + 1).observed
        assert thinned["recording.time_s"].shape == (1, fewer)


@needs(FLAT)
def test_flat_path_loss_of_each_anchor(every_row):
    """The description's figures, over distances in space; planar ones give flatter curves."""
    with (FLAT / "anchors.csv").open(newline="") as handle:
        above_m = np.array([float(row["z"]) for row in csv.DictReader(handle)]) - 1.3
    rss_dbm = np.concatenate([worlds.observed["recording.rss_dbm"][0] for worlds in every_row])
    planar_m = np.concatenate([worlds.truth["truth.distance_m"][0] for worlds in every_row])
    fits = [path_loss(np.hypot(planar_m, above_m)[:, anchor], rss_dbm[:, anchor]) for anchor in range(6)]
    level_dbm, exponent, residual_db = np.transpose(fits)
    assert_allclose(exponent, [1.51, 2.54, 1.84, 2.23, 3.12, 2.04], atol=0.006)
    assert_allclose([level_dbm.min(), level_dbm.max()], [-52, -42], atol=0.5)
    assert 5 < residual_db.min() < residual_db.max() < 8
    planar = [path_loss(planar_m[:, anchor], rss_dbm[:, anchor])[1] for anchor in range(6)]
    assert_allclose([min(planar), max(planar)], [1.32, 2.69], atol=0.01)


@needs(FLAT)
def test_flat_accuracy_of_four_neighbours(every_row):
    """Leave-one-run-out on single rows as in the description, and on the survey as it is handed out."""
    rows = [(filled(o["recording.rss_dbm"][0]), t["truth.position_m"][0]) for o, t in every_row]
    survey = [(filled(o["survey.rss_dbm"][0]), o["survey.position_m"][0]) for o, _ in every_row]
    error_m = np.empty((2, 4))
    for run, (rss_dbm, position_m) in enumerate(rows):
        others = [
            np.concatenate(part) for part in zip(*(r for i, r in enumerate(rows) if i != run), strict=True)
        ]
        for kind, training in enumerate((others, survey[run])):
            estimate_m = KNeighborsRegressor(4).fit(*training).predict(rss_dbm)
            error_m[kind, run] = np.linalg.norm(estimate_m - position_m, axis=1).mean()
    assert_allclose(error_m[0], [2.76, 1.85, 1.51, 2.09], atol=0.006)
    assert_allclose(error_m[1], error_m[0], atol=0.25)


@needs(FLAT)
def test_flat_survey_and_calibration_are_those_of_the_other_runs(every_row):
    for run, (observed, _) in enumerate(every_row):
        others = [worlds for other, worlds in enumerate(every_row) if other != run]
        rss_dbm = np.concatenate([o["recording.rss_dbm"][0] for o, _ in others])
        distance_m = np.concatenate([t["truth.distance_m"][0] for _, t in others])
        heard = np.isfinite(rss_dbm)
        assert_array_equal(observed["calibration.rss_dbm"][0], rss_dbm[heard])
        assert_allclose(observed["calibration.distance_m"][0], distance_m[heard], atol=1e-12)
        survey = Survey.from_arrays(observed).check()
        place_m = survey.position_m[0]
        cells = np.concatenate([np.floor(t["truth.position_m"][0] / 0.25) for _, t in others])
        cells = np.unique(cells, axis=0)
        assert_array_equal(np.unique(np.floor(place_m / 0.25), axis=0), cells)
        assert len(place_m) == len(cells)
        # Next to nothing as cells: all different places of the other runs.
        finest = ble_flat_robot.load(FLAT, run=run + 1, cell_m=1e-9).observed["survey.position_m"][0]
        places = np.unique(np.concatenate([t["truth.position_m"][0] for _, t in others]), axis=0)
        assert_allclose(finest[np.lexsort(finest.T[::-1])], places, atol=1e-12)


@needs(FLAT)
def test_flat_walls_are_a_closed_line_of_upright_pieces():
    (wall_m,) = ble_flat_robot.load(FLAT).observed["site.wall_m"]
    assert_array_equal(wall_m[1:, 0], wall_m[:-1, 1])
    assert_array_equal(wall_m[0, 0], wall_m[-1, 1])
    assert_array_equal(np.count_nonzero(wall_m[:, 0] != wall_m[:, 1], axis=1), 1)


def flat_rows(starts_s=(0, 1000, 2000, 3000)):
    """Three rows a run, in two windows; anchor 1 misses one, anchor 6 all."""
    rows = ["0,ts,x,heading,y,rssi_1,rssi_2,rssi_3,rssi_4,rssi_5,rssi_6"]
    for run, start_s in enumerate(starts_s):
        for step, (after_s, first_dbm) in enumerate(((0.0, "-50.0"), (1 / 3, ""), (1.0, "-60.0"))):
            nanosecond = 1.6279974522e18 + 1e9 * (start_s + after_s)
            x, y = 0.1 + run + 0.2 * step, 2.0 + 0.01 * step
            rows.append(f"{step},{nanosecond:.16g},{x},9.9,{y},{first_dbm},-70.{step},-71,-72,-73,")
    return rows


def write_flat(folder, rows=None, anchors=range(1, 7), layout=((0, 0), (5, 0), (5, 4), (0, 0))):
    (folder / "calibration_df.csv").write_text("\n".join(rows or flat_rows()) + "\n")
    # Out of order: the number counts.
    lines = [f"{number},{number},0.5,2.0" for number in reversed(anchors)]
    (folder / "anchors.csv").write_text("\n".join(["id,x,y,z", *lines]) + "\n")
    (folder / "layout.csv").write_text("\n".join(["x,y", *(f"{x},{y}" for x, y in layout)]) + "\n")


def test_flat_of_a_written_file(tmp_path):
    write_flat(tmp_path)
    observed, truth = ble_flat_robot.load(tmp_path, run=2, cell_m=0.5)
    assert_array_equal(observed["site.access_point_m"][0, :, 0], [1, 2, 3, 4, 5, 6])
    assert_array_equal(observed["site.corner_m"], [[[0, 0], [5, 4]]])
    assert_array_equal(observed["site.wall_m"][0, 1], [[5, 0], [5, 4]])
    assert_allclose(observed["recording.time_s"], [[1 / 6, 1]], atol=1e-3)
    assert_allclose(
        observed["recording.rss_dbm"],
        [[[-50, -70.05, -71, -72, -73, np.nan], [-60, -70.2, -71, -72, -73, np.nan]]],
    )
    assert_allclose(truth["truth.position_m"], [[[1.2, 2.005], [1.5, 2.02]]])
    assert_allclose(truth["truth.distance_m"][0, :, 0], np.hypot([0.2, 0.5], [1.505, 1.52]))
    # Two cells a run, of two rows and of one.
    place_m = observed["survey.position_m"][0]
    assert_allclose(place_m[:, 0], [0.2, 0.5, 2.2, 2.5, 3.2, 3.5])
    assert_allclose(observed["survey.rss_dbm"][0, :, 0], [-50, -60] * 3)
    assert_allclose(observed["survey.rss_dbm"][0, :, 1], [-70.05, -70.2] * 3)
    assert np.isnan(observed["survey.rss_dbm"][0, :, 5]).all()
    assert observed["calibration.rss_dbm"].shape == (1, 3 * (2 + 4 * 3))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rows": flat_rows((0, 1000, 2000))}, r"calibration_df\.csv: 4 runs .*there are 3"),
        ({"rows": flat_rows((0, 2000, 1000, 3000))}, r"calibration_df\.csv: the times .*do not increase"),
        ({"rows": [r.replace("-50.0", "50.0") for r in flat_rows()]}, r"df\.csv: .*not below 0 dBm"),
        ({"rows": [r.replace("-50.0", "-inf") for r in flat_rows()]}, r"df\.csv: .*a strength is infinite"),
        ({"rows": [r.replace(",2.01,", ",,") for r in flat_rows()]}, r"df\.csv: .*a cell is empty"),
        ({"rows": [r.replace("rssi_6", "rssi_7") for r in flat_rows()]}, r"df\.csv: .*rssi_6"),
        ({"anchors": range(1, 6)}, r"anchors\.csv: six anchors .*there are 5"),
        ({"layout": ()}, r"layout\.csv: .*there is no row"),
    ],
)
def test_flat_damaged_files_are_named(tmp_path, changes, message):
    write_flat(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
        ble_flat_robot.load(tmp_path)
