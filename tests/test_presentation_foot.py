"""Figures of the studies foot_wlan and foot_real, from invented estimates whose numbers the test knows."""

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
from positioning.files import read_yaml, write_errors, write_tree
from positioning.presentation.studies.foot_wlan import Printed
from positioning.presentation.study_figures import draw
from positioning.presentation.style import KNOWN, contrast, difference, drawing, markers_apart

ROOT = Path(__file__).resolve().parents[1]
PAPER = read_yaml(ROOT / "data/papers/foot_wlan.yaml")
WORLDS, EPOCHS, LENGTH, READINGS, STANCES = 3, 50, 44, 6000, 30
ASKED = np.arange(3, LENGTH, 5)
ROWS = {"wlan": 3.0, "inertial": 4.0, "cascaded": 1.5, "joint": 2.0, "particle": 1.0, "cascaded_tuned": 1.2}
ROWS |= {"inertial_shoe": 2.5, "inertial_15": 5.0, "inertial_no_zupt": 9000.0, "control_centre": 16.0}
HEADING_DEG = {"cascaded": 6.0, "inertial": 10.0}
STEPS = {"inertial": 1.1, "inertial_15": 1.1, "inertial_shoe": 1.0, "inertial_no_zupt": 1.1}
SWEEPS = {
    "sigma_wlan": ("sigma_wlan_m", (1.0, 3.0, 8.0)),
    "sigma_step": ("sigma_step_m", (0.05, 0.1)),
    "start_heading": ("start_heading_error_rad", (0.0, 0.5)),
    "points_every": ("fingerprinting.every", (1.0, 2.0)),
    "points_every_wlan": ("fingerprinting.every", (1.0, 2.0)),
}
LEVELS = {
    "sigma_wlan": (1.9, 1.5, 1.2),
    "sigma_step": (1.7, 1.5),
    "start_heading": (1.5, 1.8),
    "points_every": (1.5, 1.6),
    "points_every_wlan": (3.0, 3.3),
}
WALK = ["fig4", "fig5", "fig6", "fig7a"]
ALL = [*WALK, "fig7b", "means", "shares", "marks", "density", "weights", "start_heading"]
ALL += ["inertial", "detectors", "strides", "heading", "cascade"]
SPACING_M = 2.5


def world():
    """A walk along a line, a survey of places with three scans each, and readings of a foot."""
    time_s = np.arange(EPOCHS, dtype=float)
    ended = np.where(time_s < LENGTH, 0.0, np.nan)
    path_m = np.stack([2 + time_s * 0.5, np.full(EPOCHS, 5.0)], axis=-1) + ended[:, None]
    position_m, on_point_m = np.full((2, EPOCHS, 2), np.nan)
    position_m[ASKED] = path_m[ASKED]
    on_point_m[ASKED + 1] = path_m[ASKED + 1]
    point_m = np.stack([np.arange(8) * SPACING_M, np.full(8, 5.0)], axis=-1)
    rss_dbm = np.repeat(np.arange(8.0)[:, None] - [90.0, 50.0, 60.0, 70.0], 3, axis=0)
    rss_dbm[0] += 1
    rss_dbm[1, 3] = np.nan
    begin_s = np.arange(STANCES) * 1.1 + 1
    imu_s = (np.arange(READINGS) + 1) / 100
    force = np.zeros((READINGS, 3))
    force[:, 2] = 9.8 + np.where(imu_s > 22, 4.0, 0.0)
    observed = {
        "site.corner_m": [[0.0, 0.0], [30.0, 10.0]],
        "site.wall_m": [[[0.0, 4.0], [30.0, 4.0]], [[np.nan, np.nan], [np.nan, np.nan]]],
        "survey.rss_dbm": rss_dbm,
        "survey.position_m": np.repeat(point_m, 3, axis=0),
        "recording.time_s": time_s + ended,
        "recording.imu_time_s": np.where(imu_s < LENGTH, imu_s, np.nan),
        "recording.specific_force_m_per_s2": force,
    }
    truth = {
        "truth.position_m": position_m,
        "truth.on_point_m": on_point_m,
        "truth.path_m": path_m,
        "truth.heading_rad": np.zeros(EPOCHS) + ended,
        "truth.stance_time_s": np.stack([begin_s, begin_s + 0.4], axis=-1),
        "plan.access_point_m": [[1.0, 1.0], [9.0, 9.0]],
        "plan.mark_m": [[3.5, 5.0], [6.0, 5.0], [8.5, 5.0]],
    }
    index = {"world": np.arange(WORLDS), "seed": np.arange(WORLDS)}
    return [
        index
        | {name: np.repeat(np.asarray(v, dtype=float)[None], WORLDS, axis=0) for name, v in side.items()}
        for side in (observed, truth)
    ]


