"""The adapters of real recordings: published counts and accuracies, a user's own table, the register."""

import csv
import hashlib
import inspect
import os
import re
import tempfile
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat
from sklearn.neighbors import KNeighborsRegressor

from positioning.errors import InputError
from positioning.recordings import survey_csv, wifi_fingerprint_collection, wifi_rtt_rss_rooms
from positioning.recordings.register import COLUMNS, REGISTER, check_files, find_file, read_register

CHECKOUT = Path(__file__).resolve().parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
ROOMS = REALDATA / "wifi_rtt_rss_rooms"
COLLECTION = REALDATA / "wifi_fingerprint_collection"

needs_rooms = pytest.mark.skipif(not ROOMS.is_dir(), reason=f"no recordings in {ROOMS} (REPOSITION_REALDATA)")
needs_collection = pytest.mark.skipif(
    not COLLECTION.is_dir(), reason=f"no recordings in {COLLECTION} (REPOSITION_REALDATA)"
)


def filled(rss_dbm, fill_dbm):
    return np.where(np.isnan(rss_dbm), fill_dbm, rss_dbm)


def leave_one_out_error_m(rss_dbm, position_m, neighbours=4):
    """Unweighted k-NN by an independent implementation, every point located by the others."""
    rss_dbm = filled(rss_dbm, np.nanmin(rss_dbm) - 1)
    keep = ~np.eye(len(rss_dbm), dtype=bool)
    estimate = [
        KNeighborsRegressor(neighbours).fit(rss_dbm[others], position_m[others]).predict(rss_dbm[[i]])[0]
        for i, others in enumerate(keep)
    ]
    return np.linalg.norm(np.asarray(estimate) - position_m, axis=1)


def rooms_scans(area):
    """Every scan of an area, read without the adapter: (x, y) -> [60, 5] strengths, dBm, -200 = not heard."""
    scans = {}
    for part in ("train", "test"):
        with (ROOMS / f"database_{area}_{part}.csv").open(newline="") as handle:
            for row in csv.DictReader(handle):
                strengths = [float(row[f"AP{number} RSS(dBm)"]) for number in range(1, 6)]
                scans.setdefault((float(row["X"]), float(row["Y"])), []).append(strengths)
    return {point: np.asarray(values) for point, values in scans.items()}


@needs_rooms
@pytest.mark.parametrize(
    ("area", "points", "heard"), [("lecture_theatre", 120, [0, 1, 2, 3, 4]), ("corridor", 114, [1, 2, 3, 4])]
)
@pytest.mark.parametrize("scans", ["mean", "first"])
def test_rooms_hold_one_row_a_reference_point(area, points, heard, scans):
    observed, truth = wifi_rtt_rss_rooms.load(ROOMS, area=area, scans=scans)
    raw = rooms_scans(area)
    assert {len(values) for values in raw.values()} == {60}
    assert observed["survey.rss_dbm"].shape == (1, points, len(heard))
    assert observed["survey.position_m"].shape == truth["truth.position_m"].shape == (1, points, 2)
    assert "query.rss_dbm" not in observed
    assert_allclose(observed["survey.position_m"][0], 0.6 * np.array(list(raw)), rtol=1e-12)
    assert_array_equal(truth["truth.position_m"], observed["survey.position_m"])
    for rss_dbm, values in zip(observed["survey.rss_dbm"][0], raw.values(), strict=True):
        values = np.where(values == -200, np.nan, values)[:, heard]
        assert_allclose(rss_dbm, np.nanmean(values, axis=0) if scans == "mean" else values[0])


@needs_rooms
def test_rooms_corridor_leaves_out_only_the_access_point_that_is_never_heard():
    raw = np.concatenate(list(rooms_scans("corridor").values()))
    assert_array_equal((raw == -200).all(axis=0), [True, False, False, False, False])
    assert_allclose(
        wifi_rtt_rss_rooms.load(ROOMS, area="corridor").observed["site.access_point_m"][0],
        0.6 * np.array([[2, 7.5], [17, 6.8], [38, 9], [48, 5]]),
    )


