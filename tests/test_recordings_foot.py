"""The adapters of feet with inertial sensors and of the library's phone: facts, frames, defects, refusals."""

import os
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat, savemat
from scipy.spatial.transform import Rotation
from sklearn.neighbors import KNeighborsRegressor

from positioning.errors import InputError
from positioning.evaluation.studies import foot_real
from positioning.files import read_yaml
from positioning.filters.plane import check_stack
from positioning.geometry import rigid_fit, rotated
from positioning.inertial.foot import foot_navigation
from positioning.inertial.foot_settings import FootFilter
from positioning.model import Recording, Site
from positioning.recordings import foot_imu_corridor, foot_imu_loop, foot_imu_mocap, phone_wifi_imu_library
from positioning.recordings.foot_imu_corridor import LEAST_SWING_S, stances
from positioning.recordings.register import check_files, find_file, read_register
from positioning.registry import factory
from positioning.tasks import tracking

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
MOCAP = REALDATA / "foot_imu_mocap"
CORRIDOR = REALDATA / "foot_imu_corridor"
LOOP = REALDATA / "foot_imu_loop"
LIBRARY = REALDATA / "phone_wifi_imu_library"

TURNED = "2018-02-09-11-32-01"
"""The trial whose unit sits turned on the shoe."""
HELD = {
    "2017-11-22-11-22-03",
    "2017-11-27-11-11-24",
    "2017-12-15-17-59-19",
    "2017-12-15-18-00-13",
    "2017-12-15-18-01-18",
}
"""Trials in which the tracker held a place for long."""


def needs(folder):
    return pytest.mark.skipif(not folder.is_dir(), reason=f"no recordings in {folder} (REPOSITION_REALDATA)")


@pytest.fixture(scope="module")
def trials():
    return {name: foot_imu_mocap.load(MOCAP, name=name) for name in foot_imu_mocap.NAMES}


@pytest.fixture(scope="module")
def walks():
    return {walk: foot_imu_corridor.load(CORRIDOR, walk=walk) for walk in foot_imu_corridor.WALKS}


def imu(observed):
    """Times, specific forces and angular rates."""
    names = ("imu_time_s", "specific_force_m_per_s2", "angular_rate_rad_per_s")
    return tuple(observed[f"recording.{name}"][0].astype(float) for name in names)


def stride_track_m(time_s, force, rate, stance):
    """Dead reckoning from stance to stance, by means of its own: [s, 2], metres, x along the sensor's x.

    Each stride starts level and at rest, and the velocity that it ends with is taken off along it. Attitudes
    are SciPy's.
    """
    place, heading, track = 0j, 0.0, [0j]
    middle = [
        end - 10 if end - begin > 40 else (begin + end) // 2 for begin, end in zip(*stance, strict=True)
    ]
    bias = rate[: stance[1][0] - 100].mean(axis=0) if stance[1][0] > 200 else np.zeros(3)
    for first, last in pairwise(middle):
        up = force[first - 3 : first + 4].mean(axis=0)
        roll, pitch = np.arctan2(up[1], up[2]), np.arctan2(-up[0], np.hypot(up[1], up[2]))
        duration_s = np.diff(time_s[first : last + 1])[:, None]
        turns = Rotation.from_rotvec((rate[first + 1 : last + 1] - bias) * duration_s)
        attitude = [Rotation.from_euler("ZYX", [0.0, pitch, roll])]
        for turn in turns:
            attitude.append(attitude[-1] * turn)
        level = np.array([a.apply(f) for a, f in zip(attitude[1:], force[first + 1 : last + 1], strict=True)])
        velocity = np.cumsum((level - [0, 0, 9.80665]) * duration_s, axis=0)
        velocity -= np.linspace(0, 1, len(velocity))[:, None] * velocity[-1]
        way_m = (velocity * duration_s).sum(axis=0)
        place += np.exp(1j * heading) * (way_m[0] + 1j * way_m[1])
        heading += attitude[-1].as_euler("ZYX")[0]
        track.append(place)
    return np.stack([np.real(track), np.imag(track)], axis=-1)


def misfit_m(track_m, true_m):
    """Root mean square distance after the best turn and shift."""
    track, true = ((place - place.mean(axis=0)) @ [1, 1j] for place in (track_m, true_m))
    turn = np.vdot(track, true)
    return np.sqrt(np.mean(np.abs(track * turn / abs(turn) - true) ** 2))


def direction_rad(way_m):
    return np.arctan2(way_m[1], way_m[0])


# ---- all


CASES = [
    *(
        pytest.param(foot_imu_mocap, MOCAP, {"name": name, **more}, marks=needs(MOCAP))
        for name in foot_imu_mocap.NAMES[:1] + foot_imu_mocap.NAMES[-2:]
        for more in ({}, {"labels": "mbgtd", "align_strides": 3}, {"epochs": "stances"})
    ),
    *(
        pytest.param(foot_imu_corridor, CORRIDOR, {"walk": walk, "align_strides": 2}, marks=needs(CORRIDOR))
        for walk in (33, 34)
    ),
    pytest.param(foot_imu_loop, LOOP, {}, marks=needs(LOOP)),
]


