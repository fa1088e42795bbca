"""The adapter of the rover with GPS and an inertial unit: axes, frames, start, outage, refusals."""

import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from positioning.errors import InputError
from positioning.filters.plane import check_stack
from positioning.inertial.earth import gravity_m_per_s2
from positioning.inertial.geodetic import attitude_of, position_scale_m, to_geodetic, to_local
from positioning.inertial.gps import usable_gps
from positioning.model import Recording, Site
from positioning.recordings import gps_ins_rover
from positioning.recordings.gps_ins_rover import BODY_OF_UNIT, COLUMNS, GPS, IMU, REFERENCE, _thinned
from positioning.recordings.register import check_files

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
ROVER = REALDATA / "gps_ins_rover"
needs_rover = pytest.mark.skipif(not ROVER.is_dir(), reason=f"no recordings in {ROVER} (REPOSITION_REALDATA)")

ORIGIN = np.array([np.radians(45.5), np.radians(-73.4), 25.0])
GRID = 0.9998 * np.exp(1j * np.radians(1.2))
YAW_RAD, TURN_RAD_PER_S, SPEED_M_PER_S, REST_END_S = 2.2, -0.1, 0.5, 1.5
ROLL_RAD, PITCH_RAD = np.radians(3.0), np.radians(-2.0)


def yaw_rad(time_s):
    """Yaw of the made drive: rest, then a circle to the left."""
    return YAW_RAD + TURN_RAD_PER_S * np.maximum(time_s - REST_END_S, 0)


def place_m(time_s):
    """East, north and up of the unit in the made drive, [n, 3]."""
    radius, turned = SPEED_M_PER_S / TURN_RAD_PER_S, yaw_rad(time_s)
    north = radius * (np.sin(turned) - np.sin(YAW_RAD))
    east = -radius * (np.cos(turned) - np.cos(YAW_RAD))
    return np.stack([east, north, np.full_like(north, 1.0)], axis=-1)


def ned(enu):
    """East, north, up as north, east, down."""
    return enu[..., [1, 0, 2]] * [1, 1, -1]


ARMS_M = {
    "none": np.zeros(3),
    "printed": np.array([-0.156, 0.511, 0.004]),
    # x of the unit points to the right, y backwards.
    "turned": np.array([-0.511, -0.156, 0.004]),
}
"""In the body, by the option."""


@pytest.fixture(scope="module")
def drives(tmp_path_factory):
    """Folders with the three files of a drive that is known, by the arm that its antenna has."""
    return {name: drive(tmp_path_factory.mktemp(name), arm_m) for name, arm_m in ARMS_M.items()}


@pytest.fixture(scope="module")
def made(drives):
    """A drive whose antenna is where the unit is."""
    return drives["none"]


