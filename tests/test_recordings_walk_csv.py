"""A user's own recording with beacons: the three tables, what is refused, and that the tasks run on it."""

import csv
import inspect
import re
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from algorithms.ranging.path_loss import PathLoss
from algorithms.tracking.particle_filter import ParticleFilter
from algorithms.trilateration.least_squares import LeastSquares
from positioning.errors import InputError
from positioning.recordings import walk_csv
from positioning.tasks import ranging, tracking, trilateration

CHECKOUT = Path(__file__).resolve().parents[1]
NAN = np.nan
MOTION = ("turn_before_rad", "advance_m", "turn_after_rad")
MOTION_TEXT = "turn_before_rad,advance_m,turn_after_rad"

WALK = "time_s,x_m,y_m,a_dbm,b_dbm,c_dbm\n0,1,1,-50,,-60\n1.5,2,1,-51.5,NaN,-59\n2,2,3,-52,-70,-58\n"
BEACONS = "name,x_m,y_m,room\nc,0,4,hall\nspare,9,9,\na,0,0,hall\nb,5,0,hall\n"
CALIBRATION = "distance_m,rss_dbm\n1,-50\n2,-56\n3,\n"


def written(folder, walk=WALK, beacons=BEACONS, calibration=CALIBRATION):
    for name, text in (("walk", walk), ("beacons", beacons), ("calibration", calibration)):
        (Path(folder) / f"{name}.csv").write_text(text)
    return folder


def with_motion(*cells):
    header, *rows = WALK.splitlines()
    lines = [f"{header},{MOTION_TEXT}"]
    lines += [f"{row},{cell}" for row, cell in zip(rows, cells, strict=True)]
    return "\n".join(lines) + "\n"


def test_walk_csv_reads_three_tables(tmp_path):
    observed, truth = walk_csv.load(written(tmp_path))
    assert set(observed) == {
        "site.corner_m",
        "site.access_point_m",
        "calibration.distance_m",
        "calibration.rss_dbm",
        "recording.time_s",
        "recording.rss_dbm",
    }
    assert set(truth) == {"truth.position_m", "truth.distance_m"}
    assert_array_equal(observed["site.access_point_m"], [[[0, 0], [5, 0], [0, 4]]])
    assert_array_equal(observed["site.corner_m"], [[[0, 0], [5, 4]]])
    assert_array_equal(observed["calibration.distance_m"], [[1, 2, 3]])
    assert_array_equal(observed["calibration.rss_dbm"], [[-50, -56, NAN]])
    assert_array_equal(observed["recording.time_s"], [[0, 1.5, 2]])
    assert_array_equal(observed["recording.rss_dbm"], [[[-50, NAN, -60], [-51.5, NAN, -59], [-52, -70, -58]]])
    assert_array_equal(truth["truth.position_m"], [[[1, 1], [2, 1], [2, 3]]])
    squared_m2 = [[[2, 17, 10], [5, 10, 13], [13, 18, 5]]]
    assert_allclose(truth["truth.distance_m"], np.sqrt(squared_m2), rtol=1e-14)


def test_walk_csv_reads_the_motion(tmp_path):
    observed = walk_csv.load(written(tmp_path, with_motion("0,0,0", "0.5,1,-0.25", "0,2,1.5"))).observed
    motion = [observed[f"recording.{name}"] for name in MOTION]
    assert_array_equal(motion, [[[0, 0.5, 0]], [[0, 1, 2]], [[0, -0.25, 1.5]]])


def test_walk_csv_reads_other_file_names_and_what_spreadsheets_write(tmp_path):
    plain = walk_csv.load(written(tmp_path)).observed
    for name, text in (("w", WALK), ("p", BEACONS), ("k", CALIBRATION)):
        excel = b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode() + b"\r\n"
        (tmp_path / f"{name}.csv").write_bytes(excel)
    other = walk_csv.load(tmp_path, walk="w.csv", beacons="p.csv", calibration="k.csv").observed
    for name, values in plain.items():
        assert_array_equal(values, other[name])


@pytest.mark.parametrize("time_s", ["0", "7.25"])
def test_walk_csv_takes_equal_times_for_static_places(tmp_path, time_s):
    walk = re.sub(r"^[\d.]+,", f"{time_s},", WALK, flags=re.MULTILINE)
    observed = walk_csv.load(written(tmp_path, walk)).observed
    assert_array_equal(observed["recording.time_s"], [[float(time_s)] * 3])


