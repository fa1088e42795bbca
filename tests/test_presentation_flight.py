"""Figures of the studies sar_flight and flight_real, from invented estimates whose numbers the test knows."""

import itertools
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT
from scipy import stats

from positioning.evaluation.measures import MEASURES
from positioning.evaluation.results import StudyResults
from positioning.evaluation.studies.sar_flight import LIMIT_M, SETTLED_S, measures
from positioning.files import read_tree, read_yaml, write_tree
from positioning.inertial.geodetic import to_geodetic
from positioning.presentation.studies.flight_real import TRACKS
from positioning.presentation.studies.sar_flight import LENGTHS, NOISE_ROWS, _apart
from positioning.presentation.studies.sar_flight_world import three_digits
from positioning.presentation.study_figures import draw
from positioning.presentation.style import KNOWN, contrast, difference, drawing

PAPER = read_yaml(ROOT / "data/papers/robo_sar.yaml")
CONFIG = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
SPREAD = (1.0, 1.1, 1.3)
"""Factor on errors by world; median and mean differ."""
WORLDS, RATE_HZ, LASTS_S, MARKS = 3, 2.0, 90.0, 4
BEGIN_S, END_S = 40.0, 70.0
TIME_S = np.arange(RATE_HZ * LASTS_S) / RATE_HZ
GROWTH = {"gps_inertial": 1.0, "slam": 0.05, "slam_new_ground": 0.2, "wlpf": 0.1, "slam_wlpf": 0.03}
GROWTH |= {f"{row}_15": growth / 4 for row, growth in GROWTH.items()}
GROWTH |= {"slam_weak_15": 0.1, "slam_wlpf_weak_15": 0.06}
GROWTH |= {"slam_flat": 0.055, "gps_inertial_flat": 1.02, "gps_inertial_radians": 1.0}
GROWTH |= {"gps_inertial_lagrange": 1.00002, "control_centre": 40.0}
"""How fast the error grows in the outage, m/s, in white worlds; 1 m before it."""
FAMILIES = {"white": 1.0, "place": 2.0, "weak": 1.0, "ideal": 0.1}
"""Factor on this."""
SWEEPS = {
    **{
        f"outage_{name}": ("outage_s", (10.0, 20.0, 30.0)) for name in ("gps", "gps_15", "slam_15", "wlpf_15")
    },
    "noise_gps": ("noise_factor", (0.01, 1.0, 100.0)),
}
ALL = ["block", "outage", "outage_place", "table", "below_limit", "consistency", "outage_length", "noise"]
ALL += ["weak", "variants", "height"]
LAG_S = {0.01: 0.1, 1.0: -0.01, 100.0: -0.2}
"""In the first world."""
LANDMARK_M = np.array([[0.0, 20, 3], [40, 20, 5], [40, -20, 7], [-1000, -1000, 0]])


def off_m(row, family):
    """Horizontal error over time, [w, n]: one metre under GPS, growing in the outage, and by world."""
    away = np.clip(TIME_S - BEGIN_S, 0, END_S - BEGIN_S) * (TIME_S <= END_S)
    return (1 + GROWTH[row] * FAMILIES[family] * away) * np.array(SPREAD)[:, None]


def runs(row, family):
    config = CONFIG["sar_flight"]["algorithms"][row]
    return family in config.get("families", FAMILIES)


def world(family):
    path_m = np.stack([TIME_S, 30 + 0.5 * TIME_S], axis=-1)
    index = {"world": np.arange(WORLDS), "seed": np.arange(WORLDS)}
    observed = {
        "site.wall_m": [[[0.0, 20], [50, 20]], [[50, 20], [50, -20]]],
        "recording.time_s": TIME_S,
        "recording.gps_outage_s": [BEGIN_S, END_S],
    }
    truth = {
        "truth.position_m": path_m,
        "truth.path_m": path_m,
        "truth.height_m": np.full(TIME_S.shape, 9.0),
        "truth.velocity_m_per_s": np.zeros((*TIME_S.shape, 3)),
        "truth.attitude_rad": np.zeros((*TIME_S.shape, 3)),
        "truth.landmark_m": LANDMARK_M,
    }
    return [
        index
        | {name: np.repeat(np.asarray(v, dtype=float)[None], WORLDS, axis=0) for name, v in side.items()}
        for side in (observed, truth)
    ]