def drive(folder, lever_m):
    """Write the files of a drive with this lever arm."""
    imu_s = 0.5 + 0.005 * np.arange(11_900)
    turn = np.where(imu_s > REST_END_S, TURN_RAD_PER_S, 0.0)
    attitude = attitude_of(
        np.stack([np.full_like(imu_s, ROLL_RAD), np.full_like(imu_s, PITCH_RAD), yaw_rad(imu_s)], axis=-1)
    )
    push = np.stack([np.zeros_like(turn), SPEED_M_PER_S * turn, np.full_like(turn, -9.80)], axis=-1)
    level = attitude_of(np.stack([0 * imu_s, 0 * imu_s, yaw_rad(imu_s)], axis=-1)) @ push[..., None]
    force = (np.swapaxes(attitude, -1, -2) @ level)[..., 0]
    rate = np.swapaxes(attitude, -1, -2)[..., 2] * turn[:, None]
    table = np.column_stack([imu_s, force @ BODY_OF_UNIT, rate @ BODY_OF_UNIT])
    pd.DataFrame(table, columns=COLUMNS[IMU]).to_csv(folder / IMU, index=False)

    gps_s = 0.05 * np.arange(1_200)
    angles = np.stack(
        [np.full_like(gps_s, ROLL_RAD), np.full_like(gps_s, PITCH_RAD), yaw_rad(gps_s)], axis=-1
    )
    arm = ned(attitude_of(angles) @ lever_m)
    antenna = place_m(gps_s) + arm
    geodetic = to_geodetic(antenna, ORIGIN)
    local = to_local(geodetic, geodetic[0])
    grid = GRID * (local[:, 0] + 1j * local[:, 1])
    table = np.column_stack(
        [gps_s, np.degrees(geodetic[:, :2]), geodetic[:, 2], grid.real, grid.imag, local[:, 2]]
    )
    pd.DataFrame(table, columns=COLUMNS[GPS]).to_csv(folder / GPS, index=False, float_format="%.17g")

    pose_s = 5.1 + 0.45 * np.arange(120)
    place = place_m(pose_s) - antenna[0]
    grid = GRID * (place[:, 0] + 1j * place[:, 1])
    # Against the grid the vehicle points less far round, x forward and z up, in east, north, up.
    grid_yaw = yaw_rad(pose_s) - np.angle(GRID)
    turns = Rotation.from_euler(
        "ZYX",
        np.stack(
            [np.pi / 2 - grid_yaw, np.full_like(pose_s, -PITCH_RAD), np.full_like(pose_s, ROLL_RAD)], -1
        ),
    )
    table = np.column_stack([pose_s, grid.real, grid.imag, place[:, 2], turns.as_quat()])
    pd.DataFrame(table, columns=COLUMNS[REFERENCE]).to_csv(folder / REFERENCE, index=False)
    return folder


@pytest.mark.parametrize("name", ARMS_M)
def test_a_made_drive_is_found_again(drives, name):
    observed, truth = gps_ins_rover.load(drives[name], lever_arm=name)
    lever_m = ARMS_M[name]
    assert_allclose(observed["recording.gps_lever_arm_m"], lever_m[None], atol=1e-12)
    pose_s = observed["recording.time_s"][0]
    origin = observed["site.origin_geodetic"][0]
    first = ned(attitude_of([ROLL_RAD, PITCH_RAD, YAW_RAD]) @ lever_m) + place_m(np.zeros(1))[0]
    assert_allclose(truth["truth.path_m"][0], (place_m(pose_s) - first)[:, :2], atol=1e-4)
    assert_allclose(truth["truth.height_m"][0], (place_m(pose_s) - first)[:, 2], atol=1e-6)
    expected = np.stack(
        [np.full(len(pose_s), ROLL_RAD), np.full(len(pose_s), PITCH_RAD), yaw_rad(pose_s)], -1
    )
    late = pose_s >= 25
    off = truth["truth.attitude_rad"][0] - expected
    assert_allclose(np.remainder(off[late] + np.pi, 2 * np.pi) - np.pi, 0, atol=1e-5)
    assert np.isnan(off[~late]).all()
    assert_array_equal(np.isnan(truth["truth.position_m"][0]).any(axis=-1), ~late)

    assert_allclose(observed["recording.start_attitude_rad"][0, :2], [ROLL_RAD, PITCH_RAD], atol=1e-6)
    # A lever arm moves the antenna across the course in a turn: v_right = 0.51 m * 0.1 rad/s of 0.5 m/s.
    aside = np.arctan2(TURN_RAD_PER_S * lever_m[0], SPEED_M_PER_S - TURN_RAD_PER_S * lever_m[1])
    assert_allclose(observed["recording.start_attitude_rad"][0, 2] - YAW_RAD, aside, atol=2e-3)
    assert_allclose(
        to_local(observed["recording.start_geodetic"][0], origin), place_m(np.zeros(1))[0] - first, atol=0.06
    )
    assert_array_equal(observed["recording.start_velocity_m_per_s"], np.zeros((1, 3)))

    rest = observed["recording.imu_time_s"][0] < REST_END_S
    force = observed["recording.specific_force_m_per_s2"][0][rest].mean(axis=0)
    assert_allclose(attitude_of([ROLL_RAD, PITCH_RAD, 0.0]) @ force, [0, 0, -9.80], atol=1e-6)
    assert (observed["recording.angular_rate_rad_per_s"][0][~rest, 2][1:] < -0.09).all()