@pytest.mark.parametrize("missing", ["walk", "beacons", "calibration"])
def test_walk_csv_names_a_file_that_is_missing(tmp_path, missing):
    (written(tmp_path) / f"{missing}.csv").unlink()
    with pytest.raises(InputError, match=rf"{missing}\.csv.*no such file"):
        walk_csv.load(tmp_path)


WRONG_WALKS = {
    "empty": ("", "walk.csv: the file has 0 row(s), a header and at least one epoch"),
    "header only": (WALK.splitlines()[0], "walk.csv: the file has 1 row"),
    "no time": (WALK.replace("time_s", "t_dbm"), "walk.csv, row 1, column time_s: it is missing"),
    "semicolons": (WALK.replace(",", ";"), "walk.csv, row 1, column time_s: it is missing"),
    "no place": (WALK.replace("y_m", "z_dbm"), "walk.csv, row 1, column y_m: it is missing"),
    "other column": (WALK.replace("a_dbm", "a"), "walk.csv, row 1, column a: it is neither time_s nor x_m"),
    "no beacon": ("time_s,x_m,y_m\n0,1,1\n", "walk.csv, row 1: no column ends in _dbm"),
    "twice": (WALK.replace("b_dbm", "a_dbm"), "walk.csv, row 1, column a_dbm: it stands there twice"),
    "short row": (WALK + "3,1,1,-50\n", "walk.csv, row 5, column b_dbm: the row has 4 cells"),
    "word in time": (WALK + "noon,1,1,,,\n", "walk.csv, row 5, column time_s: 'noon' is no number"),
    "no time in a row": (WALK + ",1,1,,,\n", "walk.csv, row 5, column time_s: the cell is empty"),
    "infinite time": (WALK + "inf,1,1,,,\n", "walk.csv, row 5, column time_s: the cell holds inf"),
    "time decreases": (
        WALK + "1.75,1,1,,,\n",
        "walk.csv, row 5, column time_s: the time 1.75 is not after 2",
    ),
    "time stands": (WALK + "\n2,1,1,,,\n", "walk.csv, row 6, column time_s: the time 2 is not after 2"),
    "empty place": (WALK + "3,,1,,,\n", "walk.csv, row 5, column x_m: the cell is empty"),
    "word in strength": (WALK + "3,1,1,,weak,\n", "walk.csv, row 5, column b_dbm: 'weak' is no number"),
    "mark 100": (WALK + "3,1,1,,,100\n", "walk.csv, row 5, column c_dbm: the cell holds 100"),
    "mark -200": (WALK + "3,1,1,-200,,\n", "walk.csv, row 5, column a_dbm: the cell holds -200"),
    "part of the motion": (
        WALK.replace("c_dbm", "advance_m").replace("-60", "0"),
        "walk.csv, row 1, column turn_before_rad: it is missing",
    ),
    "gap in the motion": (
        with_motion("0,0,0", "0,,0", "0,1,0"),
        "walk.csv, row 3, column advance_m: the cell is empty",
    ),
    "motion before the first row": (
        with_motion("0,0,-0.5", "0,1,0", "0,1,0"),
        "walk.csv, row 2, column turn_after_rad: the cell holds -0.5",
    ),
    "motion without times": (
        re.sub(r"^[\d.]+,", "0,", with_motion("0,0,0", "0,1,0", "0,1,0"), flags=re.MULTILINE),
        "walk.csv, column time_s: all times are equal",
    ),
}


