"""Figures of the WiFi graph SLAM studies, from invented walks whose numbers the test knows."""

import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from positioning.evaluation.measures import MEASURES, measure
from positioning.evaluation.results import StudyResults
from positioning.evaluation.studies.graph_slam import located_error_m
from positioning.files import read_yaml, write_errors, write_tree
from positioning.geometry import rotated
from positioning.posegraph.similarity import rss_distance_db
from positioning.presentation.studies.graph_slam_radio import BIN_M, LEAST_PAIRS, running_median
from positioning.presentation.study_figures import draw
from positioning.presentation.style import KNOWN, contrast, difference, drawing

ROOT = Path(__file__).resolve().parents[1]
PAPER = read_yaml(ROOT / "data/papers/graph_slam.yaml")
WORLDS, WALKS, POSES, HEARD = 3, 3, 40, 5
VISITED = np.arange(2, POSES - 4, 6)
LEVELS = {"dead_reckoning": 30.0, "graph_slam": 6.0, "ransac": 4.0, "aligned": 1.0, "aligned_linear": 1.5}
LEVELS |= {"aligned_cauchy": 0.5, "control_rigid": 2.0, "control_centre": 25.0}
SWEEPS = {
    "window": ("window", (4.0, 10.0)),
    "farthest": ("d_max_m", (10.0, 30.0)),
    "fixed_threshold": ("threshold", (3.0, 6.0)),
    "access_points": ("access_points", (9.0, 70.0)),
}
WEIGHTS = {
    "weight": ("wifi_weight", (1e-5, 1e-3, 1e-1)),
    "weight_linear": ("wifi_weight", (1e-5, 1e-3, 1e-1)),
    "weight_cauchy": ("wifi_weight", (1e-3, 1e-1)),
}
WORLD = ["fig1", "fig4", "fig5", "fig6"]
ALL = [*WORLD, "fig7", "fig8", "printed", "starts", "costs", "paired", *SWEEPS]
TURN_RAD, SHIFT_M = 0.7, np.array([40.0, -25.0])


def world(family):
    """Walks along streets, or along one line; three readings at each pose, a survey and test fingerprints."""
    rng = np.random.default_rng(len(family))
    path_m = np.cumsum(rng.uniform(-1, 2, (WALKS, POSES, 2)), axis=1) + 3
    if family == "lines":
        path_m = np.broadcast_to(
            np.stack([np.arange(POSES), np.full(POSES, 9.0)], axis=-1), path_m.shape
        ).copy()
    path_m[-1, -3:] = np.nan
    position_m = np.full_like(path_m, np.nan)
    position_m[:, VISITED] = path_m[:, VISITED]
    survey_m, query_m = rng.uniform(0, 40, (50, 2)), rng.uniform(0, 40, (20, 2))
    beacon_m = rng.uniform(0, 40, (HEARD, 2))

    def rss_dbm(place_m):
        return np.round(-40 - 1.2 * np.linalg.norm(place_m[..., None, :] - beacon_m, axis=-1))

    pair_m = rng.uniform(0, 30, (2, 25, 2))
    observed = {
        "site.corner_m": [[-20.0, -20.0], [60.0, 60.0]],
        "site.wall_m": [[[0.0, 0.0], [40.0, 0.0]], [[40.0, 0.0], [40.0, 30.0]]],
        "walks.time_s": np.where(np.isnan(path_m[..., 0]), np.nan, 30.0 * np.arange(POSES)),
        "walks.position_m": rotated(path_m - path_m[:, :1], TURN_RAD),
        "walks.heading_rad": np.zeros((WALKS, POSES)),
        "walks.rss_dbm": rss_dbm(path_m),
        "survey.rss_dbm": rss_dbm(survey_m),
        "survey.position_m": survey_m,
        "survey.sparse": np.arange(50) % 4 == 0,
        "query.rss_dbm": rss_dbm(query_m),
        "pairs.dense_position_m": pair_m[0],
        "pairs.dense_rss_dbm": rss_dbm(pair_m[0]),
        "pairs.sparse_position_m": pair_m[1],
        "pairs.sparse_rss_dbm": np.where(np.arange(HEARD) < 2, rss_dbm(pair_m[1]), np.nan),
    }
    truth = {
        "truth.position_m": position_m,
        "truth.path_m": path_m,
        "truth.heading_rad": np.zeros((WALKS, POSES)),
        "truth.query_m": query_m,
    }
    index = {"world": np.arange(WORLDS), "seed": np.arange(WORLDS)}
    return [
        index | {name: np.repeat(np.asarray(v)[None], WORLDS, axis=0) for name, v in side.items()}
        for side in (observed, truth)
    ]