def step_of(row, family, truth):
    if not runs(row, family):
        return {"world": np.arange(WORLDS), "value": np.array(np.nan), "skipped": np.array("not here")}
    error_m = off_m(row, family)
    shape = error_m.shape
    position_m = truth["truth.position_m"] + error_m[..., None] * [0.6, 0.8]
    step = {
        "world": np.arange(WORLDS),
        "value": np.array(np.nan),
        "skipped": np.array(""),
        "estimate.position_m": position_m,
    }
    if row == "control_centre":
        return step
    extra = {
        "height_m": truth["truth.height_m"] - 2.5 * error_m,
        "velocity_m_per_s": np.zeros((*shape, 3)),
        "attitude_rad": np.zeros((*shape, 3)),
        "covariance_9": np.broadcast_to(np.diag([1.0, 1, 1e6] + [1.0] * 6), (*shape, 9, 9)).copy(),
        "nis_gps": np.full(WORLDS, 1.5),
        "innovation_condition": np.full(WORLDS, 1e14 if row.endswith("radians") else 1e4),
    }
    if "slam" in row:
        extra["nis_sighting"] = np.full(WORLDS, 0.9)
        # The last landmark was never seen; the first is off by more than its covariance says.
        place_m = LANDMARK_M + np.array([[5.0, 0, 0], [0.3, 0, 0], [0, -0.3, 0], [np.nan] * 3])
        covariance_m2 = np.broadcast_to(np.diag([1.0, 0.25, 0.04]), (MARKS, 3, 3)).copy()
        extra["landmark_m"] = np.repeat(place_m[None], WORLDS, axis=0)
        extra["landmark_covariance_m2"] = np.repeat(covariance_m2[None], WORLDS, axis=0)
    if "wlpf" in row:
        extra["nis_fix"] = np.full(WORLDS, 1.1)
    return step | {f"estimate.extra_{name}": values for name, values in extra.items()}


def swept():
    """Measures of the sweeps: errors that grow with the outage, and fall with the noise."""
    lines = []
    for sweep, (setting, values) in SWEEPS.items():
        for value, number in itertools.product(values, range(WORLDS)):
            level = value / 10 if setting == "outage_s" else 3 - np.log10(value)
            for metric, factor in (("outage_mean_m", 1.0), ("outage_max_m", 2.0), ("gps_mean_m", 0.5)):
                lines.append(("white", sweep, value, number, metric, factor * level * (1 + 0.1 * number)))
            if sweep == "noise_gps":
                lines.append(("white", sweep, value, number, "gps_nees", 10 / value))
                lines.append(("white", sweep, value, number, "gps_lag_s", LAG_S[value] + 0.01 * number))
    return pd.DataFrame(lines, columns=MEASURES)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flight")
    sides = {family: world(family) for family in FAMILIES}
    paths = []
    for row in GROWTH:
        path = folder / "estimates" / row / "00000.npz"
        path.parent.mkdir(parents=True)
        write_tree(path, {f"{family}/0": step_of(row, family, side[1]) for family, side in sides.items()})
        paths.append(str(path))
    observed, truth = ({family: side[k] for family, side in sides.items()} for k in (0, 1))
    found = measures(
        {path: read_tree(path) for path in paths},
        {"d/00000/observed.npz": observed, "d/00000/truth.npz": truth},
    )
    counted = [
        (family, row, np.nan, number, "n", float(len(TIME_S)))
        for family in FAMILIES
        for row in GROWTH
        for number in range(WORLDS)
        if runs(row, family)
    ]
    return StudyResults(
        study="sar_flight",
        rows=tuple(GROWTH),
        sweeps=SWEEPS,
        measures=pd.concat([found, swept(), pd.DataFrame(counted, columns=MEASURES)], ignore_index=True),
        error_files=(),
        observed=observed,
        truth=truth,
        paper=PAPER,
        estimate_files=tuple(paths),
    )


@pytest.fixture(scope="module")
def drawn(study):
    return {item.name: item for item in draw(study)}


def names(results):
    return [item.name for item in draw(results)]


def kept(results, condition):
    return replace(results, measures=results.measures[condition(results.measures)])