@pytest.mark.parametrize(("text", "message"), WRONG_WALKS.values(), ids=WRONG_WALKS.keys())
def test_walk_csv_names_what_is_wrong_with_the_walk(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        walk_csv.load(written(tmp_path, walk=text))
    assert str(caught.value).startswith(message)
    assert caught.value.cure
    assert "access point" not in str(caught.value)


WRONG_BEACONS = {
    "no name": (BEACONS.replace("name", "beacon"), "beacons.csv, row 1, column name: it is missing"),
    "missing": (BEACONS.replace("b,5", "d,5"), "beacons.csv, column name: 'b' is missing, walk.csv has"),
    "twice": (BEACONS + "a,1,1,\n", "beacons.csv, row 6, column name: 'a' stands there twice"),
    "no place": (BEACONS.replace("c,0,4", "c,0,"), "beacons.csv, row 2, column y_m: the cell is empty"),
    "one place": (
        BEACONS.replace("c,0,4", "c,5,0.0"),
        "beacons.csv, b and c: both stand at the same place",
    ),
    "one line": (
        BEACONS.replace("c,0,4", "c,2,0"),
        "beacons.csv, those heard in walk.csv: all beacons stand",
    ),
}


@pytest.mark.parametrize(("text", "message"), WRONG_BEACONS.values(), ids=WRONG_BEACONS.keys())
def test_walk_csv_names_what_is_wrong_with_the_beacons(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        walk_csv.load(written(tmp_path, beacons=text))
    assert str(caught.value).startswith(message)


def test_walk_csv_wants_three_beacons(tmp_path):
    walk = "time_s,x_m,y_m,a_dbm,b_dbm\n0,1,1,-50,-60\n"
    with pytest.raises(InputError, match=r"^beacons\.csv, those heard in walk\.csv: 2 beacon"):
        walk_csv.load(written(tmp_path, walk))


WRONG_CALIBRATIONS = {
    "no strength": ("distance_m,rssi\n1,-50\n", "calibration.csv, row 1, column rss_dbm: it is missing"),
    "header only": ("distance_m,rss_dbm\n", "calibration.csv: the file has 1 row(s), a header and at least"),
    "zero": (CALIBRATION + "0,-40\n", "calibration.csv, row 5, column distance_m: the cell holds 0"),
    "empty": (CALIBRATION + ",-40\n", "calibration.csv, row 5, column distance_m: the cell is empty"),
    "mark": (CALIBRATION + "4,100\n", "calibration.csv, row 5, column rss_dbm: the cell holds 100"),
    "word": (CALIBRATION + "4,far\n", "calibration.csv, row 5, column rss_dbm: 'far' is no number"),
    "one distance": (
        "distance_m,rss_dbm\n1,-50\n1,-51\n2,\n",
        "calibration.csv: strengths were heard at 1 different distance(s)",
    ),
}


@pytest.mark.parametrize(("text", "message"), WRONG_CALIBRATIONS.values(), ids=WRONG_CALIBRATIONS.keys())
def test_walk_csv_names_what_is_wrong_with_the_calibration(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        walk_csv.load(written(tmp_path, calibration=text))
    assert str(caught.value).startswith(message)


@st.composite
def walks(draw):
    epochs, beacons = draw(st.integers(1, 8)), draw(st.integers(3, 6))
    coordinate = st.floats(-1e4, 1e4, allow_subnormal=False)
    strength = st.one_of(st.just(NAN), st.floats(-110, 20, allow_subnormal=False))
    steps_s = draw(arrays(float, epochs, elements=st.floats(1e-3, 1e3)))
    position_m = draw(arrays(float, (epochs, 2), elements=coordinate))
    return np.cumsum(steps_s), position_m, draw(arrays(float, (epochs, beacons), elements=strength))


@settings(max_examples=40, deadline=None)
@given(walk=walks(), shuffle=st.randoms(use_true_random=False))
def test_walk_csv_round_trip(walk, shuffle):
    """A walk that is written and loaded is the same to the last bit, however columns and rows are ordered."""
    time_s, position_m, rss_dbm = walk
    names = [f"beacon {number}" for number in range(rss_dbm.shape[1])]
    turn_rad = 2 * np.pi * np.arange(len(names)) / len(names)
    place_m = dict(zip(names, 3 * np.stack([np.cos(turn_rad), np.sin(turn_rad)], axis=-1), strict=True))
    header = ["time_s", "x_m", "y_m", *(f"{name}_dbm" for name in names)]
    column = dict(zip(header, np.column_stack([time_s, position_m, rss_dbm]).T, strict=True))
    shuffle.shuffle(header)
    shuffle.shuffle(names)
    cell = {True: lambda value: "", False: lambda value: repr(float(value))}
    with tempfile.TemporaryDirectory() as folder:
        written(folder)
        with (Path(folder) / "walk.csv").open("w", newline="") as handle:
            rows = [
                [cell[bool(np.isnan(v))](v) for v in row] for row in np.array([column[n] for n in header]).T
            ]
            csv.writer(handle).writerows([header, *rows])
        with (Path(folder) / "beacons.csv").open("w", newline="") as handle:
            places = [[name, *map(repr, place_m[name].tolist())] for name in names]
            csv.writer(handle).writerows([["name", "x_m", "y_m"], *places])
        observed, truth = walk_csv.load(folder)
    order = [name for name in header if name.endswith("_dbm")]
    assert_array_equal(observed["recording.time_s"][0], time_s)
    assert_array_equal(observed["recording.rss_dbm"][0], np.stack([column[name] for name in order], axis=-1))
    assert_array_equal(observed["site.access_point_m"][0], [place_m[n.removesuffix("_dbm")] for n in order])
    assert_array_equal(truth["truth.position_m"][0], position_m)
    offset = position_m[:, None] - observed["site.access_point_m"][0]
    assert_allclose(truth["truth.distance_m"][0], np.hypot(offset[..., 0], offset[..., 1]), rtol=1e-12)


# ---- the guide, and the tasks on what it shows


def guide_section():
    guide = (CHECKOUT / "docs/add-a-data-set.md").read_text(encoding="utf-8")
    return guide.partition("\n## A recording with beacons\n")[2].partition("\n## ")[0]


def guide_tables():
    tables = re.findall(r"```csv\n(.*?)```", guide_section(), re.DOTALL)
    return {"walk": tables[0], "beacons": tables[1], "calibration": tables[2]}


def exact_walk(time_s, beacon_m, position_m):
    """Text of a walk whose strengths are -58 dBm at one metre and fall by 20 dB a decade."""
    rss_dbm = -58 - 20 * np.log10(np.linalg.norm(position_m[:, None] - beacon_m, axis=-1))
    rows = np.column_stack([time_s, position_m, rss_dbm]).tolist()
    return "\n".join(["time_s,x_m,y_m,a_dbm,b_dbm,c_dbm", *(",".join(map(repr, row)) for row in rows)])


def run_tasks(worlds):
    rngs = [np.random.default_rng(0)]
    for task, make, options in (
        (ranging, PathLoss, {}),
        (trilateration, LeastSquares, {"ranging": {"use": "path_loss", "task": "ranging"}}),
        (tracking, partial(ParticleFilter, ranging=PathLoss(), trilateration=LeastSquares()), {}),
    ):
        outcome = task.run(make, worlds.observed, None, options, rngs)
        yield outcome.skipped, None if outcome.skipped else task.score(outcome.estimates, worlds.truth)


def test_the_tasks_find_the_places_of_an_exact_walk(tmp_path):
    beacon_m = np.array([[0.0, 0.0], [5.0, 0.0], [0.0, 4.0]])
    position_m = np.array([[1.0, 1.0], [1.5, 1.2], [2.0, 1.4], [2.5, 2.0]])
    calibration = "distance_m,rss_dbm\n1,-58\n10,-78\n"
    walk = exact_walk(np.arange(4.0), beacon_m, position_m)
    results = list(run_tasks(walk_csv.load(written(tmp_path, walk, calibration=calibration))))
    assert [skipped for skipped, _ in results] == ["", "", ""]
    distances, places, track = (scored["error_m"] for _, scored in results)
    assert distances.shape == (1, 12)
    assert distances.max() < 1e-9
    assert places.shape == track.shape == (1, 4)
    assert places.max() < 1e-6
    assert track.max() < 0.5

    static = exact_walk(np.zeros(4), beacon_m, position_m)
    results = list(run_tasks(walk_csv.load(written(tmp_path, static, calibration=calibration))))
    assert [bool(skipped) for skipped, _ in results] == [False, False, True]
    assert "without an order" in results[2][0]


def test_the_guide_shows_tables_and_configuration_that_work(tmp_path):
    worlds = walk_csv.load(written(tmp_path, **guide_tables()))
    assert worlds.observed["recording.rss_dbm"].shape == (1, 4, 3)
    # Its motion leads along its places, first along the x axis; its strengths are the calibration's.
    before_rad, advance_m, after_rad = (worlds.observed[f"recording.{name}"][0] for name in MOTION)
    course_rad = np.cumsum(before_rad + after_rad) - after_rad
    step_m = np.stack([advance_m * np.cos(course_rad), advance_m * np.sin(course_rad)], axis=-1)
    position_m = worlds.truth["truth.position_m"][0]
    assert_allclose(np.diff(position_m, axis=0), step_m[1:], atol=1e-4)
    law_dbm = -58 - 20 * np.log10(worlds.truth["truth.distance_m"])
    off_db = np.abs(worlds.observed["recording.rss_dbm"] - law_dbm)
    assert np.nanmax(off_db) <= 0.5
    assert [skipped for skipped, _ in run_tasks(worlds)] == ["", "", ""]

    (entry,) = re.findall(r"```yaml\n(.*?)```", guide_section(), re.DOTALL)
    (study,) = yaml.safe_load(entry)["studies"].items()
    shipped = yaml.safe_load((CHECKOUT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    assert "recordings" in shipped[study[0]]
    options = study[1]["recordings"]["my_hall"]
    assert options["adapter"] == "walk_csv"
    keywords = {
        p.name for p in inspect.signature(walk_csv.load).parameters.values() if p.kind is p.KEYWORD_ONLY
    }
    assert set(options) - {"adapter", "source"} <= keywords