def estimate_of(row, truth):
    """The true path, moved to the left by a distance of the row, which grows by 0.1 m a world."""
    off_m = ROWS[row] + 0.1 * np.arange(WORLDS)
    step = {"world": np.arange(WORLDS), "value": np.array(np.nan), "seconds": np.ones(WORLDS), "skipped": ""}
    step["estimate.position_m"] = truth["truth.path_m"] + off_m[:, None, None] * [0.6, 0.8]
    if row in HEADING_DEG:
        # Two turns more are the same heading.
        heading_rad = -np.radians(HEADING_DEG[row]) + 4 * np.pi
        step["estimate.extra_heading_rad"] = truth["truth.heading_rad"] + heading_rad
    if row in STEPS:
        times = truth["truth.stance_time_s"][..., 0] + (0.2 if STEPS[row] > 1 else 0.0)
        step["estimate.extra_step_time_s"] = np.concatenate([times, np.full((WORLDS, 4), np.nan)], axis=1)
    return {"ring/0": {name: np.asarray(value) for name, value in step.items()}}


def errors_of(levels, values=(np.nan,)):
    """Half of the errors half a metre below the level, half above; 0.1 m more a world."""
    parts = []
    for level, value in zip(levels, values, strict=True):
        for number in range(WORLDS):
            error_m = level + 0.1 * number + 0.5 * np.where(np.arange(len(ASKED) - 1) % 2, 1, -1)
            columns = {"family": "ring", "value": value, "world": number, "sample": ASKED[:-1]}
            parts.append(pd.DataFrame({**columns, "error_m": error_m}))
    return pd.concat(parts, ignore_index=True)


def own_measures():
    own = {(row, "on_points_m"): ROWS[row] - 0.2 for row in ("wlan", "cascaded")}
    own |= {(row, "heading_deg"): value for row, value in HEADING_DEG.items()}
    own |= {(row, "steps_per_stride"): value for row, value in STEPS.items()}
    own |= {("wlan", "within_05m"): 0.1, ("wlan", "over_4m"): 0.14}
    own |= {("cascaded", "over_4m"): 0.04, ("cascaded", "about_1m"): 0.48}
    # The shares of the worlds differ by a point.
    return pd.DataFrame(
        [
            ("ring", row, np.nan, number, metric, value + 0.01 * number * (metric != "heading_deg"))
            for (row, metric), value in own.items()
            for number in range(WORLDS)
        ],
        columns=MEASURES,
    )