def placed_m(row, truth):
    """The true path in a frame of its own; raw walks begin at one place."""
    path_m = truth["truth.path_m"]
    if row == "dead_reckoning":
        path_m = path_m - path_m[:, :, :1]
    return rotated(path_m, TURN_RAD) + SHIFT_M


def errors_of(levels, values=(np.nan,), families=("walks", "lines")):
    """A quarter below the level or above it, 0.1 m more a world; twice as much by the first pose."""
    parts = []
    for family, (level, value) in itertools.product(families, zip(levels, values, strict=True)):
        for number in range(WORLDS):
            error_m = (level + 0.1 * number) * (1 + 0.25 * np.where(np.arange(WALKS * 6) % 2, 1, -1))
            columns = {"family": family, "value": value, "world": number, "sample": np.arange(WALKS * 6)}
            parts.append(pd.DataFrame({**columns, "error_m": error_m, "error_first_m": 2 * error_m}))
    return pd.concat(parts, ignore_index=True)


def own_measures():
    lines = []
    for row, level in LEVELS.items():
        own = {"sd_m": 0.25 * level, "first_mean_m": 2 * level, "first_sd_m": 0.5 * level}
        own |= {
            "first_max_m": 2.5 * level,
            "own_first_max_m": 0.6 * level,
            "map_within_10m": 0.8 - level / 100,
        }
        lines += [("walks", row, np.nan, metric, value) for metric, value in own.items()]
        lines += [("lines", row, np.nan, "heading_mean_deg", level / 2)]
        lines += [("lines", row, np.nan, "heading_sd_deg", level / 4)]
    for name, share in (("surveyed", 0.9), ("surveyed_sparse", 0.85), ("crowdsourced_true_poses", 0.8)):
        lines.append(("walks", name, np.nan, "map_within_10m", share))
    lines += [("walks", f"pairs_{site}", np.nan, "distance_near_db", 12.0) for site in ("dense", "sparse")]
    lines += [
        ("walks", name, value, "edges", 1000 * value)
        for name, (_, values) in SWEEPS.items()
        for value in values
    ]
    return pd.DataFrame(
        [(f, row, v, number, m, x + 0.01 * number) for f, row, v, m, x in lines for number in range(WORLDS)],
        columns=MEASURES,
    )


def swept(name):
    """Levels of a sweep, one of which is that of the row that has the usual value."""
    values = (SWEEPS | WEIGHTS)[name][1]
    usual = {"window": 10, "farthest": 30, "access_points": 70, "weight": 1e-3, "weight_linear": 1e-3}
    row = "aligned_linear" if name == "weight_linear" else "aligned"
    return [LEVELS[row] if usual.get(name) == value else 3.0 for value in values]


