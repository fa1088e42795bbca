"""The adapters of recordings with strengths of transmitters at known places: facts, defects, refusals."""

import csv
import json
import os
from datetime import datetime, timedelta
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import least_squares
from sklearn.neighbors import KNeighborsRegressor

from positioning.errors import InputError
from positioning.recordings import ble_ar_tracks, ble_three_beacon_rooms, rss_multilateration
from positioning.recordings.register import find_file, read_register

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
ROOMS = REALDATA / "ble_three_beacon_rooms"
ANCHORS = REALDATA / "rss_multilateration"
TRACKS = REALDATA / "ble_ar_tracks"


def needs(folder):
    return pytest.mark.skipif(not folder.is_dir(), reason=f"no recordings in {folder} (REPOSITION_REALDATA)")


CASES = [
    *(
        pytest.param(
            ble_three_beacon_rooms,
            ROOMS,
            {"scenario": scenario, "technology": technology, "points": points},
            marks=needs(ROOMS),
        )
        for scenario, technology, points in product((1, 2), ("ble", "wifi", "zigbee"), ("tests", "database"))
    ),
    *(
        pytest.param(rss_multilateration, ANCHORS, {"technology": technology}, marks=needs(ANCHORS))
        for technology in ("ble", "wifi")
    ),
    *(
        pytest.param(ble_ar_tracks, TRACKS, {"track": track}, marks=needs(TRACKS))
        for track in ("straight_02", "straight_03", "rectangular_with_rotation")
    ),
]


ROUNDED = (0.051, 0.0051, 0.051)
"""Half a digit of level, exponent and residual as they are written here."""


def assert_near(actual, expected, within):
    offset = np.abs(np.subtract(actual, expected))
    assert (offset <= within).all(), (actual, expected)


def path_loss(distance_m, rss_dbm):
    """Level at 1 m, exponent, and root mean square of the residuals of a log-distance fit."""
    slope, level_dbm = np.polyfit(np.log10(distance_m), rss_dbm, 1)
    residual_db = rss_dbm - level_dbm - slope * np.log10(distance_m)
    return level_dbm, -slope / 10, np.sqrt(np.mean(residual_db**2))


def calibrated(observed):
    return path_loss(observed["calibration.distance_m"][0], observed["calibration.rss_dbm"][0])


def trilaterated_m(observed):
    """Plain least squares of the distances that the log-distance fit gives, by an independent library."""
    level_dbm, exponent, _ = calibrated(observed)
    beacon_m = observed["site.access_point_m"][0]
    range_m = 10 ** ((level_dbm - observed["recording.rss_dbm"][0]) / (10 * exponent))
    return np.array(
        [
            least_squares(
                lambda place_m, measured_m: np.linalg.norm(beacon_m - place_m, axis=1) - measured_m,
                beacon_m.mean(axis=0),
                args=(measured_m,),
            ).x
            for measured_m in range_m
        ]
    )


def mean_error_m(estimate_m, truth):
    return np.linalg.norm(estimate_m - truth["truth.position_m"][0], axis=1).mean()


# ---- all three


@pytest.mark.parametrize(("adapter", "folder", "options"), CASES)
def test_one_world_of_the_agreed_arrays(adapter, folder, options):
    observed, truth = adapter.load(folder, **options)
    _, epochs, beacons = observed["recording.rss_dbm"].shape
    (_, pairs) = observed["calibration.rss_dbm"].shape
    assert {name: values.shape for name, values in observed.items()} == {
        "site.corner_m": (1, 2, 2),
        "site.access_point_m": (1, beacons, 2),
        "calibration.distance_m": (1, pairs),
        "calibration.rss_dbm": (1, pairs),
        "recording.time_s": (1, epochs),
        "recording.rss_dbm": (1, epochs, beacons),
    }
    assert {name: values.shape for name, values in truth.items()} == {
        "truth.position_m": (1, epochs, 2),
        "truth.distance_m": (1, epochs, beacons),
    }
    for name, values in {**observed, **truth}.items():
        assert values.dtype == float
        assert name == "recording.rss_dbm" or np.isfinite(values).all(), name
    assert np.isfinite(observed["recording.rss_dbm"][0]).any(axis=1).all()
    for name in ("calibration.rss_dbm", "recording.rss_dbm"):
        assert np.nanmax(observed[name]) < 0
        assert np.nanmin(observed[name]) > -115
    assert (observed["calibration.distance_m"] > 0).all()
    offset_m = truth["truth.position_m"][0][:, None] - observed["site.access_point_m"][0]
    assert_allclose(truth["truth.distance_m"][0], np.hypot(*np.moveaxis(offset_m, -1, 0)), atol=1e-9)
    low_m, high_m = observed["site.corner_m"][0]
    assert (low_m < high_m).all()
    # Transmitters and sensors hang within the area, and the truth leaves it by no more than the camera errs.
    assert (observed["site.access_point_m"] >= low_m).all()
    assert (observed["site.access_point_m"] <= high_m).all()
    assert (truth["truth.position_m"] > low_m - 0.5).all()
    assert (truth["truth.position_m"] < high_m + 0.5).all()


