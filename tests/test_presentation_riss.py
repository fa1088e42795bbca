"""Figures of the study riss_wifi, from invented estimates and measures whose numbers the test knows."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from positioning.evaluation.measures import MEASURES, measure
from positioning.evaluation.results import StudyResults
from positioning.files import read_yaml, write_errors, write_tree
from positioning.presentation.study_figures import draw
from positioning.presentation.style import KNOWN, contrast, drawing

ROOT = Path(__file__).resolve().parents[1]
PAPER = read_yaml(ROOT / "data/papers/riss_wifi.yaml")
FAMILIES = ("fresh", "aged")
WORLDS, EPOCHS, LENGTH, POINTS, COLUMNS = 3, 60, 52, 12, 7
ROWS = {"riss": 4.0, "wifi_full": 3.0, "wifi_fos": 3.5, "adaptive_fast_mixture": 1.5}
ROWS |= {"plain": 1.0, "kalman_3": 2.0, "control_centre": 9.0}
OFFSET_M = {row: np.array([0.6, 0.8]) * level for row, level in ROWS.items()}
SWEEPS = {
    **{f"columns_{name}": ("columns", (1.0, 4.0)) for name in ("fos", "pca", "strongest", "random")},
    **{f"{name}_particles": ("particles", (25.0, 1000.0)) for name in ("plain", "mixture")},
    "scan_every": ("scan_every", (1.0, 20.0)),
}
DRIVE = [f"fig{n}" for n in (3, 4, 5, 7, 8, 9, 11, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22)]
ALL = [*DRIVE, "fig23", "table2", "columns", "filters", "paired", "particles", "scan_rate"]
REST_S = ((0.0, 5.0), (30.0, 34.0))
ASKED = np.arange(2, LENGTH, 7)


def worlds_of(family_number):
    """A drive along a corner with two rests, a radio map, and the readings of both sensors."""
    rng = np.random.default_rng(family_number)
    time_s = np.arange(EPOCHS, dtype=float)
    ended = np.where(time_s < LENGTH, 0.0, np.nan)
    path_m = np.stack([5 + np.minimum(time_s, 20) * 0.5, 5 + np.maximum(time_s - 20, 0) * 0.4], axis=-1)
    path_m += ended[:, None]
    position_m = np.full((EPOCHS, 2), np.nan)
    position_m[ASKED] = path_m[ASKED]
    motion_s = np.arange(0, 100 * LENGTH + 200) / 100
    speed = np.full(motion_s.shape, 0.6)
    for begin_s, end_s in REST_S:
        speed[(motion_s >= begin_s) & (motion_s < end_s)] = 0.0
    after = np.where(motion_s < LENGTH, 0.0, np.nan)
    gyro = rng.normal(0.02, 0.005, motion_s.shape)
    survey_dbm = np.round(rng.normal(-65, 8, (POINTS, COLUMNS)))
    survey_dbm[rng.random(survey_dbm.shape) < 0.2] = np.nan
    observed = {
        "site.corner_m": [[0.0, 0.0], [30.0, 30.0]],
        "site.wall_m": [[[1.0, 1.0], [29.0, 1.0]], [[1.0, 1.0], [1.0, 29.0]]],
        "survey.rss_dbm": survey_dbm,
        "survey.position_m": rng.uniform(2, 28, (POINTS, 2)),
        "recording.time_s": time_s + ended,
        "recording.motion_time_s": motion_s + after,
        "recording.gyro_rad_per_s": gyro + after,
        "recording.odometer_m_per_s": speed + after,
        "static.rss_dbm": [-60.0, -61.0, -61.0, -58.0, -58.0, -58.0],
    }
    truth = {"truth.position_m": position_m, "truth.path_m": path_m}
    index = {"world": np.arange(WORLDS), "seed": np.arange(WORLDS)}
    return [
        index
        | {
            name: np.repeat(np.asarray(value, dtype=float)[None], WORLDS, axis=0)
            for name, value in side.items()
        }
        for side in (observed, truth)
    ]


def errors_of(level, values=(np.nan,)):
    parts = []
    for shift, family in enumerate(FAMILIES):
        for value in values:
            for world in range(WORLDS):
                size = level * (1 + shift) + 0.1 * world + (0 if np.isnan(value) else value / 1000)
                columns = {"family": family, "value": value, "world": world, "sample": ASKED}
                parts.append(pd.DataFrame({**columns, "error_m": np.full(len(ASKED), size)}))
    return pd.concat(parts, ignore_index=True)


def estimate_of(row, sides):
    """The true path, moved by a distance of its own for each row."""
    tree = {}
    for family, (_, truth) in sides.items():
        position_m = truth["truth.path_m"] + OFFSET_M[row]
        step = {
            "world": np.arange(WORLDS),
            "value": np.array(np.nan),
            "seconds": np.ones(WORLDS),
            "skipped": np.array("too little" if (row, family) == ("kalman_3", "aged") else ""),
            "estimate.position_m": position_m,
            "estimate.covariance_m2": np.broadcast_to(
                np.diag([1.0, 0.04]), (*position_m.shape[:2], 2, 2)
            ).copy(),
        }
        if row == "adaptive_fast_mixture":
            step["estimate.extra_weight_prediction"] = np.full((WORLDS, EPOCHS), 0.8)
            step["estimate.extra_weight_wifi"] = np.full((WORLDS, EPOCHS), 0.2)
        tree[f"{family}/0"] = step
    return tree


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("riss")
    sides = {family: worlds_of(number) for number, family in enumerate(FAMILIES)}
    frames = {row: errors_of(level) for row, level in ROWS.items()}
    frames |= {name: errors_of(2.5, values) for name, (_, values) in SWEEPS.items()}
    error_files, estimate_files = [], []
    for row, frame in frames.items():
        path = folder / "errors" / row / "00000.parquet"
        path.parent.mkdir(parents=True)
        columns = {name: frame[name].to_numpy() for name in frame}
        write_errors(path, {**columns, "family": frame["family"].to_numpy(dtype=np.str_)}, {})
        error_files.append(str(path))
    for row in ROWS:
        path = folder / "estimates" / row / "00000.npz"
        path.parent.mkdir(parents=True)
        write_tree(path, estimate_of(row, sides))
        estimate_files.append(str(path))
    shares = [
        (family, row, np.nan, world, "within_1m", 0.25)
        for family in FAMILIES
        for row in ROWS
        for world in range(WORLDS)
    ]
    measures = [measure(frame, row) for row, frame in frames.items()]
    return StudyResults(
        study="riss_wifi",
        rows=tuple(ROWS),
        sweeps=SWEEPS,
        measures=pd.concat([*measures, pd.DataFrame(shares, columns=MEASURES)], ignore_index=True),
        error_files=tuple(error_files),
        observed={family: side[0] for family, side in sides.items()},
        truth={family: side[1] for family, side in sides.items()},
        paper=PAPER,
        estimate_files=tuple(estimate_files),
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
    """Data of single markers, those of the legend left out."""
    found = [item for item in axes.get_lines() if item.get_marker() == marker]
    return np.array([item.get_xydata()[0] for item in found if len(item.get_xydata()) == 1])


def test_all_figures_are_there_in_order_and_are_drawn_without_warning(drawn):
    assert list(drawn) == ALL
    for item in drawn.values():
        with drawing():
            item.figure.draw_without_rendering()


def test_captions_tell_samples_and_worlds_and_numbers_need_no_eyes(drawn):
    for item in drawn.values():
        assert "n = " in item.caption, item.name
        assert "world" in item.caption.lower(), item.name
        assert re.search(r"\d", item.alt), item.name
        assert "nan" not in item.caption + item.alt, item.name


def test_axes_have_units(drawn):
    for name, item in drawn.items():
        labels = [axes.get_xlabel() + axes.get_ylabel() for axes in item.figure.axes]
        text = "".join([*labels, item.figure.get_supxlabel()])
        assert re.search(r"\((m|s|dBm|m/s|degrees/s)\)", text), name


def test_estimates_of_the_first_batch_are_named_without_prefix(study):
    found = study.estimate("adaptive_fast_mixture", "aged")
    expected = study.truth["aged"]["truth.path_m"] + OFFSET_M["adaptive_fast_mixture"]
    np.testing.assert_array_equal(found["position_m"], expected)
    assert set(found) == {"position_m", "covariance_m2", "extra_weight_prediction", "extra_weight_wifi"}
    assert study.estimate("kalman_3", "aged") == {}
    assert study.estimate("kalman_3", "no_family") == {}
    assert study.estimate("no_row", "fresh") == {}
    later = tuple(p.replace("00000", "00040") for p in study.estimate_files)
    both = replace(study, estimate_files=(*later, *study.estimate_files))
    assert "position_m" in both.estimate("riss", "fresh")


def test_tracks_and_coordinates_are_those_of_the_first_world(study, drawn):
    path_m = study.truth["fresh"]["truth.path_m"][0, :LENGTH]
    (axes,) = drawn["fig4"].figure.axes
    np.testing.assert_allclose(line(axes, "RISS alone").get_xydata(), path_m + OFFSET_M["riss"])
    np.testing.assert_allclose(line(axes, "way-points").get_xydata(), path_m[ASKED])
    for name, row, axis in (
        ("fig7", "wifi_full", 0),
        ("fig8", "wifi_full", 1),
        ("fig16", "wifi_fos", 0),
        ("fig17", "wifi_fos", 1),
        ("fig19", "adaptive_fast_mixture", 1),
        ("fig20", "adaptive_fast_mixture", 0),
    ):
        (axes,) = drawn[name].figure.axes
        assert axes.get_ylabel() == ("east (m)", "north (m)")[axis]
        lines = [item.get_ydata() for item in axes.get_lines()]
        expected = (path_m + OFFSET_M[row])[:, axis]
        assert any(len(y) == LENGTH and np.allclose(y, expected) for y in lines), name
        assert f"{abs(OFFSET_M[row][axis]):.2f} m" in drawn[name].alt
    assert "4.00 m" in drawn["fig4"].caption
    assert [axes.get_title(loc="left")[-6:] for axes in drawn["fig22"].figure.axes] == [
        f"{ROWS[row]:.2f} m" for row in ("riss", "wifi_full", "wifi_fos", "adaptive_fast_mixture")
    ]


def test_tracks_that_leave_the_floor_stay_in_the_plan(study):
    far = {**study.truth["fresh"]}
    far["truth.path_m"] = far["truth.path_m"] - 20
    far["truth.position_m"] = far["truth.position_m"] - 20
    moved = {item.name: item for item in draw(replace(study, truth={**study.truth, "fresh": far}))}
    (axes,) = moved["fig4"].figure.axes
    track_m = line(axes, "RISS alone").get_xydata()
    assert axes.get_xlim()[1] > track_m[:, 0].max()
    assert axes.get_ylim()[1] > track_m[:, 1].max()


def test_histogram_counts_whole_levels(drawn):
    bars = drawn["fig5"].figure.axes[0].patches
    found = {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in bars}
    assert found == {-61: 2, -60: 1, -58: 3}


def test_rests_are_shaded_behind_the_weights(drawn):
    (axes,) = drawn["fig11"].figure.axes
    spans = [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]
    np.testing.assert_allclose(spans, REST_S, atol=0.02)
    assert set(line(axes, "A, prediction").get_ydata()) == {0.8}
    assert set(line(axes, "B, WiFi").get_ydata()) == {0.2}


def test_averaging_halves_the_readings_and_keeps_the_axes(drawn):
    raw, averaged = (drawn[name].figure.axes for name in ("fig13", "fig14"))
    for first, second in zip(raw, averaged, strict=True):
        assert first.get_ylim() == second.get_ylim()
    cut, thin = raw[1].get_lines()[0], averaged[1].get_lines()[0]
    np.testing.assert_allclose(
        thin.get_ydata()[5:50], cut.get_ydata()[10:100].reshape(-1, 2).mean(axis=1), rtol=1e-9
    )
    assert f"n = {100 * LENGTH}," in drawn["fig13"].caption
    assert f"n = {50 * LENGTH}," in drawn["fig14"].caption


def test_selected_columns_are_those_of_the_search(study, drawn):
    rss_dbm = study.observed["fresh"]["survey.rss_dbm"][0]
    chosen = FastOrthogonalSearch(columns=4).fit(rss_dbm).selected_
    panels = drawn["fig15"].figure.axes[:4]
    for rank, (axes, number) in enumerate(zip(panels, chosen, strict=True), start=1):
        heard = ~np.isnan(rss_dbm[:, number])
        assert axes.get_title(loc="left") == f"{rank}: column {number + 1}, heard at {heard.sum()}"
        (points,) = axes.collections
        np.testing.assert_array_equal(points.get_array(), rss_dbm[heard, number])


def test_confidence_is_that_of_the_covariance(drawn):
    for axes, sigma_m, error_m in zip(
        drawn["fig21"].figure.axes, (1.0, 0.2), OFFSET_M["adaptive_fast_mixture"], strict=True
    ):
        (band,) = axes.collections
        edges_m = band.get_paths()[0].vertices[:, 1]
        np.testing.assert_allclose([edges_m.min(), edges_m.max()], [-1.96 * sigma_m, 1.96 * sigma_m])
        np.testing.assert_allclose(line(axes, "true error").get_ydata(), error_m)
    assert "east: 100 % of the epochs inside" in drawn["fig21"].caption
    assert "north: 0 % of the epochs inside" in drawn["fig21"].caption


def test_cumulative_error_holds_the_printed_share(drawn):
    for axes in drawn["fig23"].figure.axes:
        np.testing.assert_allclose(dots(axes, "D"), [[1.0, 70.0]])
        assert set(ROWS) - {"plain", "kalman_3", "control_centre"} <= {
            item.get_label() for item in axes.get_lines()
        }
    assert "riss 25 %" in drawn["fig23"].caption


def test_table_2_is_compared_with_both_families(drawn):
    rmse, most = drawn["table2"].figure.axes
    np.testing.assert_allclose(dots(rmse, "D"), np.c_[[4.4743, 3.4, 3.01, 1.6], range(4)])
    np.testing.assert_allclose(dots(most, "D"), np.c_[[10.1719, 4.2422, 3.2422, 2.9681], range(4)])
    levels = np.array(list(ROWS.values())[:4])
    np.testing.assert_allclose(dots(rmse, "o")[:, 0], levels + 0.1)
    np.testing.assert_allclose(dots(rmse, "s")[:, 0], 2 * levels + 0.1)


def test_filters_and_their_paired_differences(drawn):
    def rows(name):
        return [label.get_text() for label in drawn[name].figure.axes[0].get_yticklabels()]

    assert rows("filters") == ["adaptive_fast_mixture", "plain", "kalman_3"]
    assert rows("paired") == ["plain", "kalman_3"]
    (axes,) = drawn["paired"].figure.axes
    np.testing.assert_allclose(dots(axes, "o")[:, 0], [-0.5, 0.5])
    np.testing.assert_allclose(dots(axes, "s")[:, 0], [-1.0, 1.0])


def test_differences_are_taken_on_common_worlds(study):
    some = kept(study, lambda m: (m["algorithm"] != "plain") | (m["world"] == 2))
    found = {item.name: item for item in draw(some)}
    np.testing.assert_allclose(dots(found["paired"].figure.axes[0], "o")[0, 0], -0.5)


def test_sweeps_have_a_panel_for_each_family(drawn):
    for name, count in (("columns", 5), ("particles", 2), ("scan_rate", 1)):
        panels = drawn[name].figure.axes
        assert [axes.get_title(loc="left") for axes in panels] == list(FAMILIES)
        for shift, axes in enumerate(panels):
            curves = [item for item in axes.get_lines() if not item.get_label().startswith("_")]
            assert len(curves) == count
            for curve in [item for item in curves if item.get_marker() not in (None, "None")]:
                expected = 2.5 * (1 + shift) + 0.1 + curve.get_xdata() / 1000
                np.testing.assert_allclose(curve.get_ydata(), expected, rtol=0.02)
    full = line(drawn["columns"].figure.axes[1], "WiFi (full map)")
    np.testing.assert_allclose(full.get_ydata(), 6.1)


def test_what_was_left_out_has_no_figure(study):
    quick = kept(replace(study, sweeps={}), lambda m: ~m["algorithm"].isin(SWEEPS))
    assert names(quick) == [n for n in ALL if n not in ("columns", "particles", "scan_rate")]
    no_estimates = replace(study, estimate_files=())
    assert names(no_estimates)[:5] == ["fig3", "fig5", "fig13", "fig14", "fig15"]
    alone = kept(study, lambda m: m["algorithm"].isin(["riss", "scan_every"]))
    assert names(alone)[-3:] == ["fig23", "table2", "scan_rate"]
    bare = replace(study, observed={family: {} for family in FAMILIES}, truth={})
    assert names(bare) == ALL[len(DRIVE) :]
    still = dict(study.observed["fresh"])
    for name in ("motion_time_s", "gyro_rad_per_s", "odometer_m_per_s"):
        del still[f"recording.{name}"]
    del still["static.rss_dbm"], still["survey.rss_dbm"]
    found = names(replace(study, observed={**study.observed, "fresh": still}))
    assert found == [n for n in ALL if n not in ("fig5", "fig13", "fig14", "fig15")]


@pytest.mark.filterwarnings("error")
def test_one_family_and_one_world_without_printed_numbers_are_enough(study):
    single = kept(study, lambda m: (m["world"] == 0) & (m["family"] == "fresh"))
    found = {item.name: item for item in draw(replace(single, paper={}))}
    assert list(found) == ALL
    for item in found.values():
        assert "aged" not in item.caption + item.alt
        assert "single experiments" not in item.caption
        assert "nan" not in item.caption + item.alt
        with drawing():
            item.figure.draw_without_rendering()
    assert not len(dots(found["table2"].figure.axes[0], "D"))


def test_rows_of_the_study_have_strokes_and_variants_share_a_marker():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    rows = list(config["riss_wifi"]["algorithms"])
    assert all(row in KNOWN and contrast(KNOWN[row].color, "#ffffff") >= 3 for row in rows)
    for variants in (
        ("wifi_full", "wifi_full_scaled"),
        ("wifi_fos", "wifi_pca", "wifi_strongest", "wifi_random"),
        ("mixture", "fast_mixture", "adaptive_fast_mixture", "adaptive_mixture_full"),
        ("plain", "plain_wide"),
        ("kalman_3", "kalman_5", "kalman_5_full"),
    ):
        assert len({KNOWN[row].marker for row in variants}) == 1
        assert len({KNOWN[row].line for row in variants}) == len(variants)