def without(results, *rows):
    return replace(
        kept(results, lambda m: ~m["algorithm"].isin(rows)),
        rows=tuple(row for row in results.rows if row not in rows),
        sweeps={name: over for name, over in results.sweeps.items() if name not in rows},
    )


def lines_of(axes, row):
    """Curves in the colour of a row, of which two values are known at least."""
    return [
        item
        for item in axes.get_lines()
        if item.get_color() == KNOWN[row].color and len(item.get_xydata()) > 3
    ]


def dots(axes, marker):
    return np.array(
        [
            item.get_xydata()[0]
            for item in axes.get_lines()
            if item.get_marker() == marker and len(item.get_xydata()) == 1
        ]
    )


def legend_of(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_all_figures_are_there_in_order_and_are_drawn_without_warning(drawn):
    assert list(drawn) == ALL
    for item in drawn.values():
        with drawing(GROWTH):
            item.figure.draw_without_rendering()


def test_captions_tell_worlds_and_assumptions_and_that_the_paper_prints_nothing(drawn):
    for item in drawn.values():
        assert "n = " in item.caption, item.name
        assert "world" in item.caption, item.name
        assert "prints no result of a flight" in item.caption, item.name
        assert re.search(r"\d", item.alt), item.name
        assert "nan" not in item.caption + item.alt, item.name
    # Once on the page, where a reader begins.
    assert ["Course, sensors and noises are assumed" in item.caption for item in drawn.values()] == [
        name == ALL[0] for name in ALL
    ]


def test_axes_have_units(drawn):
    for name, item in drawn.items():
        panels = [*item.figure.axes, *(axes for part in item.figure.subfigs for axes in part.axes)]
        labels = "".join(axes.get_xlabel() + axes.get_ylabel() for axes in panels)
        assert re.search(r"\((m|s|%|1)\)", labels), name


def test_the_map_is_that_of_the_first_world_with_ellipses_of_95_percent(drawn):
    item = drawn["block"]
    plan, nine, fifteen = item.figure.axes
    ellipses = plan.patches
    assert len(ellipses) == 3
    # 5.991 is the 95 % point of chi-square with two degrees of freedom.
    for ellipse in ellipses:
        np.testing.assert_allclose(
            sorted([ellipse.width, ellipse.height]), 2 * np.sqrt(5.991464547 * np.array([0.25, 1.0]))
        )
        across = np.degrees(np.arctan2(1, 0)) if ellipse.height > ellipse.width else 0.0
        assert (ellipse.angle + across) % 180 == pytest.approx(0, abs=1e-9)
    centres = np.array([ellipse.get_center() for ellipse in ellipses])
    np.testing.assert_allclose(centres, [[5, 20], [40.3, 20], [40, -20.3]])
    assert nine.get_title(loc="left") == "slam: 2 of 3"
    assert fifteen.get_title(loc="left") == "slam_15: 2 of 3"
    assert "slam 67 % of 9 (3 worlds), slam_15 67 % of 9 (3 worlds)" in item.caption
    assert "correlated over 100 s" in item.caption
    assert "in 2 of 3 cases" in item.alt
    stretch = next(line for line in plan.get_lines() if line.get_label() == "outage of GPS")
    assert stretch.get_xdata().min() == BEGIN_S + 1 / RATE_HZ
    assert stretch.get_xdata().max() == END_S


def test_errors_through_the_outage_are_medians_over_worlds(drawn):
    for panel, suffix in zip(drawn["outage"].figure.axes, ("", "_15"), strict=True):
        assert panel.get_yscale() == "log"
        for row in ("gps_inertial", "slam", "slam_new_ground", "wlpf", "slam_wlpf"):
            curve, upper = lines_of(panel, row + suffix)
            inside = (TIME_S >= BEGIN_S - 10) & (TIME_S <= END_S + 10)
            np.testing.assert_allclose(curve.get_xdata(), TIME_S[inside] - BEGIN_S)
            np.testing.assert_allclose(curve.get_ydata(), off_m(row + suffix, "white")[1, inside])
            # Of three worlds the upper end is the largest.
            np.testing.assert_allclose(upper.get_ydata(), off_m(row + suffix, "white")[:, inside].max(axis=0))
            assert upper.get_linewidth() < curve.get_linewidth()
        limits = [line for line in panel.get_lines() if set(line.get_ydata()) == {LIMIT_M}]
        assert len(limits) == 1
    # One metre and thirty seconds at one metre a second, in the world between the others.
    assert "gps_inertial 34.10 m" in drawn["outage"].alt
    assert "limit 2.66 m" in legend_of(drawn["outage"].figure)


def test_an_outage_that_begins_elsewhere_is_drawn_from_its_own_begin(study):
    moved = {family: dict(side) for family, side in study.observed.items()}
    for side in moved.values():
        side["recording.gps_outage_s"] = side["recording.gps_outage_s"] - [[0.0], [0.0], [5.0]]
        side["recording.time_s"] = side["recording.time_s"] - [[0.0], [0.0], [5.0]]
    found = {item.name: item for item in draw(replace(study, observed=moved))}
    curve, _ = lines_of(found["outage"].figure.axes[0], "slam")
    assert curve.get_ydata()[-1] == pytest.approx(1.1)
    at_end = curve.get_ydata()[curve.get_xdata() == END_S - BEGIN_S]
    assert at_end == pytest.approx(1.1 * (1 + 0.05 * 30))


def test_errors_of_the_place_stand_beside_independent_ones(drawn):
    white, place = drawn["outage_place"].figure.axes
    for panel, family in ((white, "white"), (place, "place")):
        curve, _ = lines_of(panel, "wlpf")
        assert curve.get_ydata().max() == pytest.approx(off_m("wlpf", family)[1].max())
    assert place.get_title(loc="left") == "place: of the place"
    assert white.get_ylim() == place.get_ylim()


def test_the_height_is_drawn_as_a_distance(drawn):
    curve, _ = lines_of(drawn["height"].figure.axes[0], "gps_inertial")
    assert curve.get_ydata()[0] == pytest.approx(2.5 * 1.1)


def test_the_table_has_all_configurations_and_the_limit(drawn):
    panels = drawn["table"].figure.axes
    rows = [label.get_text() for label in panels[0].get_yticklabels()]
    assert rows == list(GROWTH)
    away_s = TIME_S[(TIME_S > BEGIN_S) & (TIME_S <= END_S)] - BEGIN_S
    for axes, wide_s in zip(panels, (away_s.mean(), 30.0, 30.0), strict=True):
        expected = [np.mean(SPREAD) * (1 + GROWTH[row] * wide_s) for row in GROWTH if runs(row, "white")]
        np.testing.assert_allclose(dots(axes, "o")[:, 0], expected)
        assert [line for line in axes.get_lines() if set(line.get_xdata()) == {LIMIT_M}]
    assert "n = 180 epochs a flight" in drawn["table"].caption
    mean_m, last_m = (np.mean(SPREAD) * (1 + GROWTH["slam"] * wide_s) for wide_s in (away_s.mean(), 30.0))
    assert f"slam {mean_m:.2f} / {last_m:.2f} / {last_m:.2f}" in drawn["table"].caption
    assert f"slam {mean_m:.2f}, {last_m:.2f}, {last_m:.2f} m" in drawn["table"].alt
    # A row that does not run in a family has no dot there.
    assert len(dots(panels[0], "^")) == sum(runs(row, "weak") for row in GROWTH)


def test_shares_below_the_limit_are_shares_of_worlds(drawn):
    mean, largest = drawn["below_limit"].figure.axes
    asked = [row for row in GROWTH if runs(row, "white")]
    for axes, reduced in ((mean, np.mean), (largest, np.max)):
        inside = (TIME_S > BEGIN_S) & (TIME_S <= END_S)
        held = [100 * (reduced(off_m(r, "white")[:, inside], axis=1) < LIMIT_M).mean() for r in asked]
        np.testing.assert_allclose(dots(axes, "o")[:, 0], held)
        assert len(set(held)) > 2
    assert "wlpf 33 % and 0 %" in drawn["below_limit"].alt


def test_consistency_is_a_mean_over_worlds_and_innovations_stand_below(drawn):
    item = drawn["consistency"]
    ideal, white, innovations = item.figure.axes
    (curve,) = lines_of(white, "slam")
    # Unit covariance of the plane; that of the height is large.
    expected = np.mean(off_m("slam", "white") ** 2 * (1 + 2.5**2 * 1e-6), axis=0)
    np.testing.assert_allclose(curve.get_ydata(), expected)
    assert not lines_of(ideal, "slam_15")
    assert "ideal: gps_inertial 1.3," in item.alt
    labels = [label.get_text() for label in innovations.get_yticklabels()]
    assert labels[:2] == ["ideal: gps_inertial", "ideal: slam"]
    np.testing.assert_allclose(dots(innovations, "o")[:, 0], 1.5)
    np.testing.assert_allclose(dots(innovations, "^")[:, 0], 0.9)
    np.testing.assert_allclose(dots(innovations, "s")[:, 0], 1.1)


def test_the_grey_band_is_that_of_the_mean_of_so_many_worlds(drawn):
    band = drawn["consistency"].figure.axes[0].patches[0]
    low, high = band.get_y(), band.get_y() + band.get_height()
    mean = np.random.default_rng(4).chisquare(9, (40_000, WORLDS)).mean(axis=1)
    assert np.mean((mean > low) & (mean < high)) == pytest.approx(0.95, abs=0.005)


def test_sweeps_are_drawn_at_their_values(drawn):
    mean, largest = drawn["outage_length"].figure.axes
    for axes, factor in ((mean, 1.1), (largest, 2.2)):
        curves = [line for line in axes.get_lines() if len(line.get_xdata()) == 3]
        assert len(curves) == 4
        for curve in curves:
            np.testing.assert_allclose(curve.get_ydata(), factor * np.array([1, 2, 3]))
            np.testing.assert_allclose(curve.get_xdata(), [10, 20, 30], rtol=0.06)
    under, inside, nees = drawn["noise"].figure.axes
    for axes, levels in ((under, 0.55 * np.array([5, 3, 1])), (inside, 1.1 * np.array([5, 3, 1]))):
        (curve,) = [line for line in axes.get_lines() if len(line.get_xdata()) == 3]
        np.testing.assert_allclose(curve.get_ydata(), levels)
    assert nees.get_yscale() == "log"
    assert "1\N{NARROW NO-BREAK SPACE}000 at 0.01" in drawn["noise"].alt
    assert "e+" not in drawn["noise"].caption + drawn["consistency"].caption


def test_labels_of_factors_on_q_have_room():
    factors = [0.01, 0.1, 1.0, 100.0, 10_000.0, 1_000_000.0]
    assert _apart(factors) == [0.01, 1, 100, 10_000, 1_000_000]
    assert _apart([3.0]) == [3]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        *((41_823.0, "41 800"), (2_160_000, "2 160 000"), (998.7, "999"), (999.6, "1 000")),
        *((6.789, "6.79"), (0.01, "0.01"), (1.234e-5, "0.0000123"), (0.0, "0")),
    ],
)
def test_numbers_in_captions_have_three_digits_that_count(value, words):
    assert three_digits(value) == words.replace(" ", "\N{NARROW NO-BREAK SPACE}")