@pytest.mark.parametrize(
    ("adapter", "folder", "every"),
    [
        pytest.param(
            ble_three_beacon_rooms,
            ROOMS,
            [
                {"scenario": scenario, "technology": technology}
                for scenario in (1, 2)
                for technology in ("ble", "wifi", "zigbee")
            ],
            marks=needs(ROOMS),
        ),
        pytest.param(
            rss_multilateration,
            ANCHORS,
            [{"technology": technology, "window_s": 60} for technology in ("ble", "wifi")],
            marks=needs(ANCHORS),
        ),
        pytest.param(
            ble_ar_tracks,
            TRACKS,
            [{"track": track} for track in ble_ar_tracks.TRACKS[1:]],
            marks=needs(TRACKS),
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


@pytest.mark.parametrize(
    ("adapter", "options", "words"),
    [
        (ble_three_beacon_rooms, {"scenario": 3}, ["scenario", "3 is none of 1, 2"]),
        (ble_three_beacon_rooms, {"technology": "uwb"}, ["technology", "'uwb'", "ble, wifi, zigbee"]),
        (ble_three_beacon_rooms, {"points": "all"}, ["points", "'all'", "tests, database"]),
        (ble_three_beacon_rooms, {}, ["scenario1", "no such folder"]),
        (rss_multilateration, {"technology": "zigbee"}, ["technology", "'zigbee'", "ble, wifi"]),
        (rss_multilateration, {"window_s": 0.0}, ["window_s", "0.0 is no positive length"]),
        (rss_multilateration, {"window_s": float("inf")}, ["window_s", "inf is no positive length"]),
        (rss_multilateration, {}, ["ble", "no such folder"]),
        (ble_ar_tracks, {"track": "circle"}, ["option track", "'circle'", "straight_01, straight_02"]),
        (ble_ar_tracks, {"calibration": "circle"}, ["option calibration", "'circle'"]),
        (ble_ar_tracks, {"track": "straight_01"}, ["option calibration", "straight_01 is the track itself"]),
        (ble_ar_tracks, {"window_s": -1.0}, ["window_s", "-1.0 is no positive length"]),
        (ble_ar_tracks, {"window_s": float("nan")}, ["window_s", "nan is no positive length"]),
        (ble_ar_tracks, {}, ["tetam.dev", "no such file"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path, adapter, options, words):
    with pytest.raises(InputError) as caught:
        adapter.load(tmp_path, **options)
    assert all(word in str(caught.value) for word in words)


# ---- rooms with three transmitters


@needs(ROOMS)
@pytest.mark.parametrize(
    ("scenario", "technology", "expected"),
    [
        (1, "ble", (-75.5, 2.27, 4.6)),  # the two of BLE stand in the recordings' own description
        (2, "ble", (-62.3, 2.00, 2.7)),
        (1, "wifi", (-45.7, 2.16, 6.5)),
        (1, "zigbee", (-50.3, 2.93, 4.6)),
        (2, "wifi", (-37.4, 2.02, 6.2)),
        (2, "zigbee", (-52.8, 1.90, 5.0)),
    ],
)
def test_rooms_path_loss(scenario, technology, expected):
    observed = ble_three_beacon_rooms.load(ROOMS, scenario=scenario, technology=technology).observed
    assert_near(calibrated(observed), expected, ROUNDED)
    distance_m = observed["calibration.distance_m"][0]
    assert_allclose(distance_m, [*np.arange(1, 11) / 10, *np.arange(3, 11) / 2])


@needs(ROOMS)
@pytest.mark.parametrize(
    ("scenario", "technology", "left_out_m", "tests_m"),
    [
        (1, "ble", 1.16, 1.10),
        (1, "wifi", 1.27, 1.37),
        (1, "zigbee", 1.25, 1.39),
        (2, "ble", 1.58, None),
        (2, "wifi", 1.84, None),
        (2, "zigbee", 1.66, None),
    ],
)
def test_rooms_accuracy_of_four_neighbours(scenario, technology, left_out_m, tests_m):
    """Figures of the recordings' description; the second needs the database's axes put right."""
    options = {"scenario": scenario, "technology": technology}
    database, place = ble_three_beacon_rooms.load(ROOMS, **options, points="database")
    rss_dbm, position_m = database["recording.rss_dbm"][0], place["truth.position_m"][0]
    keep = ~np.eye(len(rss_dbm), dtype=bool)
    estimate_m = np.array(
        [
            KNeighborsRegressor(4).fit(rss_dbm[others], position_m[others]).predict(rss_dbm[[row]])[0]
            for row, others in enumerate(keep)
        ]
    )
    # Whole dBm make ties between the fourth and the fifth neighbour; their order moves the last digit.
    assert_allclose(mean_error_m(estimate_m, place), left_out_m, atol=0.03)
    if tests_m:
        tests, truth = ble_three_beacon_rooms.load(ROOMS, **options)
        neighbours = KNeighborsRegressor(4).fit(rss_dbm, position_m)
        estimate_m = neighbours.predict(tests["recording.rss_dbm"][0])
        assert_allclose(mean_error_m(estimate_m, truth), tests_m, atol=0.03)
        neighbours = KNeighborsRegressor(4).fit(rss_dbm, position_m[:, ::-1])
        assert mean_error_m(neighbours.predict(tests["recording.rss_dbm"][0]), truth) > tests_m + 0.3


@needs(ROOMS)
@pytest.mark.parametrize("technology", ["ble", "wifi", "zigbee"])
def test_rooms_strengths_fall_with_the_distance_in_either_table(technology):
    """As printed, those of B and C in the database of scenario 1 rise with it."""
    for points in ("tests", "database"):
        observed, truth = ble_three_beacon_rooms.load(ROOMS, technology=technology, points=points)
        for beacon in range(3):
            log_distance = np.log(truth["truth.distance_m"][0][:, beacon])
            assert np.corrcoef(log_distance, observed["recording.rss_dbm"][0][:, beacon])[0, 1] < 0
    distance_m = np.linalg.norm(
        truth["truth.position_m"][0][:, None, ::-1] - observed["site.access_point_m"][0], axis=-1
    )
    for beacon in (1, 2):
        assert (
            np.corrcoef(np.log(distance_m[:, beacon]), observed["recording.rss_dbm"][0][:, beacon])[0, 1] > 0
        )


@needs(ROOMS)
@pytest.mark.parametrize(
    ("scenario", "technology", "tests_m", "database_m"),
    [
        (1, "ble", 1.11, 1.27),
        (1, "wifi", 1.16, 1.35),
        (1, "zigbee", 1.79, 1.39),
        (2, "ble", 1.92, 1.87),
        (2, "wifi", 1.56, 1.83),
        (2, "zigbee", 0.89, 1.95),
    ],
)
def test_rooms_least_squares_trilateration(scenario, technology, tests_m, database_m):
    """Rebuilt figures of plain least squares, so that a change of frame, sign or curve is noticed."""
    for points, expected_m in (("tests", tests_m), ("database", database_m)):
        observed, truth = ble_three_beacon_rooms.load(
            ROOMS, scenario=scenario, technology=technology, points=points
        )
        assert_allclose(mean_error_m(trilaterated_m(observed), truth), expected_m, atol=0.02)


def write_rooms(folder, *, database="1,0.5,5.5,70,88,85", tests="1,-2,2.5,60,61,62", run="0.1,-46,1"):
    header = "point,x_m,y_m,rssi_a_abs_dBm,rssi_b_abs_dBm,rssi_c_abs_dBm\n"
    for scenario in (1, 2):
        (folder / f"scenario{scenario}").mkdir()
        for name, text in (
            ("database", header + database),
            ("tests", header + tests),
            ("pathloss", "distance_m,rssi_dBm,point\n" + run),
        ):
            (folder / f"scenario{scenario}" / f"{name}_ble.csv").write_text(text + "\n")


def test_rooms_sign_frame_and_box_of_written_files(tmp_path):
    """The box is that of transmitters and database: the places of the tests would give the truth away."""
    write_rooms(tmp_path)
    for scenario, database_m, corner_m in (
        (1, (5.5, 0.5), [[0, 0], [5.5, 4]]),
        (2, (0.5, 5.5), [[0, 0], [3.27, 5.5]]),
    ):
        observed, truth = ble_three_beacon_rooms.load(tmp_path, scenario=scenario)
        assert_array_equal(observed["recording.rss_dbm"], [[[-60, -61, -62]]])
        assert_array_equal(observed["recording.time_s"], [[0]])
        assert_array_equal(truth["truth.position_m"], [[[-2, 2.5]]])
        assert_array_equal(observed["calibration.rss_dbm"], [[-46]])
        assert_array_equal(observed["calibration.distance_m"], [[0.1]])
        assert_array_equal(observed["site.corner_m"], [corner_m])
        observed, truth = ble_three_beacon_rooms.load(tmp_path, scenario=scenario, points="database")
        assert_array_equal(truth["truth.position_m"], [[database_m]])
        assert_array_equal(observed["recording.rss_dbm"], [[[-70, -88, -85]]])
        assert_array_equal(observed["site.corner_m"], [corner_m])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tests": "1,3,2.5,60,-61,62"}, r"tests_ble\.csv: .* hold -61, .*without their minus"),
        ({"tests": "1,3,2.5,60,,62"}, r"tests_ble\.csv: .*a cell is empty"),
        ({"database": "1,3,here,60,61,62"}, r"database_ble\.csv: .*'here'"),
        ({"run": ""}, r"pathloss_ble\.csv: .*there is no row"),
    ],
)
def test_rooms_damaged_files_are_named(tmp_path, changes, message):
    write_rooms(tmp_path, **changes)
    with pytest.raises(InputError, match=message):
        ble_three_beacon_rooms.load(tmp_path)


# ---- anchors and one target


def packets_dbm(file):
    """Strengths of one file as printed, read without the adapter."""
    with (ANCHORS / file).open(newline="", encoding="utf-8-sig") as handle:
        rows = list(csv.DictReader(handle, delimiter=";"))
    (column,) = [name for name in rows[0] if "dBm" in name]
    return np.array([float(row[column]) for row in rows])


@needs(ANCHORS)
def test_anchors_mark_of_17_dbm_is_no_strength():
    """The means of the recordings' description hold the mark; without it the scatter is a third of theirs."""
    printed = [packets_dbm(f"scenario_0/wifi/Distanza{m}.csv") for m in rss_multilateration.LINE_M]
    assert_allclose([dbm.mean() for dbm in printed], [-49.7, -55.8, -58.6, -61.0, -63.4], atol=0.051)
    every = printed + [packets_dbm(f"scenario_A/wifi/Anchor_{n}.csv") for n in rss_multilateration.ANCHORS]
    for dbm in every:
        assert 0.007 < (dbm == 17).mean() < 0.03
        assert dbm[dbm != 17].max() <= -42
    for m in rss_multilateration.LINE_M:
        assert packets_dbm(f"scenario_0/ble/Distanza{m}.csv").max() < 0
    assert max(dbm[dbm != 17].std() for dbm in printed) < 4.4
    assert min(dbm.std() for dbm in printed) > 7.8


@needs(ANCHORS)
@pytest.mark.parametrize(
    ("technology", "means_dbm", "expected"),
    [
        ("ble", [-76.6, -77.8, -81.0, -77.1, -79.1], (-74.91, 0.31, 1.40)),
        ("wifi", [-51.6, -56.8, -60.5, -63.4, -64.0], (-38.53, 1.86, 0.40)),
    ],
)
def test_anchors_path_loss_of_the_line(technology, means_dbm, expected):
    # A window as long as a file holds its mean.
    observed = rss_multilateration.load(ANCHORS, technology=technology, window_s=3600).observed
    assert_array_equal(observed["calibration.distance_m"], [[5, 10, 15, 20, 25]])
    assert_allclose(observed["calibration.rss_dbm"][0], means_dbm, atol=0.051)
    assert_near(calibrated(observed), expected, ROUNDED)
    # In short windows, the same curve and more scatter.
    level_dbm, exponent, residual_db = calibrated(
        rss_multilateration.load(ANCHORS, technology=technology).observed
    )
    assert_near((level_dbm, exponent), expected[:2], (0.1, 0.011))
    assert residual_db > expected[2] + 0.7


@needs(ANCHORS)
@pytest.mark.parametrize(
    ("technology", "means_dbm"),
    [
        ("ble", [-71.3, -76.0, -69.6, -70.7, -73.0, -59.9]),
        ("wifi", [-66.5, -57.3, -54.9, -48.7, -61.6, -56.2]),
    ],
)
def test_anchors_places_distances_and_means(technology, means_dbm):
    observed, truth = rss_multilateration.load(ANCHORS, technology=technology, window_s=3600)
    assert_array_equal(
        observed["site.access_point_m"][0],
        [[5.55, 15], [-5.55, 15], [-10.55, 0], [0, -15], [-10.55, -7.5], [10.55, 7.5]],
    )
    assert_array_equal(observed["site.corner_m"], [[[-10.55, -15], [10.55, 15]]])
    assert_array_equal(truth["truth.position_m"], [[[0, 0]]])
    # The distances that the files print.
    assert_allclose(truth["truth.distance_m"][0, 0], [15.994, 15.994, 10.55, 15, 12.944, 12.944], atol=5e-4)
    assert_allclose(observed["recording.rss_dbm"][0, 0], means_dbm, atol=0.051)


@needs(ANCHORS)
@pytest.mark.parametrize(
    ("technology", "epochs", "windows", "missing"),
    [("ble", 91, 450, [1, 1, 0, 1, 0, 1]), ("wifi", 90, 373, [12, 9, 13, 11, 26, 14])],
)
def test_anchors_windows_of_ten_seconds(technology, epochs, windows, missing):
    observed, truth = rss_multilateration.load(ANCHORS, technology=technology)
    assert observed["recording.rss_dbm"].shape == (1, epochs, 6)
    assert observed["calibration.rss_dbm"].shape == (1, windows)
    assert_array_equal(np.isnan(observed["recording.rss_dbm"][0]).sum(axis=0), missing)
    assert not observed["recording.time_s"].any()
    assert not truth["truth.position_m"].any()


def ble_file(start, packets, anchor=None):
    heading = ["Timestamp", "Rx Power [dBm]"]
    rows = [
        [(start + timedelta(seconds=second)).strftime("%a %b %d %H:%M:%S %Y"), f"{dbm:g}"]
        for second, dbm in packets
    ]
    return table(heading, rows, anchor)


def wifi_file(start_s, packets, anchor=None, column="Rx Power [dBm]"):
    rows = [[f"{start_s + second:.9f}", "2023-01-25 15:44:47", f"{dbm:g}"] for second, dbm in packets]
    return table(["Timestamp", "Date ISO", column], rows, anchor)


def table(heading, rows, anchor):
    if anchor:
        heading = [
            *heading,
            "Relative Coordinates [m]",
            "Target Coordinates [m]",
            "Distance Target - Anchor [m]",
        ]
        rows = [[*row, *anchor, "1"] for row in rows]
    return "\ufeff" + "\r\n".join(";".join(row) for row in [heading, *rows])


START = datetime(2023, 3, 24, 14, 13, 33)
PLACES = ["5.5, 15", "-5.5, 15", "-10.5, 0", "0, -15", "-10.5, -7.5", "10.5, 7.5"]


def write_anchors(folder, *, shift_s=0, packets=((0, -60), (4, -70), (25, -80)), **changed):
    """Six anchors with the same packets; in the BLE files all stand at one place."""
    for scenario, technology in product("0A", ("ble", "wifi")):
        (folder / f"scenario_{scenario}" / technology).mkdir(parents=True)
    files = {}
    for m in (5, 10, 15, 20, 25):
        files[f"scenario_0/ble/Distanza{m}.csv"] = ble_file(START, [(0, -50 - m)])
        files[f"scenario_0/wifi/Distanza{m}.csv"] = wifi_file(1.6e9, [(0, -50 - m), (1, 17), (30, -52 - m)])
    for number, place in enumerate(PLACES, start=1):
        later_s = shift_s * number
        files[f"scenario_A/ble/Anchor_{number}.csv"] = ble_file(
            START + timedelta(seconds=later_s), packets, (PLACES[0], "1, 2")
        )
        files[f"scenario_A/wifi/Anchor_{number}.csv"] = wifi_file(1.6e9 + later_s, packets, (place, "1, 2"))
    for name, text in {**files, **changed}.items():
        (folder / name).write_bytes(text.encode())
    return folder


@pytest.mark.parametrize("technology", ["ble", "wifi"])
def test_anchors_windows_of_written_files(tmp_path, technology):
    folder = write_anchors(tmp_path, shift_s=1000)
    observed, truth = rss_multilateration.load(folder, technology=technology)
    assert_array_equal(
        observed["recording.rss_dbm"], np.repeat([[[-65.0], [-80.0]]], 6, axis=2)
    )  # window 1 heard nothing
    assert_array_equal(observed["site.access_point_m"][0], [[float(x) for x in p.split(",")] for p in PLACES])
    assert_array_equal(truth["truth.position_m"], [[[1, 2], [1, 2]]])
    if technology == "wifi":  # the mark is in no mean, and a window is a reading
        assert_array_equal(observed["calibration.distance_m"][0], np.repeat([5, 10, 15, 20, 25], 2))
        assert_array_equal(observed["calibration.rss_dbm"][0][:4], [-55, -57, -60, -62])
    else:
        assert_array_equal(observed["calibration.rss_dbm"][0], [-55, -60, -65, -70, -75])


@settings(max_examples=25, deadline=None)
@given(
    packets=st.lists(st.tuples(st.integers(0, 60), st.integers(-99, -40)), min_size=1, max_size=20),
    window_s=st.sampled_from([1.0, 7.0, 10.0, 100.0]),
    shift_s=st.integers(0, 5000),
)
def test_anchors_windows_hold_every_packet_whenever_it_was_recorded(
    tmp_path_factory, packets, window_s, shift_s
):
    """Means of the windows, weighted by their packets, give that of the packets; the hour is irrelevant."""
    packets = sorted(packets)
    folder = write_anchors(tmp_path_factory.mktemp("anchors"), packets=packets, shift_s=shift_s)
    ble = rss_multilateration.load(folder, window_s=window_s).observed["recording.rss_dbm"]
    wifi = rss_multilateration.load(folder, technology="wifi", window_s=window_s).observed
    assert_allclose(ble, wifi["recording.rss_dbm"])
    assert_array_equal(ble[..., 1:], ble[..., :-1])
    second, dbm = np.array(packets, dtype=float).T
    _, count = np.unique((second - second[0]) // window_s, return_counts=True)
    assert ble.shape == (1, len(count), 6)
    assert_allclose((ble[0, :, 0] * count).sum(), dbm.sum())


def test_anchors_that_miss_a_window_are_not_heard_there(tmp_path):
    name = "scenario_A/wifi/Anchor_3.csv"
    changed = {name: wifi_file(1.7e9, [(0, 17), (12, -90)], (PLACES[2], "1, 2"))}
    observed = rss_multilateration.load(write_anchors(tmp_path, **changed), technology="wifi").observed
    nan = np.nan
    expected = np.repeat([[-65.0], [nan], [-80.0]], 6, axis=1)
    expected[:, 2] = nan, -90, nan
    assert_array_equal(observed["recording.rss_dbm"], [expected])


def test_anchors_second_heading_of_the_strength(tmp_path):
    name = "scenario_0/wifi/Distanza10.csv"
    changed = {name: wifi_file(1.6e9, [(0, -61)], column="POTENZA_dBm")}
    observed = rss_multilateration.load(write_anchors(tmp_path, **changed), technology="wifi").observed
    here = observed["calibration.distance_m"] == 10
    assert_array_equal(observed["calibration.rss_dbm"][here], [-61])


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("scenario_0/ble/Distanza5.csv", "Timestamp;power\r\nx;-50", r"Distanza5\.csv: .*Rx Power"),
        ("scenario_0/ble/Distanza5.csv", "Timestamp;Rx Power [dBm]\r\n1679;-50", r"Distanza5\.csv: .*'1679'"),
        (
            "scenario_0/ble/Distanza5.csv",
            "Timestamp;Rx Power [dBm]\r\n",
            r"Distanza5\.csv: .*there is no row",
        ),
        ("scenario_A/ble/Anchor_2.csv", ble_file(START, [(0, np.nan)]), r"Anchor_2\.csv: .*not finite"),
        (
            "scenario_A/wifi/Anchor_2.csv",
            wifi_file(0, [(0, -50)], ("5.5,15", "1, 2")),
            r"Anchor_2\.csv: .*Relative Coord",
        ),
        ("scenario_A/wifi/Anchor_2.csv", wifi_file(0, [(0, -50)]), r"Anchor_2\.csv: .*Relative Coord"),
        (
            "scenario_A/wifi/Anchor_2.csv",
            wifi_file(0, [(0, -50)], ("5.5, 15", "1, 3")),
            r"scenario_A: they name different places of the target",
        ),
    ],
)
def test_anchors_damaged_files_are_named(tmp_path, file, text, message):
    write_anchors(tmp_path, **{file: text})
    with pytest.raises(InputError, match=message):
        rss_multilateration.load(tmp_path)


# ---- tracks through an office


def track_rows(track):
    """Packets of a track, read without the adapter: sensor ids, and time, strength and place as numbers."""
    with (TRACKS / f"{track}_all_sensors.mbd").open(newline="") as handle:
        rows = list(csv.reader(handle))
    return [row[1] for row in rows], np.array([[row[0], *row[3:7]] for row in rows], dtype=float)


def sensor_places():
    line = (TRACKS / "tetam.dev").read_text().splitlines()[0]
    return {sensor: entry[0] for sensor, entry in json.loads(line.removeprefix("Dongles:")).items()}


@needs(TRACKS)
@pytest.mark.parametrize(
    ("track", "packets", "in_space", "planar"),
    [
        ("straight_01", 1365, (-62.4, 1.31, 5.9), (-62.6, 1.29, 5.9)),
        ("straight_02", 1240, (-58.7, 1.77, 6.1), (-59.0, 1.75, 6.1)),
        ("straight_03", 1061, (-61.9, 1.47, 5.9), (-62.2, 1.44, 5.9)),
        ("rectangular_with_rotation", 1935, (-61.1, 1.50, 6.2), (-61.3, 1.47, 6.2)),
    ],
)
def test_tracks_path_loss(track, packets, in_space, planar):
    """The recordings' description fits distances in space; the adapter's are planar, and differ little."""
    sensors, number = track_rows(track)
    place = sensor_places()
    distance_m = np.linalg.norm(number[:, 2:] - [place[sensor] for sensor in sensors], axis=1)
    assert_near(path_loss(distance_m, number[:, 1]), in_space, ROUNDED)
    other = "straight_01" if track != "straight_01" else "straight_02"
    observed = ble_ar_tracks.load(TRACKS, track=other, calibration=track).observed
    assert observed["calibration.rss_dbm"].shape == (1, packets)
    assert_array_equal(observed["calibration.rss_dbm"][0], number[:, 1])
    assert_near(calibrated(observed), planar, ROUNDED)
    assert (observed["calibration.distance_m"][0] <= distance_m + 1e-9).all()
    assert observed["calibration.distance_m"].min() > 1


@needs(TRACKS)
@pytest.mark.parametrize(
    ("track", "epochs", "path_m"),
    [("straight_02", 55, 18), ("straight_03", 47, 19), ("rectangular_with_rotation", 84, 31)],
)
def test_tracks_epochs_places_and_sensors(track, epochs, path_m):
    observed, truth = ble_ar_tracks.load(TRACKS, track=track)
    sensors, number = track_rows(track)
    place = sensor_places()
    assert_array_equal(observed["site.access_point_m"][0], [xyz[:2] for xyz in place.values()])
    assert_allclose(observed["site.corner_m"], [[[0, 0], [20.66, 17.64]]], atol=0.002)
    time_s = observed["recording.time_s"][0]
    assert len(time_s) == epochs
    assert_array_equal(np.floor(time_s), np.arange(epochs))
    along_m = np.linalg.norm(np.diff(truth["truth.position_m"][0], axis=0), axis=1)
    assert_allclose(along_m.sum(), path_m, atol=1.5)
    assert along_m.max() < 1.5  # a walk
    window = np.floor(number[:, 0] - number[:, 0].min())
    for epoch, (column, sensor) in product((0, epochs // 2, epochs - 1), enumerate(place)):
        here = (window == epoch) & (np.array(sensors) == sensor)
        expected = number[here, 1].mean() if here.any() else np.nan
        assert_allclose(observed["recording.rss_dbm"][0, epoch, column], expected)
    assert_allclose(truth["truth.position_m"][0, -1], number[window == epochs - 1, 2:4].mean(axis=0))


SENSORS = {"000000000101": [0, 0, 2.3], "1e5": [10, 0, 1.22], "00": [0, 20, 2.3]}


def write_tracks(folder, rows, calibration=((0.0, "1e5", -60, 7, 4),), beacon="ff"):
    entries = {sensor: [place, 1, "name"] for sensor, place in SENSORS.items()}
    (folder / "tetam.dev").write_text(f'Dongles:{json.dumps(entries)}\nBeacons:{{"ff": [[], 1, "beacon1"] }}')
    (folder / "tetam.par").write_text(
        '{"origin": [22, 9], "limits": [0.0, -1.0, 20.5, 17.5], "parity": 0.03}'
    )
    for name, packets in (("straight_01", calibration), ("straight_02", rows)):
        text = "".join(
            f"{1581249601.25 + second!r},{sensor},{beacon if row else 'ff'},{dbm},{x},{y},1.8{',0.0' * 9}\n"
            for row, (second, sensor, dbm, x, y) in enumerate(packets)
        )
        (folder / f"{name}_all_sensors.mbd").write_text(text)


def test_tracks_windows_of_written_files(tmp_path):
    rows = [
        (0.25, "000000000101", -60, 1.0, 3.0),
        (0.0, "1e5", -70, 0.0, 3.0),  # a little late in the file, as in the recordings
        (0.75, "000000000101", -64, 2.0, 3.0),
        (4.5, "000000000101", -80, 3.0, 4.0),
    ]
    write_tracks(tmp_path, rows)
    observed, truth = ble_ar_tracks.load(tmp_path)
    nan = np.nan
    assert_array_equal(observed["recording.rss_dbm"], [[[-62, -70, nan], [-80, nan, nan]]])
    assert_allclose(observed["recording.time_s"], [[1 / 3, 4.5]], atol=1e-6)
    assert_allclose(truth["truth.position_m"], [[[1, 3], [3, 4]]])
    assert_allclose(truth["truth.distance_m"][0, 1], [5, np.hypot(7, 4), np.hypot(3, 16)])
    assert_array_equal(observed["site.access_point_m"], [[[0, 0], [10, 0], [0, 20]]])
    assert_array_equal(observed["site.corner_m"], [[[0, -1], [20.5, 17.5]]])
    assert_allclose(observed["calibration.distance_m"], [[5]])  # planar: (10 - 7, 4)
    assert_array_equal(observed["calibration.rss_dbm"], [[-60]])

    longer, _ = ble_ar_tracks.load(tmp_path, window_s=10)
    assert_array_equal(longer["recording.rss_dbm"], [[[-68, -70, nan]]])


GOOD = (0.0, "1e5", -60, 7, 4)


@pytest.mark.parametrize(
    ("rows", "beacon", "message"),
    [
        ([GOOD, (1, "101", -60, 7, 4)], "ff", r"straight_02_all_sensors\.mbd: .*no sensor 101"),
        ([GOOD, GOOD], "ee", r"straight_02_all_sensors\.mbd: .*more than one beacon"),
        ([GOOD, (1, "1e5", "weak", 7, 4)], "ff", r"straight_02_all_sensors\.mbd: .*weak"),
        ([GOOD, (1, "1e5", -60, "nan", 4)], "ff", r"straight_02_all_sensors\.mbd: .*not finite"),
        ([], "ff", r"straight_02_all_sensors\.mbd: "),
    ],
)
def test_tracks_damaged_packets_are_named(tmp_path, rows, beacon, message):
    write_tracks(tmp_path, rows, beacon=beacon)
    with pytest.raises(InputError, match=message):
        ble_ar_tracks.load(tmp_path)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("tetam.dev", "Beacons:{}"),
        ("tetam.dev", 'Dongles:{"1e5": [[1, 2], 1, "a"]}'),
        ("tetam.dev", "Dongles:[1]"),
        ("tetam.par", '{"origin": [1, 2]}'),
        ("tetam.par", '{"limits": [0, 0, 1]}'),
        ("tetam.par", "limits"),
    ],
)
def test_tracks_damaged_settings_are_named(tmp_path, file, text):
    write_tracks(tmp_path, [GOOD])
    (tmp_path / file).write_text(text)
    with pytest.raises(InputError, match=file):
        ble_ar_tracks.load(tmp_path)