def made(folder, name, rows, sweeps, families):
    sides = {family: world(family if family == "lines" else "walks") for family in families}
    frames = {row: errors_of([LEVELS[row]], families=families) for row in rows}
    frames |= {sweep: errors_of(swept(sweep), sweeps[sweep][1], families=families) for sweep in sweeps}
    error_files, estimate_files = [], []
    for row, frame in frames.items():
        path = folder / "errors" / row / "00000.parquet"
        path.parent.mkdir(parents=True)
        columns = {column: frame[column].to_numpy() for column in frame}
        write_errors(path, {**columns, "family": frame["family"].to_numpy(dtype=np.str_)}, {})
        error_files.append(str(path))
    for row in rows:
        path = folder / "estimates" / row / "00000.npz"
        path.parent.mkdir(parents=True)
        step = {"world": np.arange(WORLDS), "value": np.array(np.nan), "seconds": np.ones(WORLDS)}
        tree = {
            f"{family}/0": {
                **step,
                "skipped": np.array(""),
                "estimate.position_m": placed_m(row, truth),
                "estimate.heading_rad": truth["truth.heading_rad"] + TURN_RAD,
            }
            for family, (_, truth) in sides.items()
        }
        write_tree(path, tree)
        estimate_files.append(str(path))
    measured = [measure(frame, row) for row, frame in frames.items()]
    if name == "graph_slam":
        measured.append(own_measures())
    return StudyResults(
        study=name,
        rows=(*rows, "gtsam"),
        sweeps=dict(sweeps),
        measures=pd.concat(measured, ignore_index=True),
        error_files=tuple(error_files),
        observed={family: side[0] for family, side in sides.items()},
        truth={family: side[1] for family, side in sides.items()},
        paper=PAPER,
        estimate_files=tuple(estimate_files),
    )


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return made(tmp_path_factory.mktemp("graph"), "graph_slam", list(LEVELS), SWEEPS, ("walks", "lines"))


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    rows = ["aligned", "aligned_linear", "ransac", "control_rigid"]
    return made(tmp_path_factory.mktemp("weight"), "graph_slam_weight", rows, WEIGHTS, ("walks",))


@pytest.fixture(scope="module")
def chain(tmp_path_factory):
    rows = ["dead_reckoning", "ransac", "aligned", "control_rigid", "control_centre"]
    return made(tmp_path_factory.mktemp("imu"), "graph_slam_imu", rows, {}, ("worlds",))


def by_name(results):
    return {item.name: item for item in draw(results)}


@pytest.fixture(scope="module")
def drawn(study, weights, chain):
    return by_name(study) | by_name(weights) | by_name(chain)


def kept(results, condition):
    return replace(results, measures=results.measures[condition(results.measures)])


def line(axes, label):
    return next(item for item in axes.get_lines() if item.get_label() == label)


def dots(axes, marker):
    """Data of single markers, those of the legend left out."""
    found = [item for item in axes.get_lines() if item.get_marker() == marker]
    return np.array([item.get_xydata()[0] for item in found if len(item.get_xydata()) == 1])


def first(side, name, family="walks"):
    return np.asarray(side[family][name][0], dtype=float)


@pytest.mark.filterwarnings("error")
def test_all_figures_are_there_in_order_and_keep_clear_of_each_other(study, weights, chain, drawn):
    assert list(drawn) == [*ALL, "weight", "walks", "landmarks"]
    assert list(by_name(study)) == ALL
    assert list(by_name(weights)) == ["weight"]
    assert list(by_name(chain)) == ["walks", "landmarks"]
    for item in drawn.values():
        with drawing():
            # A layout that finds no room for an axis or a label warns.
            item.figure.draw_without_rendering()


def test_captions_tell_samples_worlds_and_what_is_assumed_and_alt_texts_have_numbers(drawn):
    for name, item in drawn.items():
        assert "n = " in item.caption, name
        assert "world" in item.caption.lower(), name
        assert "assumed" in item.caption, name
        assert len(re.findall(r"\d", item.alt)) > 1, name
        assert "nan" not in item.caption + item.alt, name


def test_axes_have_units(drawn):
    for name, item in drawn.items():
        for axes in item.figure.axes:
            words = axes.get_xlabel() + axes.get_ylabel()
            assert re.search(r"\((m|1|dB|1/m|degrees|scans|%|thousands)\)|\(m\)\n", words), (name, words)


def test_scans_are_compared_by_equation_9_and_medians_are_those_of_bins(study, drawn):
    observed = study.observed
    position_m = first(observed, "pairs.dense_position_m")
    pairs = np.triu_indices(len(position_m), 1)
    apart_m = np.linalg.norm(position_m[pairs[0]] - position_m[pairs[1]], axis=-1)
    apart_db = rss_distance_db(first(observed, "pairs.dense_rss_dbm"))[pairs]
    curve = line(drawn["fig1"].figure.axes[0], "dense WiFi").get_xydata()
    for middle_m, median_db in curve:
        inside = np.abs(apart_m - middle_m) < BIN_M / 2
        assert inside.sum() >= LEAST_PAIRS
        assert median_db == pytest.approx(np.median(apart_db[inside]))
    near = (apart_m >= 8) & (apart_m <= 12)
    assert f"dense {apart_db[near].mean():.1f} dB" in drawn["fig1"].alt
    assert f"dense {HEARD}, sparse 2" in drawn["fig1"].caption
    middle_m, median_db = running_median(
        np.repeat([1.0, 5.0], [LEAST_PAIRS, 3]), np.arange(LEAST_PAIRS + 3.0)
    )
    assert (middle_m.tolist(), median_db.tolist()) == ([BIN_M / 2], [(LEAST_PAIRS - 1) / 2])