@pytest.mark.parametrize(("adapter", "folder", "options"), CASES)
def test_one_world_of_the_agreed_shapes(adapter, folder, options):
    observed, truth = adapter.load(folder, **options)
    _, epochs = observed["recording.time_s"].shape
    _, readings = observed["recording.imu_time_s"].shape
    shapes = {
        "site.corner_m": (1, 2, 2),
        "recording.time_s": (1, epochs),
        "recording.imu_time_s": (1, readings),
        "recording.specific_force_m_per_s2": (1, readings, 3),
        "recording.angular_rate_rad_per_s": (1, readings, 3),
        "recording.start_heading_rad": (1,),
        "recording.start_position_m": (1, 2),
    }
    if adapter is foot_imu_corridor:
        shapes["recording.magnetic_field_ut"] = (1, readings, 3)
    assert {name: values.shape for name, values in observed.items()} == shapes
    assert all(np.isfinite(values).all() for values in observed.values())
    true_shapes = {"truth.position_m": (1, epochs, 2), "truth.path_m": (1, epochs, 2)}
    if adapter is foot_imu_mocap:
        _, count, _ = truth["truth.stance_time_s"].shape
        true_shapes |= {"truth.stance_time_s": (1, count, 2), "truth.stance_m": (1, count, 3)}
    if adapter is foot_imu_corridor:
        true_shapes["truth.stance_time_s"] = (1, epochs, 2)
    assert {name: values.shape for name, values in truth.items()} == true_shapes

    assert_array_equal(
        check_stack(Recording.from_arrays(observed), Site.from_arrays(observed), beacons=False), [epochs]
    )
    time_s, imu_time_s = observed["recording.time_s"][0], observed["recording.imu_time_s"][0]
    assert (np.diff(imu_time_s) > 0).all()
    assert np.isin(time_s, imu_time_s).all()
    # What is scored is the path, and begins after the first epoch, whose place the algorithms were given.
    position_m, path_m = truth["truth.position_m"][0], truth["truth.path_m"][0]
    scored = np.isfinite(position_m).all(axis=1)
    assert not scored[0]
    assert scored[-1]
    assert_array_equal(position_m[scored], path_m[scored])
    low_m, high_m = observed["site.corner_m"][0]
    known_m = path_m[np.isfinite(path_m).all(axis=1)]
    assert ((known_m >= low_m) & (known_m <= high_m)).all()
    if "truth.stance_time_s" in truth:
        stance_s = truth["truth.stance_time_s"][0]
        assert np.isin(stance_s, imu_time_s).all()
        assert (stance_s[:, 0] <= stance_s[:, 1]).all()
        assert (stance_s[1:, 0] > stance_s[:-1, 1]).all()