@pytest.mark.parametrize("name", ["outage", "height", "weak", "outage_place"])
def test_curves_over_time_are_told_apart_without_colour(drawn, name):
    for axes in drawn[name].figure.axes:
        looks = [(c.get_linestyle(), c.get_marker()) for c in axes.get_lines() if c.get_marker() != "None"]
        assert len(set(looks)) == len(looks) > 1


def test_the_mean_lag_is_told_with_its_interval(study, drawn):
    half_s = stats.t.ppf(0.975, 2) * 0.01 / np.sqrt(3)
    minus = "\N{MINUS SIGN}"
    for text in (drawn["noise"].caption, drawn["noise"].alt):
        assert f"0.110 s ({0.11 - half_s:.3f} to {0.11 + half_s:.3f}) at 0.01, " in text
        assert f", 0.000 s ({minus}{half_s:.3f} to {half_s:.3f}) at 1, " in text
        assert f", {minus}0.190 s ({minus}{0.19 + half_s:.3f} to {minus}{0.19 - half_s:.3f}) at 100." in text
    unknown = {item.name: item for item in draw(kept(study, lambda m: m["metric"] != "gps_lag_s"))}
    assert "lag" not in unknown["noise"].caption


def test_a_sweep_takes_from_the_table_what_it_need_not_run_again(study):
    rows = CONFIG["sar_flight"]["algorithms"]
    assert {row: rows[row].get("noise_factor", 1) for row in NOISE_ROWS.values()} == {
        row: factor for factor, row in NOISE_ROWS.items()
    }
    # Without 30 s, the length of the recorded outage, and in two worlds of three; and without a factor of 1.
    part = kept(
        study,
        lambda m: (
            ~(m["algorithm"].isin(list(LENGTHS)) & ((m["value"] == 30) | (m["world"] == 2)))
            & ~((m["algorithm"] == "noise_gps") & (m["value"] == 1))
        ),
    )
    found = {item.name: item for item in draw(part)}
    mean, _ = found["outage_length"].figure.axes
    inside = (TIME_S > BEGIN_S) & (TIME_S <= END_S)
    for row, _ in LENGTHS.values():
        (curve,) = [
            line
            for line in mean.get_lines()
            if line.get_color() == KNOWN[row].color and len(line.get_xdata()) == 3
        ]
        np.testing.assert_allclose(curve.get_xdata(), [10, 20, 30], rtol=0.06)
        assert curve.get_ydata()[2] == pytest.approx(off_m(row, "white")[:2, inside].mean())
    under = found["noise"].figure.axes[0]
    (curve,) = [line for line in under.get_lines() if len(line.get_xdata()) == 3]
    np.testing.assert_allclose(curve.get_xdata(), [0.01, 1, 100])
    before = (TIME_S >= SETTLED_S) & (TIME_S <= BEGIN_S)
    assert curve.get_ydata()[1] == pytest.approx(off_m("gps_inertial", "white")[:, before].mean())