def test_lines_are_tied_by_the_first_walk_alone(study, drawn):
    path_m = first(study.truth, "truth.path_m", "lines")
    raw, printed, aligned, wide = drawn["fig4"].figure.axes
    for axes in (raw, printed, aligned, wide):
        np.testing.assert_allclose(axes.get_lines()[0].get_xydata(), path_m[0], atol=1e-9)
    titles = [axes.get_title(loc="left") for axes in (raw, printed, aligned)]
    assert titles == ["raw: 15.00°", "start as printed: 3.00°", "aligned first: 0.50°"]
    assert "1.0 ± 0.5 degrees" in drawn["fig4"].caption


def test_raw_walks_are_drawn_in_their_own_frames_and_others_over_the_plan(study, drawn):
    (axes,) = drawn["fig5"].figure.axes
    own_m, path_m = first(study.observed, "walks.position_m"), first(study.truth, "truth.path_m")
    for number in range(WALKS):
        np.testing.assert_allclose(line(axes, f"walk {number + 1}").get_xydata(), own_m[number])
    assert "largest error within a walk" in drawn["fig5"].caption.lower()
    assert "18.0 m" in drawn["fig5"].caption
    panels = drawn["fig6"].figure.axes
    assert len(panels) == 4
    for axes in panels:
        for number in range(WALKS):
            np.testing.assert_allclose(
                line(axes, f"walk {number + 1}").get_xydata(), path_m[number], atol=1e-9
            )
        landmarks_m = line(axes, "landmark").get_xydata()
        assert len(landmarks_m) == WALKS * len(VISITED)
    # The lower panels hold the walls, not the whole site.
    assert panels[2].get_xlim()[0] > -5
    assert panels[2].get_ylim()[1] < 40
    assert drawn["fig6"].alt.count("0.00 m") == 4


def test_histograms_are_densities_of_both_ties_below_what_is_printed(drawn):
    by_all, by_first = drawn["fig7"].figure.axes
    for axes, factor in ((by_all, 1), (by_first, 2)):
        (outline,) = axes.patches
        x, y = outline.get_xy()[:-1].T
        assert abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2 == pytest.approx(1)
        reach_m = x[y > 0].max()
        assert reach_m == pytest.approx(1.2 * 1.25 * factor, abs=0.25)
        places = np.sort(dots(axes, "D")[:, 0])
        np.testing.assert_allclose(
            places, np.sort([1.4, (1.0 if factor == 1 else 2.0) + 0.1 / factor]), atol=0.1
        )
        assert 4.2 in dots(axes, "^")[:, 0]
        assert all(height > y.max() for height in dots(axes, "D")[:, 1])
    assert "mean 1.4 m, standard deviation 0.9 m, largest 4.2 m" in drawn["fig7"].caption


def test_radio_maps_are_those_of_the_study_and_printed_shares_stand_at_ten_metres(study, drawn):
    (axes,) = drawn["fig8"].figure.axes
    parts = [first(study.observed, f"survey.{name}") for name in ("rss_dbm", "position_m")]
    query = first(study.observed, "query.rss_dbm"), first(study.truth, "truth.query_m")
    expected_m = np.sort(located_error_m(*parts, *query))
    curve_m = np.unique(line(axes, "surveyed every 2 m").get_xdata())
    np.testing.assert_allclose(curve_m, np.unique(expected_m), rtol=1e-9)
    heard_dbm = first(study.observed, "walks.rss_dbm").reshape(-1, HEARD)
    path_m = first(study.truth, "truth.path_m").reshape(-1, 2)
    true_m = np.sort(located_error_m(heard_dbm, path_m, *query))
    for label in ("crowdsourced, true poses", "crowdsourced, aligned"):
        np.testing.assert_allclose(np.sort(line(axes, label).get_xdata())[::WORLDS], true_m, rtol=1e-6)
    np.testing.assert_allclose(sorted(dots(axes, "D").tolist()), [[10.0, 87.0], [10.0, 95.0]])
    np.testing.assert_allclose(np.sort(dots(axes, "o")[:, 1]), [80, 81, 86, 91])
    assert f"n = 20 test fingerprints in each of the first {WORLDS} worlds" in drawn["fig8"].caption