def test_no_lever_arm_is_used_unless_asked_for(drives):
    observed, _ = gps_ins_rover.load(drives["turned"])
    assert_array_equal(observed["recording.gps_lever_arm_m"], np.zeros((1, 3)))


@pytest.mark.parametrize("name", ARMS_M)
def test_the_start_place_is_the_antenna_less_the_lever_arm(drives, name):
    observed, _ = gps_ins_rover.load(drives[name], lever_arm=name)
    assert np.abs(observed["recording.gps_lever_arm_m"]).max() == np.abs(ARMS_M[name]).max()
    origin = observed["site.origin_geodetic"][0]
    start = observed["recording.start_geodetic"][0]
    arm = attitude_of(observed["recording.start_attitude_rad"][0]) @ observed["recording.gps_lever_arm_m"][0]
    assert_allclose(to_local(start + arm / position_scale_m(start), origin), np.zeros(3), atol=1e-4)


@needs_rover
def test_one_world_of_the_agreed_shapes():
    observed, truth = gps_ins_rover.load(ROVER)
    assert observed["recording.time_s"].shape == (1, 401)
    assert observed["recording.imu_time_s"].shape == (1, 37_119)
    recording, site = Recording.from_arrays(observed), Site.from_arrays(observed)
    assert_array_equal(check_stack(recording, site, beacons=False), [401])
    count = observed["recording.gps_time_s"].shape[1]
    assert observed["recording.gps_geodetic"].shape == (1, count, 3)
    assert recording.gps_velocity_m_per_s is None
    for name in ("start_geodetic", "start_velocity_m_per_s", "start_attitude_rad", "gps_lever_arm_m"):
        assert observed[f"recording.{name}"].shape == (1, 3)
    finite = {name: values for name, values in observed.items() if "outage" not in name}
    assert all(np.isfinite(values).all() for values in finite.values())
    assert np.isnan(observed["recording.gps_outage_s"]).all()
    for name in ("imu_time_s", "gps_time_s", "time_s"):
        assert (np.diff(observed[f"recording.{name}"]) > 0).all()
    assert observed["recording.gps_time_s"].min() >= observed["recording.imu_time_s"].min()
    low_m, high_m = observed["site.corner_m"][0]
    path_m, position_m = truth["truth.path_m"][0], truth["truth.position_m"][0]
    assert ((path_m > low_m) & (path_m < high_m)).all()
    scored = np.isfinite(position_m).all(axis=-1)
    assert_array_equal(scored, observed["recording.time_s"][0] >= 25)
    assert_array_equal(position_m[scored], path_m[scored])


@needs_rover
def test_gps_and_reference_do_not_tell_the_lever_arm():
    # The docstring has these numbers; the arm of opposite sign, which nobody printed, fits best.
    observed, truth = gps_ins_rover.load(ROVER, gps_interval_s=0.0)
    pose_s = observed["recording.time_s"][0]
    used = pose_s >= 25
    antenna_m = to_local(observed["recording.gps_geodetic"][0], observed["site.origin_geodetic"][0])
    gps_s = observed["recording.gps_time_s"][0]
    at_m = np.stack([np.interp(pose_s[used], gps_s, antenna_m[:, axis]) for axis in range(2)], axis=-1)
    attitude = attitude_of(truth["truth.attitude_rad"][0][used])
    found = [
        np.sqrt(
            np.mean(np.sum((at_m - ned(attitude @ arm)[:, :2] - truth["truth.path_m"][0][used]) ** 2, -1))
        )
        for arm in (*ARMS_M.values(), -ARMS_M["turned"])
    ]
    assert_allclose(found, [1.00, 1.13, 1.37, 0.84], atol=0.01)