def test_variants_are_paired_and_conditions_stand_below(drawn):
    under, inside, condition = drawn["variants"].figure.axes
    rows = [label.get_text().split("\n")[0] for label in under.get_yticklabels()]
    assert rows == ["gps_inertial_flat", "slam_flat", "gps_inertial_lagrange", "gps_inertial_radians"]
    middle_s = 15.25
    np.testing.assert_allclose(dots(under, "o")[:, 0], 0, atol=1e-9)
    expected = [
        100 * (GROWTH[row] / GROWTH[other] - 1) * GROWTH[other] * middle_s / (1 + GROWTH[other] * middle_s)
        for row, other in zip(rows, ("gps_inertial", "slam", "gps_inertial", "gps_inertial"), strict=True)
    ]
    np.testing.assert_allclose(dots(inside, "o")[:, 0], expected, rtol=1e-9, atol=1e-9)
    levels = dict(
        zip([t.get_text() for t in condition.get_yticklabels()], dots(condition, "o")[:, 0], strict=True)
    )
    assert levels["gps_inertial_radians"] == pytest.approx(14)
    assert levels["gps_inertial"] == pytest.approx(4)
    ticks = [t.get_text() for t in inside.get_xticklabels()]
    assert len(ticks) == len(set(ticks))
    assert "0" in ticks