def test_curves_of_radio_maps_are_told_apart_without_colour(drawn):
    (axes,) = drawn["fig8"].figure.axes
    curves = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    assert len({line.get_linestyle() for line in curves}) == len(curves) > 1


def test_every_printed_number_stands_beside_its_own(drawn):
    panels = drawn["printed"].figure.axes
    claims = [c for c in PAPER["claims"] if c["kind"] == "value" and c["study"] == "graph_slam"]
    found = [place for axes in panels for place in dots(axes, "D")[:, 0]]
    assert sorted(found) == sorted(float(c["printed"]) for c in claims)
    assert sum(len(axes.get_yticks()) for axes in panels) == len(claims)
    labels = [label.get_text() for axes in panels for label in axes.get_yticklabels()]
    # A label of its own for each: none is the bare name of the claim.
    assert len(set(labels)) == len(claims)
    assert not {c["id"] for c in claims} & set(labels)
    metres = next(axes for axes in panels if "Fig. 7, mean" in [t.get_text() for t in axes.get_yticklabels()])
    means = dots(metres, "o")
    assert means[means[:, 1] == 0][0, 0] == pytest.approx(1.1)
    assert "raw walks, largest 18.01 m (printed 30)" in drawn["printed"].alt


def test_worlds_are_dots_and_differences_are_told(study, drawn):
    by_all, by_first = drawn["starts"].figure.axes
    found = [item.get_ydata() for item in by_all.get_lines() if item.get_marker() == "o"]
    np.testing.assert_allclose(found, [[6.0, 6.1, 6.2], [1.0, 1.1, 1.2]])
    found = [item.get_ydata() for item in by_first.get_lines() if item.get_marker() == "o"]
    np.testing.assert_allclose(found, [[12.0, 12.01, 12.02], [2.0, 2.01, 2.02]])
    assert line(by_all, "printed").get_ydata()[0] == 1.4
    assert "aligned first minus start as printed \N{MINUS SIGN}5.00 m" in drawn["starts"].alt
    mean, largest = drawn["costs"].figure.axes
    assert [t.get_text() for t in mean.get_xticklabels()] == ["squared", "linear", "Cauchy"]
    assert line(largest, "printed").get_ydata()[0] == 4.2
    assert "linear minus squared 0.50 m" in drawn["costs"].alt
    assert "Cauchy minus squared \N{MINUS SIGN}0.50 m" in drawn["costs"].alt
    (axes,) = drawn["paired"].figure.axes
    rows = [t.get_text() for t in axes.get_yticklabels()]
    assert rows == [row for row in LEVELS if row != "aligned"]
    places = {rows[int(height)]: x for x, height in dots(axes, "o")}
    assert places == pytest.approx({row: LEVELS[row] - 1.0 for row in rows})
    # Walks laid upon each other, and the control, lie beyond the axis; the others do not.
    assert axes.get_xlim()[1] < 24
    assert axes.get_xlim()[1] > 5
    assert sum("\N{RIGHTWARDS ARROW}" in text.get_text() for text in axes.texts) == 2


def test_the_printed_level_lies_within_the_axis(study):
    # All errors far below what is printed.
    small = study.measures.assign(
        x=np.where(study.measures["metric"].str.contains("mean_m|max_m"), 0.01, study.measures["x"])
    )
    found = by_name(replace(study, measures=small))
    for name in ("starts", "costs"):
        for axes in found[name].figure.axes:
            low, high = axes.get_ylim()
            level = line(axes, "printed").get_ydata()[0]
            assert low < 0.99 * level < 1.01 * level < high, name