@needs_rooms
@pytest.mark.parametrize("area", ["lecture_theatre", "corridor"])
def test_rooms_columns_fall_off_most_from_their_own_access_point(area):
    observed = wifi_rtt_rss_rooms.load(ROOMS, area=area).observed
    distance_m = np.linalg.norm(
        observed["survey.position_m"][0][:, None] - observed["site.access_point_m"][0], axis=-1
    )
    rss_dbm = observed["survey.rss_dbm"][0]
    correlation = [
        [
            np.corrcoef(np.log(distance_m[:, place]), rss_dbm[:, column])[0, 1]
            for column in range(rss_dbm.shape[1])
        ]
        for place in range(rss_dbm.shape[1])
    ]
    assert np.diag(correlation).max() < -0.5
    assert_array_equal(np.argmin(correlation, axis=0), np.arange(rss_dbm.shape[1]))


@needs_rooms
@pytest.mark.parametrize(
    ("area", "published", "rebuilt"),
    [("lecture_theatre", (4.10, 3.06), (3.62, 2.92)), ("corridor", (2.85, 2.14), (2.42, 2.10))],
)
def test_rooms_accuracy_of_four_neighbours(area, published, rebuilt):
    """The published figures, in grid units, average the mark -200 as if it were a strength.

    They show that the same scans are read; beside them stands what the adapter's means give without the mark.
    """
    raw = rooms_scans(area)
    marked = np.array([values.mean(axis=0) for values in raw.values()])
    error = leave_one_out_error_m(marked, np.array(list(raw)))
    assert_allclose((error.mean(), np.median(error)), published, atol=0.0051)

    observed = wifi_rtt_rss_rooms.load(ROOMS, area=area).observed
    error_m = leave_one_out_error_m(observed["survey.rss_dbm"][0], observed["survey.position_m"][0])
    assert_allclose((error_m.mean() / 0.6, np.median(error_m) / 0.6), rebuilt, atol=0.0051)


COUNTS = {  # rows, query rows, access points, positions with height, access points never heard in training
    "DSI1": (1369, 348, 157, 230, 5),
    "LIB1": (576, 3120, 174, 48, 97),
    "TUT1": (1476, 490, 309, 1476, 0),
    "TUT3": (697, 3951, 992, 694, 213),
    "UJI1": (19861, 1111, 520, 933, 55),
}
FOUR_NEIGHBOURS_M = {
    "DSI1": (4.95, 4.55),
    "LIB1": (2.66, 2.29),
    "TUT1": (8.01, 5.17),
    "TUT3": (9.41, 6.57),
    "UJI1": (8.72, 5.43),
}


@needs_collection
@pytest.mark.parametrize("name", COUNTS)
def test_collection_shapes_counts_and_accuracy(name):
    observed, truth = wifi_fingerprint_collection.load(COLLECTION, name=name)
    rows, queries, access_points, _, never_heard = COUNTS[name]
    rss_dbm, query_dbm = observed["survey.rss_dbm"], observed["query.rss_dbm"]
    position_m, true_m = observed["survey.position_m"], truth["truth.position_m"]
    assert rss_dbm.shape == (1, rows, access_points)
    assert query_dbm.shape == (1, queries, access_points)
    assert position_m.shape == (1, rows, 2)
    assert true_m.shape == (1, queries, 2)
    assert {array.dtype for array in (rss_dbm, query_dbm, position_m, true_m)} == {np.dtype(float)}
    assert np.isfinite(position_m).all()
    assert np.isfinite(true_m).all()
    assert np.isnan(rss_dbm[0]).all(axis=0).sum() == never_heard
    assert np.nanmax(rss_dbm) <= 0
    assert np.nanmax(query_dbm) <= 0
    assert_array_equal(observed["site.corner_m"][0], [position_m[0].min(axis=0), position_m[0].max(axis=0)])

    # The published figures fill with the minimum of training and test, and quote UJI1 in map units.
    fill_dbm = min(np.nanmin(rss_dbm), np.nanmin(query_dbm)) - 1
    estimate_m = (
        KNeighborsRegressor(4, algorithm="brute")
        .fit(filled(rss_dbm[0], fill_dbm), position_m[0])
        .predict(filled(query_dbm[0], fill_dbm))
    )
    error_m = np.linalg.norm(estimate_m - true_m[0], axis=1) / (0.766 if name == "UJI1" else 1)
    # Whole dBm make ties between the fourth and the fifth neighbour; their order moves the last digit.
    assert_allclose((error_m.mean(), np.median(error_m)), FOUR_NEIGHBOURS_M[name], atol=0.01)