def test_what_was_left_out_has_no_figure(study):
    assert names(without(study, *SWEEPS)) == [n for n in ALL if n not in ("outage_length", "noise")]
    variants = ("slam_flat", "gps_inertial_flat", "gps_inertial_lagrange", "gps_inertial_radians")
    assert names(without(study, *variants)) == [n for n in ALL if n != "variants"]
    assert names(without(study, "slam_weak_15", "slam_wlpf_weak_15", "gps_inertial_15"))[-2:] == [
        "variants",
        "height",
    ]
    assert names(replace(study, estimate_files=())) == [
        *("block", "table", "below_limit", "outage_length", "noise", "variants")
    ]
    assert names(replace(study, observed={family: {} for family in FAMILIES})) == [
        *("table", "below_limit", "outage_length", "noise", "variants")
    ]
    bare = replace(study, measures=study.measures.iloc[:0], observed={}, truth={})
    assert names(bare) == []
    one = without(study, *(row for row in GROWTH if row != "wlpf"))
    left = ["block", "outage", "outage_place", "table", "below_limit", "height"]
    assert names(without(one, *SWEEPS)) == left


@pytest.mark.filterwarnings("error")
def test_one_family_and_one_world_are_enough(study, tmp_path):
    paths = []
    for path in study.estimate_files:
        step = read_tree(path)["white/0"]
        own = tmp_path / path.split("/")[-2] / "00000.npz"
        own.parent.mkdir()
        write_tree(own, {"white/0": {name: v[:1] if v.ndim else v for name, v in step.items()}})
        paths.append(str(own))

    def first(tree):
        return {"white": {name: values[:1] for name, values in tree["white"].items()}}

    single = kept(study, lambda m: (m["world"] == 0) & (m["family"] == "white"))
    single = replace(
        single,
        observed=first(study.observed),
        truth=first(study.truth),
        estimate_files=tuple(paths),
        paper={},
    )
    found = {item.name: item for item in draw(single)}
    assert list(found) == [name for name in ALL if name != "weak"]
    for item in found.values():
        assert "single experiments" not in item.caption
        assert "interval" not in item.caption
        assert "nan" not in item.caption + item.alt
        with drawing(GROWTH):
            item.figure.draw_without_rendering()