@pytest.mark.parametrize(
    ("adapter", "folder", "every"),
    [
        pytest.param(
            foot_imu_mocap, MOCAP, [{"name": name} for name in foot_imu_mocap.NAMES], marks=needs(MOCAP)
        ),
        pytest.param(
            foot_imu_corridor,
            CORRIDOR,
            [{"walk": walk} for walk in foot_imu_corridor.WALKS],
            marks=needs(CORRIDOR),
        ),
        pytest.param(foot_imu_loop, LOOP, [{}], marks=needs(LOOP)),
        pytest.param(
            phone_wifi_imu_library,
            LIBRARY,
            [{"query": ["t1", "t2", "t3"]}, {"walks": ["final1", "final2"]}],
            marks=needs(LIBRARY),
        ),
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
    assert {record.file for record in check_files(folder, folder.name)} == read


@pytest.mark.parametrize(
    ("adapter", "options", "words"),
    [
        (foot_imu_mocap, {"name": "2018"}, ["option name", "'2018'", "2017-11-22-11-22-03, "]),
        (foot_imu_mocap, {"epochs": "some"}, ["option epochs", "'some' is none of all, stances"]),
        (foot_imu_mocap, {"labels": "truth"}, ["option labels", "'truth'", "best, vicon, shoe"]),
        (foot_imu_mocap, {"align_strides": 0}, ["option align_strides", "0 is no whole number above"]),
        (foot_imu_mocap, {"align_strides": 1.5}, ["option align_strides", "1.5 is no whole number"]),
        (foot_imu_mocap, {}, ["2017-11-22-11-22-03.mat", "no such file"]),
        (foot_imu_corridor, {"walk": 32}, ["option walk", "32 is none of 31, 33, 34, 36"]),
        (foot_imu_corridor, {"align_strides": True}, ["option align_strides", "True is no whole number"]),
        (foot_imu_corridor, {}, ["SensorConnectData_31.csv", "no such file"]),
        (foot_imu_loop, {}, ["short_walk.csv", "no such file"]),
        (phone_wifi_imu_library, {"map": "final3"}, ["option map", "final3 is not one or several", "t3"]),
        (phone_wifi_imu_library, {"map": []}, ["option map", "an empty list"]),
        (phone_wifi_imu_library, {"query": ["t1", "t1"]}, ["option query", "t1, t1 is not", "different"]),
        (phone_wifi_imu_library, {"query": "final1"}, ["option query", "final1 is part of the map"]),
        (phone_wifi_imu_library, {"run": 4}, ["option run", "4 is no walk of t1"]),
        (phone_wifi_imu_library, {"query": ["t1", "t2"], "run": 1}, ["option run", "1 is no walk of t1 and"]),
        (phone_wifi_imu_library, {}, ["train_final1", "no such folder"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path, adapter, options, words):
    with pytest.raises(InputError) as caught:
        adapter.load(tmp_path, **options)
    assert all(word in str(caught.value) for word in words), str(caught.value)


# ---- the motion-capture room


@needs(MOCAP)
def test_mocap_durations_paths_and_rest_of_all_trials(trials):
    assert len(trials) == 14
    duration_s, path_m, share = [], 0.0, []
    for name, (observed, truth) in trials.items():
        time_s, force, _ = imu(observed)
        duration_s.append(time_s[-1] - time_s[0])
        # The publisher's lengths are those of every reading, with the tracker's noise.
        raw_m = loadmat(MOCAP / f"{name}.mat")["gt"][:, :2]
        path_m += np.linalg.norm(np.diff(raw_m, axis=0), axis=1).sum()
        assert_allclose(np.median(np.diff(time_s)), 1 / 200, rtol=0.02)
        assert_allclose(np.diff(observed["recording.time_s"][0]), 0.1, atol=0.006)
        # The foot rests at the start: gravity along z, but for the tilt of the shoe.
        rest = force[: int(200 * 0.3)].mean(axis=0)
        assert 9.75 < np.linalg.norm(rest) < 9.95
        assert 0.85 < rest[2] / np.linalg.norm(rest) < 0.97
        share.append(np.diff(truth["truth.stance_time_s"][0], axis=1).sum() / duration_s[-1])
    assert_allclose(sum(duration_s), 394, atol=0.5)
    assert_allclose(path_m, 382, atol=1.5)
    assert 0.15 < min(share) < max(share) < 0.55


@needs(MOCAP)
@pytest.mark.parametrize("name", ["2017-11-22-11-22-03", "2017-12-15-18-00-13", TURNED])
def test_mocap_frames_have_the_same_hand(trials, name):
    """A track of the sensors fits the truth by a turn and a shift; it would not fit its mirror image."""
    observed, truth = trials[name]
    time_s, force, rate = imu(observed)
    begin, end = stances(time_s, rate)
    middle_s = time_s[(begin + end) // 2]
    path_m, known = truth["truth.path_m"][0], np.isfinite(truth["truth.path_m"][0, :, 0])
    true_m = np.stack(
        [np.interp(middle_s, observed["recording.time_s"][0][known], path_m[known, axis]) for axis in (0, 1)],
        axis=-1,
    )
    track_m = stride_track_m(time_s, force, rate, (begin, end))
    assert misfit_m(track_m, true_m) < 0.25
    assert misfit_m(track_m, true_m * [1, -1]) > 1.0


@needs(MOCAP)
def test_mocap_alignment_is_the_first_stride(trials):
    for name, (observed, truth) in trials.items():
        time_s, path_m = observed["recording.time_s"][0], truth["truth.path_m"][0]
        scored = np.isfinite(truth["truth.position_m"][0, :, 0])
        first = int(np.argmax(scored))
        assert_array_equal(scored[first:], np.isfinite(path_m[first:, 0]))
        start_m = observed["recording.start_position_m"][0]
        assert np.hypot(*(path_m[0] - start_m)) < 0.05
        # Half a stride to one and a half, done within two seconds of the first move.
        way_m = path_m[first] - start_m
        assert 0.35 < np.hypot(*way_m) < 1.5, name
        moved = np.linalg.norm(path_m - start_m, axis=1) > 0.1
        assert 0.3 < time_s[first] - time_s[np.argmax(moved)] < 2
        off_rad = direction_rad(way_m) - observed["recording.start_heading_rad"][0]
        assert abs(np.angle(np.exp(1j * off_rad))) < np.radians(3)
    more = foot_imu_mocap.load(MOCAP, name=TURNED, align_strides=2)
    fewer = trials[TURNED]
    scored = [np.isfinite(worlds.truth["truth.position_m"][0, :, 0]).sum() for worlds in (more, fewer)]
    assert 5 < scored[1] - scored[0] < 20
    with pytest.raises(InputError, match=r"option align_strides: 99 of \d+ strides would leave none"):
        foot_imu_mocap.load(MOCAP, align_strides=99)


@needs(MOCAP)
def test_mocap_places_that_the_tracker_held_are_no_truth(trials):
    held = {name: np.isnan(truth["truth.path_m"][0]).any(axis=1).sum() for name, (_, truth) in trials.items()}
    assert {name for name, count in held.items() if count} == HELD
    assert max(held.values()) <= 8
    # Labels that believe the tracker call these places rest.
    observed, truth = foot_imu_mocap.load(MOCAP, name="2017-12-15-17-59-19", labels="vicon")
    lost_s = observed["recording.time_s"][0][np.isnan(truth["truth.path_m"][0, :, 0])]
    begin_s, end_s = truth["truth.stance_time_s"][0].T
    assert ((lost_s[:, None] >= begin_s) & (lost_s[:, None] <= end_s)).any(axis=1).sum() >= 4


@needs(MOCAP)
def test_mocap_labels_are_those_that_are_asked_for(trials):
    for name in (foot_imu_mocap.NAMES[0], foot_imu_mocap.NAMES[3]):
        content = loadmat(MOCAP / f"{name}.mat")
        best = content["best_detector"][0]
        for labels in foot_imu_mocap.LABELS:
            _, truth = foot_imu_mocap.load(MOCAP, name=name, labels=labels)
            mask = content[f"zv_{best if labels == 'best' else labels}_opt"][0] > 0
            begin_s, end_s = truth["truth.stance_time_s"][0].T
            time_s = content["ts"][0]
            inside = ((time_s[:, None] >= begin_s) & (time_s[:, None] <= end_s)).any(axis=1)
            assert_array_equal(inside, mask)


@needs(MOCAP)
def test_mocap_epochs_at_stances_are_those_of_the_sensors(trials):
    """Stances of the tracker's speed are as many as those of the gyroscope, but for running."""
    more = {"2017-11-27-11-13-41": 3, "2017-12-15-18-01-18": 1}
    for name, (every, true) in trials.items():
        observed, truth = foot_imu_mocap.load(MOCAP, name=name, epochs="stances")
        time_s, _, rate = imu(observed)
        begin, end = stances(time_s, rate)
        assert observed["recording.time_s"].shape[1] == len(begin) + more.get(name, 0)
        if name not in more:
            epoch_s = observed["recording.time_s"][0]
            # Late in a stance, and long before the next one; a few feet hardly move behind it for a while.
            assert ((epoch_s > time_s[begin]) & (epoch_s < time_s[end - 1] + 0.4)).all()
            assert (epoch_s[:-1] < time_s[begin[1:]]).all()
            assert np.mean(epoch_s > (time_s[begin] + time_s[end - 1]) / 2) > 0.9
            assert np.mean(epoch_s < time_s[end - 1] + 0.15) > 0.9
        for part in ("start_heading_rad", "start_position_m"):
            assert_array_equal(observed[f"recording.{part}"], every[f"recording.{part}"])
        assert_array_equal(np.flatnonzero(np.isnan(truth["truth.position_m"][0, :, 0])), [0, 1])
        assert np.isfinite(truth["truth.path_m"]).all()
        epoch_s = every["recording.time_s"][0]
        near = np.argmin(np.abs(epoch_s[:, None] - observed["recording.time_s"][0]), axis=0)
        off_m = np.linalg.norm(true["truth.path_m"][0, near] - truth["truth.path_m"][0], axis=1)
        # At the last still reading the foot begins to roll.
        assert np.nanmedian(off_m) < 0.04


def write_trial(folder, name=foot_imu_mocap.NAMES[0], **changes):
    """Three strides of a metre along x, then one along the room's y; the labels are the standing."""
    leg = np.concatenate([np.zeros(60), np.linspace(0, 1, 61)[1:]])
    along = np.concatenate([leg, 1 + leg, 2 + leg, np.full(180, 3.0)])
    across = np.concatenate([np.zeros(360), leg, np.ones(60)])
    place = np.stack([along - 1, across, np.full(540, 0.1)], axis=-1)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(place.shape)
    standing = (np.arange(540) % 120) < 60
    content = {
        "ts": (np.arange(540) + 1)[None] / 200,
        "imu": np.tile([1.0, 2.0, -9.7, 0.1, 0.2, 0.3], (540, 1)),
        "gt": place + noise,
        "best_detector": np.array(["shoe"]),
        **{f"zv_{kind}_opt": np.zeros((1, 540)) for kind in foot_imu_mocap.DETECTORS},
        "zv_shoe_opt": standing[None].astype(float),
        **changes,
    }
    savemat(folder / f"{name}.mat", {key: value for key, value in content.items() if value is not None})
    return content


def test_mocap_of_a_written_file(tmp_path):
    content = write_trial(tmp_path)
    observed, truth = foot_imu_mocap.load(tmp_path)
    assert_allclose(observed["recording.specific_force_m_per_s2"][0, 7], [1, -2, 9.7])
    assert_allclose(observed["recording.angular_rate_rad_per_s"][0, 7], [0.1, -0.2, -0.3])
    assert_allclose(observed["recording.time_s"][0], np.arange(27) / 10 + 0.005)
    assert_allclose(truth["truth.path_m"][0], content["gt"][::20, :2] * [1, -1])
    assert_allclose(observed["recording.start_position_m"], [[-1, 0]], atol=1e-3)
    assert_allclose(observed["recording.start_heading_rad"], 0, atol=1e-3)
    assert_allclose(
        truth["truth.stance_time_s"][0], [[0.005 + 0.6 * k, 0.3 + 0.6 * k] for k in range(5)], atol=1e-12
    )
    assert_allclose(truth["truth.stance_m"][0, :, :2], [[-1, 0], [0, 0], [1, 0], [2, 0], [2, -1]], atol=1e-3)
    # The second stance begins with reading 120: what comes before is alignment.
    scored = np.isfinite(truth["truth.position_m"][0, :, 0])
    assert 0.6 < observed["recording.time_s"][0, scored][0] < 0.75
    # Three strides along x and one to the right of it, as the room's y is turned round.
    turned = foot_imu_mocap.load(tmp_path, align_strides=3).observed["recording.start_heading_rad"]
    assert_allclose(turned, 0, atol=1e-3)
    write_trial(tmp_path, gt=content["gt"][:, [1, 0, 2]])
    for strides, expected in ((1, -np.pi / 2), (3, -np.pi / 2)):
        (heading_rad,) = foot_imu_mocap.load(tmp_path, align_strides=strides).observed[
            "recording.start_heading_rad"
        ]
        assert_allclose(heading_rad, expected, atol=1e-3)


def test_mocap_epochs_are_the_last_still_readings_of_a_written_file(tmp_path):
    place = write_trial(tmp_path)["gt"].copy()
    still = foot_imu_mocap.load(tmp_path, epochs="stances")
    # Stances end with the readings 59, 179, ...; the speed over 11 readings tells it five readings early, and
    # the noise of the places does the rest.
    ends_s = np.array([60, 180, 300, 420, 540]) / 200
    assert_allclose(still.observed["recording.time_s"][0], ends_s, atol=0.03)
    assert_allclose(still.truth["truth.path_m"][0], [[-1, 0], [0, 0], [1, 0], [2, 0], [2, -1]], atol=1e-3)
    # A shake in a stance does not end it, and does not make two of it.
    place[145:151, 0] += np.array([1, 2, 3, 3, 2, 1]) * 0.02
    write_trial(tmp_path, gt=place)
    shaken = foot_imu_mocap.load(tmp_path, epochs="stances")
    assert_array_equal(shaken.observed["recording.time_s"], still.observed["recording.time_s"])


def test_mocap_held_places_of_a_written_file(tmp_path):
    place = write_trial(tmp_path)["gt"].copy()
    place[198:204] = place[198]
    place[258:261] = place[258]
    place[480:] = place[480]
    write_trial(tmp_path, gt=place)
    _, truth = foot_imu_mocap.load(tmp_path)
    # Epochs are the readings 0, 20, ...: 200 was held, 260 in a run of three was not, and the end was.
    assert_array_equal(np.flatnonzero(np.isnan(truth["truth.path_m"][0, :, 0])), [10, 24, 25, 26])
    assert_array_equal(np.isnan(truth["truth.stance_m"][0, :, 0]), [False] * 4 + [True])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gt": None}, "'gt'"),
        ({"gt": np.zeros((540, 2))}, r"gt \(540, 2\) .*do not fit ts"),
        ({"imu": np.full((540, 6), np.nan)}, "a value is not finite"),
        ({"ts": np.ones((1, 540))}, "the time does not increase"),
        ({"best_detector": np.array(["guess"])}, "'guess' is no detector"),
    ],
)
def test_mocap_damaged_files_are_named(tmp_path, changes, message):
    write_trial(tmp_path, **changes)
    with pytest.raises(InputError, match=rf"file 2017-11-22-11-22-03\.mat: .*{message}"):
        foot_imu_mocap.load(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"no such thing" * 20, "Unknown mat file type"),
        (b"", "truncated"),
        (b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400), r"MATLAB's version 7\.3"),
    ],
)
def test_mocap_a_damaged_container_is_named(tmp_path, content, message):
    (tmp_path / f"{foot_imu_mocap.NAMES[0]}.mat").write_bytes(content)
    with pytest.raises(InputError, match=rf"11-22-03\.mat: .*cannot be read .*{message}"):
        foot_imu_mocap.load(tmp_path)


# ---- the corridors


@needs(CORRIDOR)
@pytest.mark.parametrize(
    ("walk", "rows", "duration_s", "strides", "length_m", "gap_m"),
    [
        (31, 8549, 43, 33, 47.9, 15.02),
        (33, 11000, 55, 47, 64.2, 1.78),
        (34, 5200, 26, 24, 39.8, 0.64),
        (36, 14000, 70, 58, 76.3, 1.07),
    ],
)
def test_corridor_rows_strides_and_paths(walks, walk, rows, duration_s, strides, length_m, gap_m):
    observed, truth = walks[walk]
    time_s, force, _ = imu(observed)
    assert time_s.shape == (rows,)
    assert time_s[0] == 0
    assert_allclose(time_s[-1], duration_s, atol=0.5)
    path_m = truth["truth.path_m"][0]
    assert len(path_m) == strides + 1
    assert_allclose(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum(), length_m, atol=0.05)
    assert_allclose(np.hypot(*(path_m[-1] - path_m[0])), gap_m, atol=0.005)
    assert_allclose(np.linalg.norm(force[:200].mean(axis=0)), 9.82, atol=0.01)
    assert force[:200, 2].mean() > 7
    field_ut = np.linalg.norm(observed["recording.magnetic_field_ut"][0], axis=1)
    assert 15 < np.percentile(field_ut, 1) < np.median(field_ut) < 65


@needs(CORRIDOR)
@pytest.mark.parametrize("walk", foot_imu_corridor.WALKS)
def test_corridor_control_points_are_paired_with_their_stances(walks, walk):
    """Lengths of strides by means of the test's own agree, one by one; shifted by one they do not."""
    observed, truth = walks[walk]
    time_s, force, rate = imu(observed)
    track_m = stride_track_m(time_s, force, rate, stances(time_s, rate))
    own_m, true_m = (
        np.linalg.norm(np.diff(place_m, axis=0), axis=1) for place_m in (track_m, truth["truth.path_m"][0])
    )
    agreed_m = np.median(np.abs(own_m - true_m))
    assert agreed_m < 0.03
    for shift in (-1, 1):
        assert np.median(np.abs(own_m - np.roll(true_m, shift))) > 1.5 * agreed_m
    assert np.corrcoef(own_m[1:], true_m[1:])[0, 1] > 0.85
    # Forward is x: strides of the first straight part lead along it.
    first = np.array([direction_rad(way_m) for way_m in np.diff(track_m, axis=0)[1:4]])
    assert (np.abs(first) < np.radians(60)).all()


@needs(CORRIDOR)
@pytest.mark.parametrize("walk", foot_imu_corridor.WALKS)
def test_corridor_epochs_are_stances_and_the_first_strides_align(walks, walk):
    observed, truth = walks[walk]
    time_s, path_m = observed["recording.time_s"][0], truth["truth.path_m"][0]
    begin_s, end_s = truth["truth.stance_time_s"][0].T
    assert_array_equal(time_s, end_s)
    assert begin_s[0] == 0
    assert (begin_s[1:] - end_s[:-1] >= LEAST_SWING_S).all()
    assert (np.diff(time_s)[1:-1] < 2).all()
    assert_array_equal(np.isnan(truth["truth.position_m"][0, :, 0]), np.arange(len(time_s)) < 4)
    assert_array_equal(observed["recording.start_position_m"][0], path_m[0])
    assert_array_equal(observed["recording.start_heading_rad"][0], direction_rad(path_m[3] - path_m[0]))
    # The corridors lie along the tiles.
    assert abs(observed["recording.start_heading_rad"][0]) < np.radians(2)


@settings(max_examples=40, deadline=None)
@given(
    swings_s=st.lists(st.floats(0.45, 0.6), min_size=1, max_size=6),
    rests_s=st.lists(st.floats(0.2, 1.0), min_size=7, max_size=7),
    pause=st.booleans(),
)
def test_stances_are_found_where_the_foot_stands(swings_s, rests_s, pause):
    """Known stances are found to half a window, also where the foot is slow for a moment in mid-swing."""
    pieces, edges, count = [], [], 0
    for rest_s, swing_s in zip(rests_s, [*swings_s, 0.0], strict=False):
        rest, swing = int(200 * (rest_s + 0.1)), int(200 * (swing_s + 0.05)) if swing_s else 0
        edges.append((count, count + rest))
        turning = np.full(swing, 4.0)
        if pause and swing:
            middle = swing // 2
            turning[middle - 8 : middle + 8] = 0.1
        pieces += [np.full(rest, 0.1), turning]
        count += rest + swing
    size = np.concatenate(pieces)
    rate = size[:, None] * np.array([0.48, 0.6, 0.64])
    begin, end = stances(np.arange(count) / 200, rate)
    assert len(begin) == len(edges)
    assert_allclose(begin, [first for first, _ in edges], atol=8)
    assert_allclose(end, [last for _, last in edges], atol=8)


CORRIDOR_COLUMNS = [
    "Time",
    *(f"unit-1:scaled{kind}{axis}" for kind in ("Accel", "Gyro", "Mag") for axis in "XYZ"),
]


def write_walk(
    folder, header=CORRIDOR_COLUMNS, places=((0, 0), (0, 1), (0, 2), (0, 3)), strides=None, bad=None
):
    """Four stances of half a second, three swings of the same length."""
    rows = [",".join(header)]
    for index in range(700):
        turning = 3.0 if (index // 100) % 2 else 0.0
        values = [
            f"{7 + index / 200:.3f}",
            "0.5",
            "0.25",
            "-0.75",
            "0",
            f"{turning}",
            "0.1",
            "0.2",
            "0.3",
            "-0.4",
        ]
        rows.append(",".join(values))
    if bad is not None:
        rows[5] = bad
    (folder / "SensorConnectData_31.csv").write_text("\n".join(rows) + "\n")
    count = len(places) - 1 if strides is None else strides
    savemat(
        folder / "SensorConnectData_31.mat",
        {
            "GCP_meters": np.array(places, dtype=float),
            "GCP_stride_numbers": np.arange(len(places))[None],
            "numberOfStrides": np.array([[count]]),
        },
    )


def test_corridor_of_a_written_file(tmp_path):
    write_walk(tmp_path)
    observed, truth = foot_imu_corridor.load(tmp_path, align_strides=2)
    g = 9.80665
    assert_allclose(observed["recording.specific_force_m_per_s2"][0, 3], [-0.5 * g, 0.25 * g, 0.75 * g])
    assert_allclose(observed["recording.angular_rate_rad_per_s"][0, 103], [0, 3, -0.1])
    assert_allclose(observed["recording.magnetic_field_ut"][0, 3], [-20, 30, 40])
    assert_allclose(observed["recording.imu_time_s"][0, [0, -1]], [0, 699 / 200], atol=1e-9)
    assert_allclose(observed["recording.time_s"], [[0.465, 1.465, 2.465, 3.495]], atol=0.006)
    assert_array_equal(truth["truth.position_m"], [[[np.nan] * 2] * 3 + [[0, 3]]])
    assert_allclose(observed["recording.start_heading_rad"], np.pi / 2)
    with pytest.raises(InputError, match=r"option align_strides: 3 of 3 strides would leave none"):
        foot_imu_corridor.load(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"places": ((0, 0), (0, 1), (0, 2))}, r"31\.csv: 4 stances are found, 3 control points"),
        ({"strides": 4}, r"31\.mat: .*shape \(4, 2\) for 4 strides"),
        ({"places": ((0, 0), (0, np.nan), (0, 2), (0, 3))}, r"31\.mat: .*a place is not finite"),
        ({"header": [c.replace("Mag", "Field") for c in CORRIDOR_COLUMNS]}, r"31\.csv: .*scaledMagX"),
        ({"bad": "7.02,0.5,,-0.75,0,0,0.1,0.2,0.3,-0.4"}, r"31\.csv: .*a cell is empty"),
        ({"bad": "7.01,0.5,0.2,-0.75,0,0,0.1,0.2,0.3,-0.4"}, r"31\.csv: .*the time does not increase"),
        ({"bad": "7.02,0.5,far,-0.75,0,0,0.1,0.2,0.3,-0.4"}, r"31\.csv: .*far"),
    ],
)
def test_corridor_damaged_files_are_named(tmp_path, changes, message):
    write_walk(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
        foot_imu_corridor.load(tmp_path, align_strides=1)


# ---- the loop


@needs(LOOP)
def test_loop_rows_rest_stances_and_way():
    observed, truth = foot_imu_loop.load(LOOP)
    time_s, force, rate = imu(observed)
    assert len(time_s) == 16539 - 205
    assert_allclose(time_s[-1], 41.6, atol=0.05)
    step_s = np.diff(time_s)
    assert_allclose([np.median(step_s), step_s.max()], [1 / 398, 0.0126], rtol=0.01)
    assert (step_s > 0.004).sum() == 165
    begin, end = stances(time_s, rate)
    assert len(begin) == 17
    resting = np.concatenate([np.arange(b + 20, e - 20) for b, e in zip(begin, end, strict=True)])
    assert_allclose(np.linalg.norm(force[resting], axis=1).mean() / 9.80665, 1.002, atol=0.004)
    assert_allclose((end - begin).sum() / len(time_s), 0.68, atol=0.06)
    # Forward is x and up is z, and the way has the length that its publisher says.
    assert force[:400].mean(axis=0) @ [0, 0, 1] > 8
    track_m = stride_track_m(time_s, force, rate, (begin, end))
    assert_allclose(np.linalg.norm(np.diff(track_m, axis=0), axis=1).sum(), 25, atol=3)
    assert np.median(np.diff(track_m, axis=0)[1:4] @ [1, 0]) > 1
    assert_array_equal(truth["truth.position_m"], [[[np.nan, np.nan], [0, 0]]])
    assert_array_equal(observed["recording.time_s"], [[0, time_s[-1]]])


LOOP_HEADER = ",".join(
    ["Time (s)", *(f"Gyroscope {a} (deg/s)" for a in "XYZ"), *(f"Accelerometer {a} (g)" for a in "XYZ")]
)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["2,90,0,-180,1,0,0.5", "1,90,0,0,1,0,0.5"], "the time does not increase"),
        (["1,90,0,-180,1,0,0.5", "1,90,0,0,1,0,0.5"], "the time does not increase"),
        (["1,90,0,-180,1,,0.5", "2,90,0,0,1,0,0.5"], "a cell is empty"),
        ([], "there is no row"),
    ],
)
def test_loop_of_a_written_file(tmp_path, rows, message):
    good = ["1.5,90,0,-180,1,0,0.5", "1.6,180,0,0,0,0,1", "1.6,180,0,0,0,0,1", "1.75,0,90,0,0,2,1"]
    (tmp_path / "short_walk.csv").write_text("\n".join([LOOP_HEADER, *good]) + "\n")
    observed, _ = foot_imu_loop.load(tmp_path)
    assert_allclose(observed["recording.imu_time_s"], [[0, 0.1, 0.25]])
    assert_allclose(
        observed["recording.angular_rate_rad_per_s"][0] / np.pi, [[0.5, 0, -1], [1, 0, 0], [0, 0.5, 0]]
    )
    assert_allclose(
        observed["recording.specific_force_m_per_s2"][0] / 9.80665, [[1, 0, 0.5], [0, 0, 1], [0, 2, 1]]
    )
    (tmp_path / "short_walk.csv").write_text("\n".join([LOOP_HEADER, *rows]) + "\n")
    with pytest.raises(InputError, match=rf"file short_walk\.csv: .*{message}"):
        foot_imu_loop.load(tmp_path)