@needs_collection
@pytest.mark.parametrize("name", ["DSI1", "LIB1", "UJI1"])
def test_collection_mean_is_one_row_a_position_of_a_floor(name):
    observed, truth = wifi_fingerprint_collection.load(COLLECTION, name=name, scans="mean")
    every, every_truth = wifi_fingerprint_collection.load(COLLECTION, name=name)
    assert observed["survey.rss_dbm"].shape == (1, COUNTS[name][3], COUNTS[name][2])
    assert_array_equal(observed["query.rss_dbm"], every["query.rss_dbm"])
    assert_array_equal(truth["truth.position_m"], every_truth["truth.position_m"])
    assert_allclose(observed["site.corner_m"], every["site.corner_m"])

    database = loadmat(COLLECTION / f"{name}.mat", squeeze_me=True, struct_as_record=False)["database"]
    weakest = database.trainingMacs.astype(float).min()
    for point in (0, COUNTS[name][3] // 2, -1):
        # Seen from the mean's side: its position has rows of one label whose readings give it.
        here = (
            np.abs(every["survey.position_m"][0] - observed["survey.position_m"][0, point]).max(axis=1) < 1e-9
        )
        means = []
        for label in np.unique(database.trainingLabels[here], axis=0):
            readings = database.trainingMacs[(database.trainingLabels == label).all(axis=1)].astype(float)
            heard = readings != 100
            mean = np.where(heard, readings, weakest - 1).mean(axis=0)
            means.append(np.where(heard.any(axis=0), mean, np.nan))
        assert any(np.allclose(mean, observed["survey.rss_dbm"][0, point], equal_nan=True) for mean in means)


@needs_collection
def test_collection_brings_uji1_to_ground_metres():
    observed, truth = wifi_fingerprint_collection.load(COLLECTION, name="UJI1")
    database = loadmat(COLLECTION / "UJI1.mat", squeeze_me=True, struct_as_record=False)["database"]
    earth_radius_m = 6378137.0
    latitude = 2 * np.arctan(np.exp(database.trainingLabels[:, 1].mean() / earth_radius_m)) - np.pi / 2
    for ours, theirs in (
        (observed["survey.position_m"][0], database.trainingLabels),
        (truth["truth.position_m"][0], database.testLabels),
    ):
        ground_m = np.diff(theirs[:400, :2], axis=0) * np.cos(latitude)
        assert_allclose(np.diff(ours[:400], axis=0), ground_m, rtol=1e-3, atol=1e-6)
    # One origin for both, at the survey's corner.
    between = (database.testLabels[0, :2] - database.trainingLabels[0, :2]) * 0.766
    assert_allclose(truth["truth.position_m"][0, 0] - observed["survey.position_m"][0, 0], between)
    assert_array_equal(observed["survey.position_m"][0].min(axis=0), [0, 0])


@pytest.mark.parametrize(
    ("load", "options", "words"),
    [
        (wifi_rtt_rss_rooms.load, {"area": "roof"}, ["area", "'roof'", "lecture_theatre, corridor"]),
        (wifi_rtt_rss_rooms.load, {"scans": "last"}, ["scans", "'last'", "mean, first"]),
        (wifi_rtt_rss_rooms.load, {}, ["ap_position_lecture_theatre.csv", "no such file"]),
        (wifi_fingerprint_collection.load, {"name": "UJI9"}, ["name", "'UJI9'", "DSI1, LIB1"]),
        (
            wifi_fingerprint_collection.load,
            {"name": "DSI1", "scans": "first"},
            ["scans", "'first'", "all, mean"],
        ),
        (wifi_fingerprint_collection.load, {"name": "DSI1"}, ["DSI1.mat", "no such file"]),
        (survey_csv.load, {}, ["survey.csv", "no such file"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path, load, options, words):
    with pytest.raises(InputError) as caught:
        load(tmp_path, **options)
    assert all(word in str(caught.value) for word in words)


def test_damaged_files_are_named(tmp_path):
    (tmp_path / "DSI1.mat").write_bytes(b"no struct" * 100)
    with pytest.raises(InputError, match=r"DSI1\.mat: it holds no struct 'database'"):
        wifi_fingerprint_collection.load(tmp_path, name="DSI1")
    (tmp_path / "ap_position_corridor.csv").write_text("ap,x,y\n2,2,here\n")
    with pytest.raises(InputError, match=r"ap_position_corridor\.csv: .*'here'"):
        wifi_rtt_rss_rooms.load(tmp_path, area="corridor")
    (tmp_path / "ap_position_corridor.csv").write_text("ap,x\n2,2\n")
    with pytest.raises(InputError, match=r"ap_position_corridor\.csv: the columns ap, x, y"):
        wifi_rtt_rss_rooms.load(tmp_path, area="corridor")


# ---- a user's own survey

OWN = "x_m,y_m,ap1_dbm,ap2_dbm\n0,0,-50,\n1.5,0,-61.5,-70\n1.5,2,NaN,-66\n"


def test_survey_csv_reads_a_plain_table(tmp_path):
    (tmp_path / "survey.csv").write_text(OWN)
    observed, truth = survey_csv.load(tmp_path)
    assert set(observed) == {"survey.rss_dbm", "survey.position_m", "site.corner_m"}
    nan = np.nan
    assert_array_equal(observed["survey.rss_dbm"], [[[-50, nan], [-61.5, -70], [nan, -66]]])
    assert_array_equal(observed["survey.position_m"], [[[0, 0], [1.5, 0], [1.5, 2]]])
    assert_array_equal(observed["site.corner_m"], [[[0, 0], [1.5, 2]]])
    assert_array_equal(truth["truth.position_m"], observed["survey.position_m"])


def test_survey_csv_reads_what_spreadsheets_write(tmp_path):
    (tmp_path / "plain.csv").write_text(OWN)
    (tmp_path / "excel.csv").write_bytes(b"\xef\xbb\xbf" + OWN.replace("\n", "\r\n").encode() + b"\r\n")
    plain, excel = (survey_csv.load(tmp_path, file=file).observed for file in ("plain.csv", "excel.csv"))
    for name, values in plain.items():
        assert_array_equal(values, excel[name])


def test_survey_csv_with_queries_and_access_points(tmp_path):
    (tmp_path / "survey.csv").write_text(OWN)
    (tmp_path / "walk.csv").write_text("ap2_dbm,x_m,ap1_dbm,y_m\n-80,0.5,,1\n")
    (tmp_path / "places.csv").write_text("name,x_m,y_m,room\nap2,3,4,a\nap9,9,9,b\nap1,1,2,c\n")
    observed, truth = survey_csv.load(tmp_path, queries="walk.csv", access_points="places.csv")
    assert_array_equal(observed["query.rss_dbm"], [[[np.nan, -80]]])
    assert_array_equal(truth["truth.position_m"], [[[0.5, 1]]])
    assert_array_equal(observed["site.access_point_m"], [[[1, 2], [3, 4]]])
    assert observed["survey.rss_dbm"].shape == (1, 3, 2)


WRONG = {
    "empty": ("", "survey.csv: the file has 0 row"),
    "header only": ("x_m,y_m,ap1_dbm\n", "survey.csv: the file has 1 row"),
    "no y": ("x_m,y,ap1_dbm\n0,0,-50\n", "survey.csv, row 1, column y_m: it is missing"),
    "semicolons": ("x_m;y_m;ap1_dbm\n0;0;-50\n", "survey.csv, row 1, column x_m: it is missing"),
    "other column": ("x_m,y_m,ap1_dbm,time\n0,0,-50,1\n", "survey.csv, row 1, column time: it is neither"),
    "bare ending": ("x_m,y_m,_dbm\n0,0,-50\n", "survey.csv, row 1, column _dbm: it is neither"),
    "no access point": ("x_m,y_m\n0,0\n1,1\n", "survey.csv, row 1: no column ends in _dbm"),
    "twice": (
        "x_m,y_m,ap_dbm,ap_dbm\n0,0,-50,-50\n",
        "survey.csv, row 1, column ap_dbm: it stands there twice",
    ),
    "word in strength": (OWN + "1,1,-50,weak\n", "survey.csv, row 5, column ap2_dbm: 'weak' is no number"),
    "word in position": (OWN + "1,door,-50,-50\n", "survey.csv, row 5, column y_m: 'door' is no number"),
    "row after a blank one": (OWN + "\n1,1,-,-50\n", "survey.csv, row 6, column ap1_dbm: '-' is no number"),
    "empty position": (OWN + "1,,-50,-50\n", "survey.csv, row 5, column y_m: the cell is empty"),
    "NaN position": (OWN + "nan,1,-50,-50\n", "survey.csv, row 5, column x_m: the cell holds nan"),
    "infinite position": (OWN + "inf,1,-50,-50\n", "survey.csv, row 5, column x_m: the cell holds inf"),
    "infinite strength": (OWN + "1,1,-inf,-50\n", "survey.csv, row 5, column ap1_dbm: the cell holds -inf"),
    "overflow": (OWN + "1,1,-50,-1e999\n", "survey.csv, row 5, column ap2_dbm: the cell holds -1e999"),
    "mark 100": (OWN + "1,1,-50,100\n", "survey.csv, row 5, column ap2_dbm: the cell holds 100"),
    "mark -200": (OWN + "1,1,-200,-50\n", "survey.csv, row 5, column ap1_dbm: the cell holds -200"),
    "short row": (OWN + "1,1,-50\n", "survey.csv, row 5, column ap2_dbm: the row has 3 cells"),
    "decimal comma": (
        OWN + "1,1,-50,5,-50\n",
        "survey.csv, row 5, column after ap2_dbm: the row has 5 cells",
    ),
    "one place": ("x_m,y_m,ap1_dbm\n0,0,-50\n0,0,-51\n", "survey.csv: 1 different position"),
}
CURES = ("Write", "Leave", "Fill", "Keep", "Name", "Let", "Give", "Rename", "Export", "Survey")


@pytest.mark.parametrize(("text", "message"), WRONG.values(), ids=WRONG.keys())
def test_survey_csv_names_file_row_column_and_cure(tmp_path, text, message):
    (tmp_path / "survey.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        survey_csv.load(tmp_path)
    assert str(caught.value).startswith(message)
    assert caught.value.cure.startswith(CURES)


@pytest.mark.parametrize("content", [b"PK\x03\x04\xff\xfe\x00", b"x_m,y_m,caf\xe9_dbm\n0,0,-50\n"])
def test_survey_csv_names_a_file_that_is_no_text(tmp_path, content):
    (tmp_path / "survey.csv").write_bytes(content)
    with pytest.raises(InputError, match=r"^survey\.csv: it is no text table .*UTF-8\.$"):
        survey_csv.load(tmp_path)


@pytest.mark.parametrize(
    ("queries", "message"),
    [
        ("x_m,y_m,ap1_dbm\n0,0,-50\n", "walk.csv, column ap2_dbm: only survey.csv has it"),
        ("x_m,y_m,ap1_dbm,ap2_dbm,ap3_dbm\n0,0,,,-5\n", "walk.csv, column ap3_dbm: only walk.csv has it"),
        ("x_m,y_m,ap1_dbm,ap2_dbm\n0,,-50,-60\n", "walk.csv, row 2, column y_m: the cell is empty"),
        ("x_m,y_m,ap1_dbm,ap2_dbm\n0,1,-50,x\n", "walk.csv, row 2, column ap2_dbm: 'x' is no number"),
    ],
)
def test_survey_csv_names_what_is_wrong_with_queries(tmp_path, queries, message):
    (tmp_path / "survey.csv").write_text(OWN)
    (tmp_path / "walk.csv").write_text(queries)
    with pytest.raises(InputError) as caught:
        survey_csv.load(tmp_path, queries="walk.csv")
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ("name,x_m\nap1,0\n", "places.csv, row 1, column y_m: it is missing"),
        ("name,x_m,y_m\nap1,0,0\n", "places.csv, column name: 'ap2' is missing"),
        ("name,x_m,y_m\nap1,0,0\nap2,1,\n", "places.csv, row 3, column y_m: the cell is empty"),
        (
            "name,x_m,y_m\nap1,0,0\nap2,0,0\nap1,0,0\n",
            "places.csv, row 4, column name: 'ap1' stands there twice",
        ),
    ],
)
def test_survey_csv_names_what_is_wrong_with_access_points(tmp_path, places, message):
    (tmp_path / "survey.csv").write_text(OWN)
    (tmp_path / "places.csv").write_text(places)
    with pytest.raises(InputError) as caught:
        survey_csv.load(tmp_path, access_points="places.csv")
    assert str(caught.value).startswith(message)


@st.composite
def surveys(draw):
    rows, access_points = draw(st.integers(2, 12)), draw(st.integers(1, 6))
    coordinate = st.floats(-1e6, 1e6, allow_subnormal=False)
    strength = st.one_of(st.just(np.nan), st.floats(-110, 20, allow_subnormal=False))
    position_m = draw(arrays(float, (rows, 2), elements=coordinate))
    position_m[0] = position_m[1] + 1  # at least two places
    return position_m, draw(arrays(float, (rows, access_points), elements=strength))


@settings(max_examples=60, deadline=None)
@given(survey=surveys(), shuffle=st.randoms(use_true_random=False))
def test_survey_csv_round_trip(survey, shuffle):
    """A survey that is written and loaded is the same to the last bit, however its columns are ordered."""
    position_m, rss_dbm = survey
    names = [f"ap {number}_dbm" for number in range(rss_dbm.shape[1])]
    column = dict(zip(["x_m", "y_m", *names], np.hstack([position_m, rss_dbm]).T, strict=True))
    order = list(column)
    shuffle.shuffle(order)
    with tempfile.TemporaryDirectory() as folder:
        with (Path(folder) / "survey.csv").open("w", newline="") as handle:
            writer = csv.writer(handle)
            writer.writerow(order)
            for row in range(len(position_m)):
                values = [column[name][row] for name in order]
                writer.writerow(["" if np.isnan(value) else repr(float(value)) for value in values])
        observed, truth = survey_csv.load(folder)
    rss_order = [int(name.split()[1].removesuffix("_dbm")) for name in order if name.endswith("_dbm")]
    assert_array_equal(observed["survey.position_m"][0], position_m)
    assert_array_equal(observed["survey.rss_dbm"][0], rss_dbm[:, rss_order])
    assert_array_equal(truth["truth.position_m"][0], position_m)


# ---- the register


def write_register(path, **changes):
    row = (
        dict.fromkeys(COLUMNS, "text")
        | {
            "source": "office",
            "file": "survey.csv",
            "kind": "real",
            "bytes": str(len(OWN)),
            "sha256": hashlib.sha256(OWN.encode()).hexdigest(),
            "where_from": "owner/office",
            "version": "3",
        }
        | changes
    )
    with path.open("w", newline="") as handle:
        writer = csv.DictWriter(handle, COLUMNS)
        writer.writeheader()
        writer.writerow(row)
    return path


def test_register_of_the_project():
    records = read_register()
    assert {record.source for record in records} >= {"wifi_fingerprint_collection", "wifi_rtt_rss_rooms"}
    assert {record.file for record in records if record.source == "wifi_fingerprint_collection"} == {
        f"{name}.mat" for name in wifi_fingerprint_collection.NAMES
    }
    assert sum(record.source == "wifi_rtt_rss_rooms" for record in records) == 3 * len(
        wifi_rtt_rss_rooms.AREAS
    )
    # The Manhattan world of the pose graphs is a simulation that others have published.
    assert {record.file for record in records if record.kind != "real"} == {"M3500.txt"}
    assert not re.search(r"https?:|www\.", REGISTER.read_text(encoding="utf-8"))


@pytest.mark.parametrize("source", ["wifi_fingerprint_collection", "wifi_rtt_rss_rooms"])
def test_registered_files_are_those_on_disk(source):
    folder = REALDATA / source
    if not folder.is_dir():
        pytest.skip(f"no recordings in {folder} (REPOSITION_REALDATA)")
    checked = check_files(folder, source)
    assert checked == [record for record in read_register() if record.source == source]
    assert all((folder / record.file).stat().st_size == record.bytes for record in checked)


def test_check_files_names_expected_and_found_digest(tmp_path):
    register = write_register(tmp_path / "sources.csv")
    (tmp_path / "survey.csv").write_text(OWN)
    assert [record.file for record in check_files(tmp_path, "office", register=register)] == ["survey.csv"]
    changed = OWN.replace("-50", "-51")
    (tmp_path / "survey.csv").write_text(changed)
    with pytest.raises(InputError) as caught:
        check_files(tmp_path, "office", ["survey.csv"], register=register)
    for text in (OWN, changed):
        assert hashlib.sha256(text.encode()).hexdigest() in str(caught.value)
    assert "survey.csv" in caught.value.thing
    assert "version 3 from owner/office" in caught.value.cure


def test_check_files_names_a_missing_and_an_unregistered_file(tmp_path):
    register = write_register(tmp_path / "sources.csv")
    with pytest.raises(InputError, match=r"survey\.csv: there is no such file"):
        check_files(tmp_path, "office", register=register)
    with pytest.raises(InputError, match="there is no such folder"):
        check_files(tmp_path / "nowhere", "office", register=register)
    (tmp_path / "other.csv").write_text(OWN)
    with pytest.raises(
        InputError, match=r"other\.csv: it is not in sources\.csv, which registers survey\.csv"
    ):
        check_files(tmp_path, "office", ["other.csv"], register=register)


def test_check_files_of_a_source_without_register_rows_only_looks_for_them(tmp_path):
    register = write_register(tmp_path / "sources.csv")
    (tmp_path / "own.csv").write_text(OWN)
    assert check_files(tmp_path, "my_office", ["own.csv"], register=register) == []
    with pytest.raises(InputError, match=r"mine\.csv: there is no such file"):
        check_files(tmp_path, "my_office", ["mine.csv"], register=register)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kind": "measured"}, r"row 2, column kind: 'measured' is none of real, synthetic"),
        ({"sha256": "abc"}, r"row 2, column sha256: 'abc' is no sha256"),
        ({"bytes": "12 kB"}, r"row 2, column bytes: '12 kB' is no length"),
        ({"licence": " "}, r"row 2, column licence: '' is empty"),
    ],
)
def test_read_register_names_row_and_column(tmp_path, changes, message):
    with pytest.raises(InputError, match=rf"^sources\.csv, {message}"):
        read_register(write_register(tmp_path / "sources.csv", **changes))


def test_read_register_wants_its_columns_and_every_file_once(tmp_path):
    register = write_register(tmp_path / "sources.csv")
    lines = register.read_text().splitlines()
    register.write_text("\n".join([lines[0].replace("licence", "license"), lines[1]]))
    with pytest.raises(InputError, match=r"sources\.csv, row 1: the columns are .*license"):
        read_register(register)
    register.write_text("\n".join([*lines, lines[1]]))
    with pytest.raises(InputError, match=r"row 3: survey\.csv of office stands there twice"):
        read_register(register)
    register.write_text("\n".join([*lines, "office,two.csv"]))
    with pytest.raises(InputError, match=r"row 3: it has 2 cells, 9 are needed"):
        read_register(register)


# ---- the guide


def test_guide_shows_configuration_and_table_that_work(tmp_path):
    guide = (CHECKOUT / "docs" / "add-a-data-set.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```(\w+)\n(.*?)```", guide, re.DOTALL)
    entries = {}
    for kind, text in blocks:
        if kind == "yaml":
            for study in yaml.safe_load(text)["studies"].values():
                entries |= study["recordings"]
    own = [entry for entry in entries.values() if entry["adapter"] == "survey_csv"]
    assert own
    for entry in own:
        load = import_module(f"positioning.recordings.{entry['adapter']}").load
        keywords = {p.name for p in inspect.signature(load).parameters.values() if p.kind is p.KEYWORD_ONLY}
        assert set(entry) - {"adapter", "source"} <= keywords
    tables = [text for kind, text in blocks if kind == "csv" and text.startswith("x_m")]
    assert tables
    for text in tables:
        (tmp_path / "survey.csv").write_text(text)
        assert survey_csv.load(tmp_path).observed["survey.rss_dbm"].shape[0] == 1
    assert find_file(CHECKOUT, "data/sources.csv") == REGISTER
    header = [text.splitlines()[0] for kind, text in blocks if kind == "csv" and text.startswith("source,")]
    assert header == [",".join(COLUMNS)]