@needs_rover
def test_the_readings_agree_with_the_attitudes_of_the_reference():
    # Tilts move both sensors; with the axes of the column names neither slope would be near 1.
    observed, truth = gps_ins_rover.load(ROVER)
    imu_s, pose_s = observed["recording.imu_time_s"][0], observed["recording.time_s"][0]
    window = np.ones(400) / 400
    force = observed["recording.specific_force_m_per_s2"][0]
    smooth = np.stack([np.convolve(force[:, axis], window, "same") for axis in range(3)], axis=-1)
    used = (pose_s > 25) & (pose_s < 184)
    tilt = np.stack([np.interp(pose_s[used], imu_s, smooth[:, axis]) for axis in (1, 0)], axis=-1) / 9.806
    attitude = truth["truth.attitude_rad"][0][used]
    for measured, true in ((-tilt[:, 0], attitude[:, 0]), (tilt[:, 1], attitude[:, 1])):
        slope = np.polyfit(measured, true, 1)[0]
        assert 0.9 < slope < 1.15
        assert np.corrcoef(measured, true)[0, 1] > 0.9
    # A few seconds of roll and pitch rate, and the whole of the turn rate.
    turned = np.cumsum(observed["recording.angular_rate_rad_per_s"][0] * 0.005, axis=0)
    for axis in range(2):
        along = np.interp(pose_s[used], imu_s, turned[:, axis])
        assert np.corrcoef(along[10:] - along[:-10], attitude[10:, axis] - attitude[:-10, axis])[0, 1] > 0.6
    heading = observed["recording.start_attitude_rad"][0, 2] + np.interp(pose_s[used], imu_s, turned[:, 2])
    off = np.degrees(np.remainder(attitude[:, 2] - heading + np.pi, 2 * np.pi) - np.pi)
    assert abs(np.median(off)) < 5
    assert np.ptp(off) < 15


@needs_rover
def test_the_grid_is_turned_and_shrunk_as_the_projection_says():
    observed, truth = gps_ins_rover.load(ROVER)
    reference = pd.read_csv(ROVER / REFERENCE)
    path_m = truth["truth.path_m"][0]
    factor = np.vdot(path_m @ [1, 1j], reference["e_m"] + 1j * reference["n_m"]) / np.vdot(
        path_m @ [1, 1j], path_m @ [1, 1j]
    )
    latitude, longitude, _ = observed["site.origin_geodetic"][0]
    # Transverse Mercator to second order, central meridian of zone 18: 75 degrees west.
    away = longitude - np.radians(-75)
    assert_allclose(np.angle(factor), away * np.sin(latitude), atol=2e-5)
    assert_allclose(np.abs(factor), 0.9996 * (1 + 0.5 * (away * np.cos(latitude)) ** 2), atol=1e-5)


@needs_rover
def test_the_start_is_level_at_rest_and_its_heading_needs_no_certain_span():
    headings = []
    for align_s in (10.0, 20.0, 40.0, 100.0):
        observed, _ = gps_ins_rover.load(ROVER, align_s=align_s)
        headings.append(observed["recording.start_attitude_rad"][0, 2])
    assert np.degrees(np.ptp(headings)) < 4
    rest = observed["recording.imu_time_s"][0] < 1.5
    force = observed["recording.specific_force_m_per_s2"][0][rest]
    assert force.std(axis=0).max() < 0.05
    level = attitude_of(observed["recording.start_attitude_rad"][0]) @ force.mean(axis=0)
    assert_allclose(level[:2], 0, atol=1e-9)
    latitude, _, height = observed["site.origin_geodetic"][0]
    assert_allclose(-level[2], gravity_m_per_s2(latitude, height), atol=0.02)