# ---- the library


@needs(LIBRARY)
@pytest.mark.parametrize(
    ("maps", "queries", "rows", "mean_m", "median_m"),
    [
        (["final1"], ["final2"], (729, 682), 5.05, 4.40),
        (["final1", "final2"], ["t1", "t2", "t3"], (1411, 361), 5.36, 4.97),
    ],
)
def test_library_rows_and_accuracy_of_four_neighbours(maps, queries, rows, mean_m, median_m):
    """The description's figures, to what the order of equally near neighbours leaves open."""
    observed, truth = phone_wifi_imu_library.load(LIBRARY, map=maps, query=queries)
    survey_dbm, query_dbm = (observed[f"{part}.rss_dbm"][0] for part in ("survey", "query"))
    assert (len(survey_dbm), len(query_dbm)) == rows
    for dbm in (survey_dbm, query_dbm):
        assert dbm.shape[1] == 22
        assert -100 < np.nanmin(dbm) < np.nanmax(dbm) <= -25
    assert "recording.time_s" not in observed
    position_m = observed["survey.position_m"][0]
    assert_array_equal(observed["site.corner_m"][0], [position_m.min(axis=0), position_m.max(axis=0)])
    assert_allclose(observed["site.corner_m"][0], [[0, 0], [29, 45]], atol=0.5)
    near = KNeighborsRegressor(4).fit(np.nan_to_num(survey_dbm, nan=-100), position_m)
    error_m = np.linalg.norm(
        near.predict(np.nan_to_num(query_dbm, nan=-100)) - truth["truth.position_m"][0], axis=1
    )
    assert_allclose([error_m.mean(), np.median(error_m)], [mean_m, median_m], atol=0.02)