def test_the_caption_of_costs_tells_the_weight_of_each_row(study):
    weight = {"aligned": 1e-4, "aligned_linear": 1e-4, "aligned_cauchy": 1e-3}
    told = replace(study, settings={row: {"wifi_weight": own} for row, own in weight.items()})
    caption = by_name(told)["costs"].caption
    assert "Weight of WiFi edges: squared 0.0001, linear 0.0001, Cauchy 0.001." in caption
    same = replace(study, settings={row: {"wifi_weight": 1e-4} for row in weight})
    assert "The weight of WiFi edges is 0.0001 for all." in by_name(same)["costs"].caption
    # Where nobody told the settings, nothing is said of them.
    assert "0.0001" not in by_name(study)["costs"].caption
    assert "baseline. Each cost has" in by_name(study)["costs"].caption


def test_a_long_bar_does_not_squeeze_the_short_ones(study):
    far = (study.measures["algorithm"] == "graph_slam") & (study.measures["metric"] == "max_m")
    found = by_name(replace(study, measures=study.measures.assign(x=study.measures["x"] + 37.0 * far)))
    panels = found["printed"].figure.axes
    reach = {label.get_text(): axes.get_xlim()[1] for axes in panels for label in axes.get_yticklabels()}
    assert reach["Fig. 7, largest, start as printed"] > 37
    assert reach["Fig. 7, mean"] < 15


def test_sweeps_mark_the_value_of_the_row_and_tell_edges(drawn):
    for name, usual in (("window", 10), ("farthest", 30), ("access_points", 70), ("fixed_threshold", None)):
        errors, edges = drawn[name].figure.axes
        values = SWEEPS[name][1]
        np.testing.assert_allclose(
            line(errors, "mean of the visits").get_ydata(), np.array(swept(name)) + 0.1
        )
        np.testing.assert_allclose(line(edges, "edges").get_ydata(), np.array(values), rtol=1e-3)
        marked = [item for item in errors.get_lines() if str(item.get_label()).startswith("row aligned")]
        assert [float(item.get_xdata()[0]) for item in marked] == ([] if usual is None else [usual])
    level = line(drawn["fixed_threshold"].figure.axes[0], "mean, adaptive threshold")
    assert level.get_ydata()[0] == pytest.approx(1.1)


def test_the_weight_is_marked_and_all_settings_are_counted(weights, drawn):
    (axes,) = drawn["weight"].figure.axes
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert line(axes, "rows aligned, aligned_linear: 0.001").get_xdata()[0] == 1e-3
    assert "8 weights are shown" in drawn["weight"].caption
    assert "on these worlds as well" not in drawn["weight"].caption
    more = replace(weights, sweeps={**WEIGHTS, "fixed_threshold": ("threshold", (3.0, 6.0))})
    told = by_name(more)["weight"].caption
    assert "2 values of fixed_threshold were tried on these worlds as well." in told
    np.testing.assert_allclose(line(axes, "squared").get_ydata(), [3.1, 1.1, 3.1])
    np.testing.assert_allclose(line(axes, "squared").get_xdata(), [1e-5, 1e-3, 1e-1], rtol=0.2)
    assert line(axes, "aligned, no graph").get_ydata()[0] == pytest.approx(4.1)
    assert "Ring: least of each cost, squared at 0.001, linear, eq. 5 at 0.001" in drawn["weight"].caption
    for row, words in (("aligned", "squared"), ("aligned_linear", "linear, eq. 5")):
        assert f"Row {row} has 0.001 (line), which is the best shown for {words}." in drawn["weight"].caption
    # The row with Cauchy's loss is not among these: nothing is said of its weight.
    assert "Row aligned_cauchy" not in drawn["weight"].caption
    # A weight that is not the best is told to be none.
    better = weights.measures.assign(
        x=np.where(weights.measures["value"] == 1e-5, 0.2, weights.measures["x"])
    )
    found = by_name(replace(weights, measures=better))["weight"]
    assert "squared at 1e-05" in found.caption
    assert "Row aligned has 0.001 (line), which is not the best" in found.caption
    # Without the row, nothing tells which weight the rows have.
    other = kept(weights, lambda m: m["algorithm"] != "aligned")
    assert "Row aligned has" not in by_name(other)["weight"].alt
    assert list(by_name(replace(weights, sweeps={}))) == []