def test_rows_of_the_studies_have_strokes_that_are_told_apart():
    for name in ("sar_flight", "flight_real"):
        rows = list(CONFIG[name]["algorithms"])
        assert all(row in KNOWN and contrast(KNOWN[row].color, "#ffffff") >= 3 for row in rows)
        for first, second in itertools.combinations(rows, 2):
            apart = difference(KNOWN[first].color, KNOWN[second].color)
            assert apart > (15 if KNOWN[first][1:] != KNOWN[second][1:] else 25), (first, second)
    for row in ("gps_inertial", "slam", "slam_new_ground", "wlpf", "slam_wlpf"):
        assert KNOWN[row].marker == KNOWN[f"{row}_15"].marker
        assert KNOWN[row].line != KNOWN[f"{row}_15"].line


ORIGIN = np.array([0.79, -1.28, 30.0])
CUTS = {"rover": (np.nan, np.nan), "cut_a": (20.0, 40.0), "cut_b": (30.0, 40.0)}
ROVER_ROWS = {"inertial": 500.0, "gps_inertial": 3.0, "gps_inertial_15": 1.0, "control_centre": 8.0}
ROVER_REAL = ["track", "errors", "outage"]


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rover")
    time_s = np.arange(60.0)
    path_m = np.stack([0.4 * time_s, np.sin(time_s / 9)], axis=-1)
    asked_m = np.where(time_s[:, None] >= 10, path_m, np.nan)
    local_m = np.c_[path_m, np.zeros(60)] + [0.5, 0.0, 1.0]
    observed, truth, trees = {}, {}, {row: {} for row in ROVER_ROWS}
    index = {"world": np.zeros(1, dtype=int), "seed": np.zeros(1, dtype=int)}
    for family, outage_s in CUTS.items():
        observed[family] = index | {
            "site.origin_geodetic": ORIGIN[None],
            "recording.time_s": time_s[None],
            "recording.gps_geodetic": to_geodetic(local_m, ORIGIN)[None],
            "recording.gps_outage_s": np.array([outage_s]),
        }
        truth[family] = index | {"truth.path_m": path_m[None], "truth.position_m": asked_m[None]}
        for row, level in ROVER_ROWS.items():
            away = (time_s > outage_s[0]) & (time_s <= outage_s[1])
            off = level + np.where(away, time_s - outage_s[0], 0.0)
            trees[row][f"{family}/0"] = {
                "world": np.zeros(1, dtype=int),
                "value": np.array(np.nan),
                "skipped": np.array(""),
                "estimate.position_m": (path_m + off[:, None] * [0.8, -0.6])[None],
            }
    paths = []
    for row, tree in trees.items():
        path = folder / row / "00000.npz"
        path.parent.mkdir()
        write_tree(path, tree)
        paths.append(str(path))
    lines = [(f, row, np.nan, 0, "mean_m", level) for f in CUTS for row, level in ROVER_ROWS.items()]
    return StudyResults(
        study="flight_real",
        rows=tuple(ROVER_ROWS),
        sweeps={},
        measures=pd.DataFrame(lines, columns=MEASURES),
        error_files=(),
        observed=observed,
        truth=truth,
        paper=PAPER,
        estimate_files=tuple(paths),
    )