@needs(LIBRARY)
def test_library_a_run_is_query_and_recording():
    everything = phone_wifi_imu_library.load(LIBRARY, query="t2")
    parts = [phone_wifi_imu_library.load(LIBRARY, query="t2", run=run) for run in (1, 2, 3, 4, 5)]
    for name in ("query.rss_dbm", "recording.rss_dbm"):
        together = np.concatenate([worlds.observed[name][0] for worlds in parts])
        assert_array_equal(together, everything.observed["query.rss_dbm"][0])
    places = np.concatenate([worlds.truth["truth.position_m"][0] for worlds in parts])
    assert_array_equal(places, everything.truth["truth.position_m"][0])
    for (observed, truth), rows in zip(parts, (17, 21, 25, 28, 27), strict=True):
        assert_array_equal(observed["recording.time_s"], [np.arange(rows)])
        assert_array_equal(
            check_stack(Recording.from_arrays(observed), Site.from_arrays(observed), beacons=False), [rows]
        )
        # Walking speed, interpolated by the publisher.
        assert 0.5 < np.median(np.linalg.norm(np.diff(truth["truth.position_m"][0], axis=0), axis=1)) < 1.2
        assert np.isnan(observed["query.rss_dbm"]).mean() > 0.03


def write_library(folder, text="-40,-100" + 20 * ",-70" + ",1.5,2\n-41,-90" + 20 * ",-71" + ",1.5,3\n"):
    for part, count in phone_wifi_imu_library.WALKS.values():
        (folder / part).mkdir(exist_ok=True)
        for number in range(1, count + 1):
            (folder / part / f"rss{number}.txt").write_text(text)