@needs_rover
def test_an_outage_hides_rows_that_stay_in_the_recording():
    whole = Recording.from_arrays(gps_ins_rover.load(ROVER).observed)
    cut = Recording.from_arrays(gps_ins_rover.load(ROVER, outage_from_s=80.0, outage_s=30.0).observed)
    assert_array_equal(cut.gps_geodetic, whole.gps_geodetic)
    assert_array_equal(cut.gps_outage_s, [[80.0, 110.0]])
    assert usable_gps(whole).all()
    hidden = cut.gps_time_s[~usable_gps(cut)]
    assert len(hidden) == 30
    assert hidden.min() >= 80
    assert hidden.max() < 110


@needs_rover
def test_rows_of_gps_are_thinned():
    every = gps_ins_rover.load(ROVER, gps_interval_s=0.0).observed["recording.gps_time_s"][0]
    raw = pd.read_csv(ROVER / GPS)["t_s"].to_numpy()
    assert_array_equal(every, raw[raw >= 0.5])
    for interval_s in (0.2, 1.0, 5.0):
        kept = gps_ins_rover.load(ROVER, gps_interval_s=interval_s).observed["recording.gps_time_s"][0]
        assert np.isin(kept, every).all()
        assert abs(len(kept) - 186 / interval_s) <= 3


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.01, 3.0), min_size=1, max_size=40), st.floats(0.05, 4.0))
def test_thinning_keeps_the_first_row_of_each_interval(steps, interval_s):
    time_s = np.cumsum(steps)
    kept = _thinned(time_s, interval_s)
    cell = np.floor((time_s - time_s[0]) / interval_s)
    near = np.abs((time_s - time_s[0]) / interval_s - np.rint((time_s - time_s[0]) / interval_s)) < 1e-9
    if not near[1:].any():
        assert_array_equal(np.flatnonzero(kept), np.unique(cell, return_index=True)[1])
    assert kept[0]


@needs_rover
def test_the_files_are_those_of_the_register():
    assert {record.file for record in check_files(ROVER, "gps_ins_rover")} == {IMU, GPS, REFERENCE}


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("outage_from_s", 5.0),
        ("outage_from_s", 1e4),
        ("outage_from_s", float("nan")),
        ("outage_s", -1.0),
        ("outage_s", "40"),
        ("gps_interval_s", -0.1),
        ("align_s", 2.0),
        ("settle_s", float("inf")),
        ("settle_s", True),
        ("lever_arm", "left"),
    ],
)
def test_options_outside_the_drive_are_refused(made, option, value):
    with pytest.raises(InputError, match=f"option {option}"):
        gps_ins_rover.load(made, **{option: value})


def test_an_outage_longer_than_the_drive_is_refused(made):
    with pytest.raises(InputError, match="option outage_s"):
        gps_ins_rover.load(made, outage_from_s=40.0, outage_s=100.0)


@pytest.mark.parametrize(
    ("file", "change", "match"),
    [
        (IMU, lambda t: t.drop(columns="wz_radps"), "cannot be read"),
        (IMU, lambda t: t.assign(fx_mps2=np.nan), "not finite"),
        (GPS, lambda t: t.assign(t_s=t["t_s"][::-1].to_numpy()), "does not increase"),
        (GPS, lambda t: t.assign(e_m=t["e_m"] ** 2), "disagree"),
        (REFERENCE, lambda t: t.assign(qx="x"), "cannot be read"),
        (REFERENCE, lambda t: t.iloc[:1], "fewer than two rows"),
    ],
)
def test_files_that_are_not_this_data_set_are_refused(made, tmp_path, file, change, match):
    folder = tmp_path / "rover"
    shutil.copytree(made, folder)
    change(pd.read_csv(folder / file)).to_csv(folder / file, index=False)
    with pytest.raises(InputError, match=match) as refused:
        gps_ins_rover.load(folder)
    assert file in str(refused.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"imu\.csv"):
        gps_ins_rover.load(tmp_path)