def write(folder, kind, row, frame_or_tree):
    path = folder / kind / row / ("00000.parquet" if kind == "errors" else "00000.npz")
    path.parent.mkdir(parents=True)
    if kind == "errors":
        columns = {name: frame_or_tree[name].to_numpy() for name in frame_or_tree}
        family = frame_or_tree["family"].to_numpy(dtype=np.str_)
        write_errors(path, {**columns, "family": family}, {})
    else:
        write_tree(path, frame_or_tree)
    return str(path)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foot")
    observed, truth = world()
    frames = {row: errors_of([level]) for row, level in ROWS.items()}
    frames |= {name: errors_of(LEVELS[name], values) for name, (_, values) in SWEEPS.items()}
    return StudyResults(
        study="foot_wlan",
        rows=tuple(ROWS),
        sweeps=SWEEPS,
        measures=pd.concat(
            [*(measure(f, row) for row, f in frames.items()), own_measures()], ignore_index=True
        ),
        error_files=tuple(write(folder, "errors", row, frame) for row, frame in frames.items()),
        observed={"ring": observed},
        truth={"ring": truth},
        paper=PAPER,
        estimate_files=tuple(write(folder, "estimates", row, estimate_of(row, truth)) for row in ROWS),
    )


@pytest.fixture(scope="module")
def drawn(study):
    return {item.name: item for item in draw(study)}


def names(results):
    return [item.name for item in draw(results)]


def kept(results, condition):
    return replace(results, measures=results.measures[condition(results.measures)])


def line(axes, label):
    return next(item for item in axes.get_lines() if item.get_label() == label)


def dots(axes, marker):
    found = [item for item in axes.get_lines() if item.get_marker() == marker]
    return np.array([item.get_xydata()[0] for item in found if len(item.get_xydata()) == 1])


def texts(axes):
    return [text.get_text() for text in axes.texts]


def row_labels(axes):
    return [label.get_text() for label in axes.get_yticklabels()]


def test_all_figures_are_there_in_order_and_are_drawn_without_warning(drawn):
    assert list(drawn) == ALL
    for item in drawn.values():
        with drawing():
            item.figure.draw_without_rendering()


def test_captions_tell_samples_and_worlds_and_numbers_need_no_eyes(drawn):
    for item in drawn.values():
        assert "n = " in item.caption, item.name
        assert "world" in item.caption, item.name
        assert "assumed" in item.caption or "calibrated" in item.caption, item.name
        assert re.search(r"\d", item.alt), item.name
        assert not re.search(r"\bnan\b|None", item.caption + item.alt), item.name


def test_axes_have_units(drawn):
    for name, item in drawn.items():
        labels = [axes.get_xlabel() + axes.get_ylabel() for axes in item.figure.axes]
        text = "".join([*labels, item.figure.get_supxlabel(), item.figure.get_supylabel()])
        assert re.search(r"\((m|s|dBm|m/s²|degrees|%|1)\)", text), name


def test_plan_shows_each_calibration_point_once(drawn):
    (axes,) = drawn["fig4"].figure.axes
    np.testing.assert_allclose(line(axes, "calibration points").get_xdata(), np.arange(8) * SPACING_M)
    assert len(line(axes, "access points").get_xydata()) == 2
    assert "n = 2 access points, 3 marks and 8 calibration points" in drawn["fig4"].caption


def test_histograms_are_of_the_strongest_at_the_first_point(drawn):
    panels = drawn["fig5"].figure.axes
    titles = [axes.get_title(loc="left") for axes in panels]
    assert titles == [f"access point {n}: heard in {k} of 3 scans" for n, k in ((2, 3), (3, 3), (4, 2))]
    bars = {round(b.get_x() + b.get_width() / 2): b.get_height() for b in panels[2].patches}
    assert bars == {-70: 1, -69: 1}


def test_track_and_errors_are_those_of_the_first_world(drawn):
    (axes,) = drawn["fig6"].figure.axes
    way_m, track_m = (line(axes, label).get_xydata() for label in ("true way", "track of cascaded"))
    assert len(way_m) == LENGTH
    np.testing.assert_allclose(track_m - way_m, np.broadcast_to([0.9, 1.2], way_m.shape))
    (axes,) = drawn["fig7a"].figure.axes
    wlan, fused = line(axes, "WLAN"), line(axes, "fused")
    assert (wlan.get_linestyle(), fused.get_linestyle()) == ("--", "-")
    np.testing.assert_allclose(wlan.get_xdata(), ASKED)
    np.testing.assert_allclose(wlan.get_ydata(), 3.0)
    np.testing.assert_allclose(fused.get_ydata(), 1.5)