def test_library_of_a_written_file(tmp_path):
    write_library(tmp_path)
    observed, truth = phone_wifi_imu_library.load(tmp_path, map="final2", query="t3", run=8)
    assert observed["survey.rss_dbm"].shape == (1, 8, 22)
    assert_array_equal(observed["query.rss_dbm"][0, :, :3], [[-40, np.nan, -70], [-41, -90, -71]])
    assert_array_equal(observed["recording.rss_dbm"], observed["query.rss_dbm"])
    assert_array_equal(truth["truth.position_m"], [[[1.5, 2], [1.5, 3]]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("-40" + 21 * ",-70" + ",1\n", "there are 23 columns"),
        ("-40" + 21 * ",-70" + ",,2\n", "a cell is empty"),
        ("40" + 21 * ",-70" + ",1,2\n", "not below 0 dBm"),
        ("here" + 21 * ",-70" + ",1,2\n", "here"),
        ("", "columns"),
    ],
)
def test_library_damaged_files_are_named(tmp_path, text, message):
    write_library(tmp_path)
    (tmp_path / "train_final1" / "rss2.txt").write_text(text)
    with pytest.raises(InputError, match=rf"file train_final1/rss2\.txt: .*{message}"):
        phone_wifi_imu_library.load(tmp_path)