def test_errors_of_inertial_walks_are_dots_a_visit(drawn):
    (axes,) = drawn["landmarks"].figure.axes
    rows = [t.get_text() for t in axes.get_yticklabels()]
    clouds = [item for item in axes.get_lines() if len(item.get_xydata()) > 2]
    assert len(clouds) == len(rows) == 5
    for cloud, row in zip(clouds, rows, strict=True):
        expected = np.sort(errors_of([LEVELS[row]], families=("worlds",))["error_m"])
        np.testing.assert_allclose(cloud.get_xdata(), expected)
    assert dots(axes, "D").tolist() == [[1.4, 2.0]]
    assert [axes.get_title(loc="left") for axes in drawn["walks"].figure.axes][
        1
    ] == "aligned first: mean 0.00 m"


def test_what_is_absent_is_left_out(study, chain):
    quick = kept(replace(study, sweeps={}), lambda m: ~m["algorithm"].isin(SWEEPS))
    assert list(by_name(quick)) == ALL[:10]
    blind = replace(study, estimate_files=())
    assert list(by_name(blind)) == [name for name in ALL if name not in ("fig4", "fig6")]
    bare = replace(study, observed={family: {} for family in ("walks", "lines")}, truth={})
    assert list(by_name(bare)) == [name for name in ALL if name not in WORLD]
    alone = kept(quick, lambda m: m["algorithm"] == "dead_reckoning")
    assert list(by_name(alone)) == [*WORLD, "fig8", "printed"]
    assert list(by_name(replace(chain, estimate_files=()))) == ["landmarks"]
    assert by_name(kept(chain, lambda m: m["metric"] == "none")) == {}
    assert by_name(kept(study, lambda m: m["metric"] == "none")) == {}


@pytest.mark.parametrize("family", ["walks", "lines"])
def test_one_family_is_enough(study, family):
    other = ({"walks", "lines"} - {family}).pop()
    sides = ({f: side[f] for f in side if f == family} for side in (study.observed, study.truth))
    single = kept(study, lambda m: m["family"] == family)
    found = by_name(replace(single, observed=next(sides), truth=next(sides)))
    others = [f"sweep_{sweep}" for sweep in SWEEPS]
    lines = ["fig1", "fig4", "printed", *others]
    assert list(found) == (lines if family == "lines" else [name for name in ALL if name != "fig4"])
    assert not any(f"family {other}" in item.caption for item in found.values())


@pytest.mark.filterwarnings("error")
def test_one_world_without_printed_numbers_is_enough(study, weights, chain):
    for results, expected in ((study, ALL), (weights, ["weight"]), (chain, ["walks", "landmarks"])):
        sides = (
            {family: {name: values[:1] for name, values in arrays.items()} for family, arrays in side.items()}
            for side in (results.observed, results.truth)
        )
        single = kept(results, lambda m: m["world"] == 0)
        found = by_name(replace(single, observed=next(sides), truth=next(sides), paper={}))
        assert list(found) == [name for name in expected if name != "printed"]
        for name, item in found.items():
            assert "single experiments" not in item.caption, name
            assert "rinted:" not in item.caption, name
            assert "nan" not in item.caption + item.alt, name
            with drawing():
                item.figure.draw_without_rendering()


def test_rows_of_the_studies_have_strokes_that_are_told_apart():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    for name in ("graph_slam", "graph_slam_weight", "graph_slam_imu"):
        rows = list(config[name]["algorithms"])
        assert all(row in KNOWN and contrast(KNOWN[row].color, "#ffffff") >= 3 for row in rows)
        for one, other in itertools.combinations(rows, 2):
            apart = difference(KNOWN[one].color, KNOWN[other].color)
            assert apart > (10 if KNOWN[one][1:] != KNOWN[other][1:] else 25), (one, other)
    variants = [row for row in config["graph_slam"]["algorithms"] if row.startswith("aligned")]
    assert len({KNOWN[row].marker for row in variants}) == 1