def test_cumulative_error_has_median_band_and_printed_numbers(drawn):
    (axes,) = drawn["fig7b"].figure.axes
    x_m, share = line(axes, "fused").get_data()
    # Worlds have half of their errors at 1.0, 1.1 and 1.2 m, the others one metre above.
    np.testing.assert_allclose(share[(x_m > 1.1) & (x_m < 2.1)], 50)
    assert share[x_m < 1.1].max() == 0
    low, high = (next(c for c in axes.collections)).get_paths()[0].vertices[:, 1][[0, -1]]
    assert (low, high) == (0, 0)
    np.testing.assert_allclose(dots(axes, "D"), [[4.0, 80.0]])
    np.testing.assert_allclose(dots(axes, "^"), [[0.5, 20.0], [4.0, 95.0]])
    np.testing.assert_allclose(dots(axes, "d"), [[3.1777, 0], [1.6468, 0]])


def test_means_tell_what_lies_off_the_scale(drawn):
    (axes,) = drawn["means"].figure.axes
    assert row_labels(axes) == list(ROWS)
    np.testing.assert_allclose(dots(axes, "o")[:, 0], [level + 0.1 for level in ROWS.values()])
    np.testing.assert_allclose(dots(axes, "D"), [[3.1777, 0], [1.6468, 2]])
    assert axes.get_xlim()[0] == 0
    assert axes.get_xlim()[1] < 20
    assert "9000.10 m \N{RIGHTWARDS ARROW}" in texts(axes)


def test_shares_say_in_how_many_worlds_a_fact_is_met(drawn):
    (axes,) = drawn["shares"].figure.axes
    # 10, 11, 12 % never above 20 %; 14 % is not within 5 points of 20 %; 4 and 5 % are at most 5 %.
    assert texts(axes) == [f"met in {count} of 3" for count in (0, 2, 2, 1)]
    clouds = [item.get_xdata() for item in axes.get_lines() if len(item.get_xdata()) == WORLDS]
    np.testing.assert_allclose(clouds[0], [10, 11, 12])


@pytest.mark.parametrize(
    ("kind", "met"), [("at_least", [0, 1, 1]), ("at_most", [1, 1, 0]), ("printed", [0, 1, 0])]
)
def test_printed_shares_hold_on_their_side(kind, met):
    assert Printed(0.2, kind).met(np.array([0.1, 0.2, 0.3])).tolist() == met


def test_marks_stand_beside_calibration_points(drawn):
    (axes,) = drawn["marks"].figure.axes
    np.testing.assert_allclose(dots(axes, "o")[:, 0], [3.1, 1.6])
    np.testing.assert_allclose(dots(axes, "s")[:, 0], [2.81, 1.31])
    assert f"({len(ASKED) - 1} of them)" in drawn["marks"].caption
    assert "difference \N{MINUS SIGN}0.29 m" in drawn["marks"].caption


def test_density_is_in_metres(drawn):
    (axes,) = drawn["density"].figure.axes
    assert axes.get_xlabel() == "distance of calibration points (m)"
    for label, levels in (("fused", (1.6, 1.7)), ("WLAN", (3.1, 3.4))):
        np.testing.assert_allclose(line(axes, label).get_xdata(), [2.5, 5.0], rtol=0.03)
        np.testing.assert_allclose(line(axes, label).get_ydata(), levels)
    np.testing.assert_allclose(sorted(dots(axes, "D")[:, 1]), [1.6468, 3.1777])