@pytest.mark.slow
@needs(MOCAP)
def test_the_control_row_of_the_study_keeps_the_shape_of_every_trial():
    """Dead reckoning by steps with the stored labels, as configured and scored; no trial is left out."""
    study = read_yaml(CHECKOUT / "config" / "config.yaml")["studies"]["foot_real"]
    row = study["algorithms"]["control_known_stances"]
    inertial = {"task": "tracking", **row["inertial"]}
    control = factory("control_known_stances", "tracking", row | {"inertial": inertial})
    estimates, worlds, made = {}, {}, 0
    for name, line in study["recordings"].items():
        if line["adapter"] != "foot_imu_mocap":
            continue
        options = {key: value for key, value in line.items() if key not in ("adapter", "source")}
        observed, truth = foot_imu_mocap.load(MOCAP, **options)
        found = tracking.run(control, observed, truth, {}, [np.random.default_rng(0)])
        step = {"world": np.array([0]), "value": np.asarray(np.nan), "skipped": np.asarray(found.skipped)}
        step |= {f"estimate.{key}": values for key, values in found.estimates.items()}
        estimates[f"r/control/{name}.npz"] = {"real/0": step}
        worlds |= {f"d/{name}/observed.npz": {"real": observed}, f"d/{name}/truth.npz": {"real": truth}}
        made += 1
    frame = foot_real.measures(estimates, worlds)
    rigid_m = frame[frame["metric"] == "rigid_mean_m"]["x"]
    assert made == len(rigid_m) == len(foot_imu_mocap.NAMES) == 14
    assert rigid_m.mean() < 0.12


@pytest.mark.slow
@needs(MOCAP)
def test_the_filter_with_stored_rest_labels_keeps_the_shape_of_every_trial(trials):
    """Strapdown and error-state filter against motion capture: no trial is left out."""
    mean_m = []
    for name, (observed, truth) in trials.items():
        recording, site = Recording.from_arrays(observed), Site.from_arrays(observed)
        begin, end = truth["truth.stance_time_s"][0].T
        time_s = recording.imu_time_s[0][:, None]
        labelled = ((time_s >= begin) & (time_s <= end)).any(axis=1)
        settings = FootFilter(alignment_s=0.01)
        found = foot_navigation(recording, site, settings, rest=labelled[None]).at(recording.time_s)
        true_m = truth["truth.position_m"]
        asked = np.isfinite(true_m).all(axis=-1)
        angle_rad, shift_m = rigid_fit(found.position_m[..., :2], true_m, asked)
        fitted_m = rotated(found.position_m[..., :2], angle_rad[:, None]) + shift_m[:, None]
        mean_m.append(np.linalg.norm(fitted_m - true_m, axis=-1)[asked].mean())
        assert mean_m[-1] < 0.2, name
    assert len(mean_m) == 14
    assert np.mean(mean_m) < 0.12