def test_the_rover_is_drawn_with_its_gps_and_its_outage(real):
    found = {item.name: item for item in draw(real)}
    assert list(found) == ROVER_REAL
    for item in found.values():
        assert "n = " in item.caption
        assert "world" in item.caption
        assert "assumed" in item.caption
        assert "publishers' own fusion" in item.caption
        assert "nan" not in item.caption + item.alt
        with drawing(ROVER_ROWS):
            item.figure.draw_without_rendering()
    (plan,) = found["track"].figure.axes
    curves = {line.get_label(): line.get_xydata() for line in plan.get_lines()}
    np.testing.assert_allclose(
        curves["GPS antenna"] - curves["reference"], np.tile([0.5, 0.0], (60, 1)), atol=1e-3
    )
    np.testing.assert_allclose(curves["outage of GPS"], curves["reference"][21:41])
    assert "inertial" not in curves
    assert "gps_inertial up to 23.00 m off in the outage" in found["track"].alt


def test_errors_of_the_rover_over_time_and_in_the_outage(real):
    found = {item.name: item for item in draw(real)}
    panels = found["errors"].figure.axes
    assert [axes.get_title(loc="left") for axes in panels[:3]] == [
        "rover: GPS throughout",
        "cut_a: no GPS 20 to 40 s",
        "cut_b: no GPS 30 to 40 s",
    ]
    assert [len(axes.patches) for axes in panels[:3]] == [0, 1, 1]
    (curve,) = lines_of(panels[1], "gps_inertial")
    assert np.isnan(curve.get_ydata()[:10]).all()
    assert curve.get_ydata()[40] == pytest.approx(23)
    assert not lines_of(panels[0], "control_centre")
    mean, largest, last = found["outage"].figure.axes
    for axes, levels in ((mean, (13.5, 8.5)), (largest, (23, 13)), (last, (23, 13))):
        x = [
            line.get_xdata()[0]
            for line in axes.get_lines()
            if line.get_color() == KNOWN["gps_inertial"].color
        ]
        np.testing.assert_allclose(x, levels)
    dots = {line.get_color(): line.get_marker() for line in mean.get_lines() if len(line.get_xdata()) == 1}
    assert len(set(dots.values())) == len(dots) > 1
    assert "n = 2 recordings with 10 or 20 epochs" in found["outage"].caption


def test_the_page_of_the_rover_tells_how_large_the_innovations_are(real):
    def caption(*nis):
        lines = [("rover", row, np.nan, 0, "nis_gps", x) for row, x in zip(TRACKS, nis, strict=True)]
        measured = pd.concat([real.measures, pd.DataFrame(lines, columns=MEASURES)], ignore_index=True)
        return next(d for d in draw(replace(real, measures=measured)) if d.name == "errors").caption

    assert "gps_inertial 1.5, gps_inertial_15 0.04" in caption(1.5, 0.04)
    assert "too large for this receiver, by a factor of about 5 if" in caption(1.5, 0.04)
    assert "too large" not in caption(1.5, 0.9)
    assert "innovation" not in next(d for d in draw(real) if d.name == "errors").caption


def test_the_page_of_the_rover_puts_filters_beside_the_gps_that_they_use(real):
    def caption(rows):
        gps_s = {"recording.gps_time_s": np.arange(60.0)[None]}
        observed = {family: arrays | gps_s for family, arrays in real.observed.items()}
        return next(
            d for d in draw(replace(real, rows=rows, observed=observed)) if d.name == "errors"
        ).caption

    words = "readings of GPS are 0.50 m off on the mean, gps_inertial 3.00 m"
    assert f"{words}: gps_inertial is worse than the GPS that it uses." in caption(tuple(ROVER_ROWS))
    assert "readings of GPS are" not in caption(("inertial",))


def test_a_rover_without_estimates_outages_or_rows_is_enough(real):
    assert names(replace(real, estimate_files=())) == []
    whole = replace(kept(real, lambda m: m["family"] == "rover"), observed={"rover": real.observed["rover"]})
    assert names(whole) == ["track", "errors"]
    assert "1.00 m off on the mean" in draw(whole)[0].alt
    alone = replace(real, rows=("inertial", "control_centre"))
    assert names(alone) == ["errors", "outage"]
    assert names(replace(real, rows=("control_centre",))) == []