def test_weights_mark_the_values_that_rows_have(study, drawn):
    first, second = drawn["weights"].figure.axes

    def marked(axes):
        lines = [item for item in axes.get_lines() if len(item.get_xdata()) == 2]
        return {
            item.get_linestyle(): item.get_xdata()[0] for item in lines if set(item.get_ydata()) == {0, 1}
        }

    assert marked(first) == {"--": 3.0, ":": 8.0}
    assert marked(second) == {"--": 0.1}
    without = kept(study, lambda m: m["algorithm"] != "cascaded_tuned")
    found = {item.name: item for item in draw(without)}
    assert marked(found["weights"].figure.axes[0]) == {"--": 3.0}


def test_start_heading_is_in_degrees(drawn):
    (axes,) = drawn["start_heading"].figure.axes
    np.testing.assert_allclose(line(axes, "fused").get_xdata(), np.degrees([0, 0.5]))
    np.testing.assert_allclose(line(axes, "fused").get_ydata(), [1.6, 1.9])


def test_drift_is_the_median_over_worlds_and_leaves_out_what_is_far_off(drawn):
    panels = [axes for axes in drawn["inertial"].figure.axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in panels] == ["inertial", "inertial_shoe", "inertial_15"]
    np.testing.assert_allclose(panels[1].get_lines()[-1].get_ydata(), 2.6)
    np.testing.assert_allclose(panels[1].get_lines()[0].get_ydata(), 4.1)
    edges_m = panels[1].collections[0].get_paths()[0].vertices[:, 1]
    np.testing.assert_allclose([edges_m.min(), edges_m.max()], [2.5, 2.7])
    assert panels[1].get_lines()[-1].get_xdata()[-1] == LENGTH - 2
    assert "Far off the scale and not drawn: inertial_no_zupt (9" in drawn["inertial"].caption


def test_heading_errors_know_full_turns(drawn):
    panels = [axes for axes in drawn["heading"].figure.axes if axes.get_visible()]
    for axes, (row, value) in zip(panels, HEADING_DEG.items(), strict=True):
        assert axes.get_title(loc="left") == row
        np.testing.assert_allclose(axes.get_lines()[-1].get_ydata(), value, rtol=1e-9)


def test_rows_with_one_detector_stand_once(drawn):
    (axes,) = drawn["detectors"].figure.axes
    assert row_labels(axes) == ["inertial", "inertial_shoe"]
    assert "inertial_15, inertial_no_zupt as inertial" in drawn["detectors"].caption
    assert f"n = {STANCES - 1} strides" in drawn["detectors"].caption


def test_strides_shade_true_stances_and_tick_steps(study, drawn):
    force, ticks = drawn["strides"].figure.axes
    stance_s = study.truth["ring"]["truth.stance_time_s"][0, 20:25]
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in force.patches]
    np.testing.assert_allclose(spans, stance_s)
    assert row_labels(ticks) == ["inertial", "inertial_shoe"]
    found = [item.get_xdata() for item in ticks.get_lines()]
    np.testing.assert_allclose(found, [stance_s[:, 0] + 0.2, stance_s[:, 0]])
    np.testing.assert_allclose(line(force, "specific force").get_ydata()[-1], 13.8)


def test_differences_are_those_of_rows_that_fuse(drawn):
    (axes,) = drawn["cascade"].figure.axes
    assert row_labels(axes) == ["joint", "particle", "cascaded_tuned"]
    np.testing.assert_allclose(dots(axes, "o")[:, 0], [0.5, -0.5, -0.3])


def test_what_was_left_out_has_no_figure(study):
    quick = kept(replace(study, sweeps={}), lambda m: ~m["algorithm"].isin(SWEEPS))
    assert names(quick) == [n for n in ALL if n not in ("density", "weights", "start_heading")]
    gone = {"fig6", "fig7a", "inertial", "heading"}
    assert names(replace(study, estimate_files=())) == [n for n in ALL if n not in gone]
    bare = replace(study, observed={"ring": {}}, truth={})
    assert names(bare) == [n for n in ALL if n not in {*WALK, "inertial", "strides", "heading"}]
    for row, there in (
        ("wlan", ["fig4", "fig5", "fig7a", "fig7b", "means", "shares", "marks", "strides"]),
        ("particle", ["fig4", "fig5", "means", "strides"]),
        ("inertial", ["fig4", "fig5", "means", "inertial", "detectors", "strides", "heading"]),
    ):
        files = tuple(path for path in study.estimate_files if Path(path).parent.name == row)
        alone = kept(
            replace(study, rows=(row,), sweeps={}, estimate_files=files),
            lambda m, row=row: m["algorithm"] == row,
        )
        assert names(alone) == there


@pytest.mark.filterwarnings("error")
def test_one_world_without_printed_numbers_is_enough(study):
    single = kept(study, lambda m: m["world"] == 0)
    files = tuple(p for p in study.error_files)
    found = {item.name: item for item in draw(replace(single, paper={}, error_files=files))}
    assert list(found) == [n for n in ALL if n != "shares"]
    for item in found.values():
        assert not re.search(r"\bnan\b", item.caption + item.alt), item.name
        with drawing():
            item.figure.draw_without_rendering()
    assert not len(dots(found["means"].figure.axes[0], "D"))


RECORDINGS = ("mocap_a", "mocap_b", "mocap_c", "corridor_1", "corridor_2", "loop", "library_1", "library_2")
SPEED = {"mocap_a": 1.0, "mocap_b": 2.0, "mocap_c": 1.2, "corridor_1": 1.0, "corridor_2": 1.5}
REAL = {"inertial": 0.5, "inertial_shoe": 0.1, "wlan": 4.0, "control_centre": 2.0}


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    folder = tmp_path_factory.mktemp("real")
    observed, truth, trees, lines = {}, {}, {row: {} for row in REAL}, []
    index = {"world": np.zeros(1, dtype=int), "seed": np.zeros(1, dtype=int)}
    for name in RECORDINGS:
        foot = not name.startswith("library")
        count = 2 if name == "loop" else 12
        time_s = np.arange(count, dtype=float)
        path_m = np.stack([time_s * SPEED.get(name, 0.0), np.zeros(count)], axis=-1)
        observed[name] = index | {
            "recording.time_s": time_s[None],
            "recording.start_heading_rad": np.zeros(1),
        }
        truth[name] = index | {"truth.position_m": path_m[None], "truth.path_m": path_m[None]}
        if name.startswith(("mocap", "corridor")):
            truth[name]["truth.stance_time_s"] = np.zeros((1, 3, 2))
        for row, level in REAL.items():
            if row != "control_centre" and foot != row.startswith("inertial"):
                continue
            mean_m = 0.0 if (row, name) == ("control_centre", "loop") else level
            lines += [(name, row, np.nan, 0, "mean_m", mean_m), (name, row, np.nan, 0, "n", float(count))]
            if name != "loop":
                lines.append((name, row, np.nan, 0, "rigid_mean_m", level / 2))
            step = {"world": np.zeros(1, dtype=int), "value": np.array(np.nan), "seconds": np.ones(1)}
            step |= {"skipped": np.array(""), "estimate.position_m": path_m[None] + [0.0, level]}
            # A square: forward one metre and a quarter turn, four times.
            step |= {"estimate.extra_step_forward_m": np.array([[1.0, 1.0, 1.0, 1.0, np.nan]])}
            step |= {"estimate.extra_step_left_m": np.zeros((1, 5))}
            made = 1 if (row, name) == ("inertial_shoe", "mocap_b") else 4
            step |= {"estimate.extra_step_time_s": np.where(np.arange(5) < made, 1.0, np.nan)[None]}
            step |= {"estimate.extra_step_turn_rad": np.full((1, 5), np.pi / 2)}
            trees[row][f"{name}/0"] = step
    # The last recording stands in another batch, whose arrays are not at hand.
    del observed["library_2"], truth["library_2"]
    return StudyResults(
        study="foot_real",
        rows=tuple(REAL),
        sweeps={},
        measures=pd.DataFrame(lines, columns=MEASURES),
        error_files=(),
        observed=observed,
        truth=truth,
        paper=PAPER,
        estimate_files=tuple(write(folder, "estimates", row, tree) for row, tree in trees.items()),
    )


def test_no_recording_is_left_out(real):
    found = {item.name: item for item in draw(real)}
    assert list(found) == ["errors", "tracks", "fingerprints"]
    assert row_labels(found["errors"].figure.axes[0]) == list(RECORDINGS[:6])
    assert row_labels(found["fingerprints"].figure.axes[0]) == ["library_1", "library_2"]
    first, second = found["errors"].figure.axes
    assert first.get_xscale() == "log"
    np.testing.assert_allclose(line(first, "inertial").get_xdata(), 0.5)
    assert len(line(first, "inertial").get_xdata()) == 6
    assert len(line(second, "inertial").get_xdata()) == 5
    assert 0 < line(first, "control_centre").get_xdata()[5] < 0.05
    markers = [dots.get_marker() for dots in first.get_lines() if dots.get_label() in ROWS]
    assert len(set(markers)) == len(markers) > 2
    assert "for it is zero: control_centre in loop" in found["errors"].caption
    # Twelve stances are eleven strides; the loop has none that are known.
    assert "inertial 0.36 (0.36 to 0.36, 5 recordings)" in found["errors"].caption
    assert "almost none: inertial_shoe in mocap_b (1 of 11)." in found["errors"].caption
    for item in found.values():
        assert "n = " in item.caption
        assert re.search(r"\d", item.alt)
        with drawing():
            item.figure.draw_without_rendering()


def test_tracks_are_chosen_by_the_truth_alone(real):
    tracks = next(item for item in draw(real) if item.name == "tracks")
    panels = tracks.figure.axes
    chosen = [axes.get_title(loc="left").split("\n")[0] for axes in panels]
    assert chosen == ["mocap_c", "mocap_b", "corridor_2", "loop"]
    np.testing.assert_allclose(line(panels[1], "inertial").get_ydata(), 0.5)
    assert "inertial_shoe 0.10 m (steps found 1, true strides 11)" in tracks.caption
    square_m = line(panels[3], "inertial").get_xydata() - [0.0, 0.5]
    np.testing.assert_allclose(square_m[:5], [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], atol=1e-12)


def test_recordings_without_feet_or_without_scans_are_enough(real):
    scans = kept(real, lambda m: m["family"].str.startswith("library"))
    assert names(scans) == ["fingerprints"]
    feet = kept(real, lambda m: m["family"] == "mocap_a")
    assert names(feet) == ["errors", "tracks"]
    assert names(replace(real, estimate_files=())) == ["errors", "fingerprints"]


def test_dots_have_markers_of_their_own_as_far_as_there_are_any():
    assert markers_apart(["wlan", "wlan_latest", "control_centre"]) == {
        "wlan": "s",
        "wlan_latest": "o",
        "control_centre": "+",
    }
    many = markers_apart([f"row_{place}" for place in range(12)])
    assert len(many) == 12
    assert len(set(many.values())) == 9


def test_rows_of_the_studies_have_strokes_that_are_told_apart():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    for name in ("foot_wlan", "foot_real"):
        rows = list(config[name]["algorithms"])
        assert all(row in KNOWN and contrast(KNOWN[row].color, "#ffffff") >= 3 for row in rows)
        for first, second in itertools.combinations(rows, 2):
            apart = difference(KNOWN[first].color, KNOWN[second].color)
            assert apart > (15 if KNOWN[first][1:] != KNOWN[second][1:] else 25), (first, second)
    for kind in ("wlan", "inertial", "cascaded", "joint"):
        own = {KNOWN[row].marker for row in config["foot_wlan"]["algorithms"] if row.startswith(kind)}
        assert len(own) == 1
