"""Figures of the Bluetooth studies, from invented measures whose numbers the test knows."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from matplotlib.collections import LineCollection

from positioning.evaluation.measures import MEASURES, measure
from positioning.evaluation.results import StudyResults, read_row_errors
from positioning.evaluation.studies.bluetooth_robot import NEAREST_M
from positioning.files import read_yaml, write_errors
from positioning.presentation import figures
from positioning.presentation.study_figures import draw
from positioning.presentation.style import KNOWN, contrast, drawing
from positioning.ranging import crossings
from positioning.simulation import bluetooth_scenario

ROOT = Path(__file__).resolve().parents[1]
PAPER = read_yaml(ROOT / "data/papers/bluetooth_robot.yaml")
FAMILIES = ("shadowing", "ambiguity")
WORLDS, RUNS, EPOCHS = 4, 6, 9
LENGTHS = (9, 5, 7, 6, 4, 8)
TRACKING = {"particle_filter": 0.6, "particle_filter_product": 0.9, "trilateration_alone": 1.2}
TRACKING |= {"control_oracle": 0.2, "control_centre": 9.0}
TRILATERATION = {"pseudo_inverse": 2.0, "iterative_fractional_printed": 0.8}
SWEEPS = {
    "step": ("step", (0.05, 0.4)),
    "particles": ("particles", (50.0, 500.0)),
    "sigma": ("sigma_m", (0.5, 1.0)),
}
ALL = ["world", "fig1", "fig2", "fig3", "table1", "fig5", "table2", "summary", "ablations"]
ALL += ["trilateration", "convergence", "particles", "sigma", "distribution"]


def asked():
    """Samples that runs of different length have: run * EPOCHS + epoch."""
    return np.concatenate([run * EPOCHS + np.arange(n) for run, n in enumerate(LENGTHS)])


def errors_of(mean, values=(np.nan,), families=FAMILIES):
    """Errors that differ at each family, world and sample, with a known mean over samples."""
    parts = []
    for shift, family in enumerate(families):
        for value in values:
            for world in range(WORLDS):
                sample = asked()
                wave = 1 + 0.5 * np.cos(2 * np.pi * np.arange(len(sample)) / len(sample))
                level = mean * (1 + 0.1 * world) * (1 + 0.25 * shift)
                if not np.isnan(value):
                    level *= 1 + value / 1000
                columns = {"family": family, "value": value, "world": world, "sample": sample}
                parts.append(pd.DataFrame({**columns, "error_m": level * wave}))
    return pd.concat(parts, ignore_index=True)


def write(folder, study, row, frame):
    path = folder / "errors" / study / row / "00000.parquet"
    path.parent.mkdir(parents=True)
    columns = {name: frame[name].to_numpy() for name in frame}
    write_errors(path, {**columns, "family": frame["family"].to_numpy(dtype=np.str_)}, {})
    return str(path)


def own_measures(families):
    """The study's own measures: what the row `robot`, ranging, trilateration and tracking have."""
    lines = []

    def add(row, metric, x, value=np.nan):
        for shift, family in enumerate(families):
            for world in range(WORLDS):
                lines.append((family, row, value, world, metric, x + 0.1 * world + shift))

    for run, length in enumerate(LENGTHS, start=1):
        add("robot", f"iterations_{run}", length)
        add("curve_crossings", f"trial_{run}_m", 0.5 + 0.1 * run)
        add("curve_crossings", f"k_{run}", 10.0 * run)
        for row in TRACKING:
            add(row, f"final_{run}_m", 0.1 * run)
    add("robot", "iterations_mean", np.mean(LENGTHS))
    add("curve_crossings", "trials_mean_m", 0.85)
    add("curve_crossings", "k_mean", 35.0)
    for row in TRACKING:
        add(row, "final_mean_m", 0.3)
    for row, mean in TRILATERATION.items():
        add(row, "outputs_m", 2 * mean)
    frame = pd.DataFrame(lines, columns=MEASURES)
    shares = [
        (families[0], "step", step, world, f"converged_{number}", share - 0.002 * world)
        for step, row in ((0.05, (0.9, 0.96, 1.0)), (0.4, (0.1, 0.55, 0.98)))
        for number, share in zip((3, 4, 6), row, strict=True)
        for world in range(2)
    ]
    shares += [
        (families[0], "step", step, world, "converged", 0.5) for step in (0.05, 0.4) for world in range(2)
    ]
    return pd.concat([frame, pd.DataFrame(shares, columns=MEASURES)], ignore_index=True)


def worlds_of(family_number):
    rng = np.random.default_rng(family_number)
    position_m = np.full((WORLDS, RUNS, EPOCHS, 2), np.nan)
    for run, length in enumerate(LENGTHS):
        position_m[:, run, :length] = rng.uniform([0.2, 0.2], [5.8, 7.8], (WORLDS, length, 2))
    index = {"world": np.arange(WORLDS), "seed": np.arange(WORLDS)}
    distance_m = np.tile(np.arange(1.0, 8.0), (WORLDS, 1))
    curve_dbm = np.tile([-50.0, -56.0, -54.0, -60.0, -58.0, -64.0, -70.0], (WORLDS, 1))
    observed = {
        "site.corner_m": np.tile([[0.0, 0.0], [6.0, 8.0]], (WORLDS, 1, 1)),
        "site.access_point_m": np.tile([[1.72, 0.35], [1.79, 5.63], [3.05, 2.61]], (WORLDS, 1, 1)),
        "calibration.distance_m": distance_m,
        "calibration.rss_dbm": curve_dbm - family_number,
        "recording.time_s": np.where(np.isnan(position_m[..., 0]), np.nan, 15.0 * np.arange(EPOCHS)),
        "static.time_s": np.tile(3.0 * np.arange(7), (WORLDS, 1)),
        "static.rss_dbm": np.tile([-60.0, -61, -60, -58, -60, -61, -62], (WORLDS, 1)),
    }
    truth = {
        "truth.position_m": position_m,
        "truth.law_distance_m": np.tile(np.linspace(0, 10, 101), (WORLDS, 1)),
        "truth.law_dbm": np.tile(-50 - 2 * np.linspace(0, 10, 101), (WORLDS, 1)),
        "truth.furniture_m": np.tile([[[4.0, 1.0], [5.2, 1.6]], [[0.4, 3.0], [0.9, 4.0]]], (WORLDS, 1, 1, 1)),
    }
    return {**index, **observed}, {**index, **truth}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """All that the workflow hands over of a study with two families, four worlds and three sweeps."""
    folder = tmp_path_factory.mktemp("robot")
    frames = {row: errors_of(mean) for row, mean in {**TRACKING, **TRILATERATION}.items()}
    frames["curve_crossings"] = errors_of(0.9)
    frames |= {name: errors_of(0.7, SWEEPS[name][1]) for name in ("particles", "sigma")}
    measures = [measure(frame, row) for row, frame in frames.items()] + [own_measures(FAMILIES)]
    sides = {family: worlds_of(number) for number, family in enumerate(FAMILIES)}
    return StudyResults(
        study="bluetooth_robot",
        rows=("curve_crossings", *TRILATERATION, *TRACKING),
        sweeps=SWEEPS,
        measures=pd.concat(measures, ignore_index=True),
        error_files=tuple(write(folder, "bluetooth_robot", row, frame) for row, frame in frames.items()),
        observed={family: side[0] for family, side in sides.items()},
        truth={family: side[1] for family, side in sides.items()},
        paper=PAPER,
    )


@pytest.fixture(scope="module")
def drawn(robot):
    return {item.name: item for item in draw(robot)}


def kept(results, keep):
    """Return results with only those lines of the measures, which a smaller configuration would have."""
    return replace(results, measures=results.measures[keep(results.measures)].reset_index(drop=True))


def names(results):
    return [item.name for item in draw(results)]


def dots(axes, marker):
    """Return the places of single markers of a kind, [n, 2]."""
    lines = [line for line in axes.get_lines() if line.get_marker() == marker and len(line.get_xdata()) == 1]
    return np.array([[line.get_xdata()[0], line.get_ydata()[0]] for line in lines], dtype=float)


def test_all_figures_are_drawn_and_can_be_saved_twice_with_equal_bytes(robot, drawn, tmp_path):
    assert list(drawn) == ALL
    again = [item for item in draw(robot) if item.name in ("world", "fig3", "convergence")]
    saved = []
    for name, items in (("first", drawn.values()), ("second", again)):
        (tmp_path / name).mkdir()
        figures.save(items, tmp_path / name)
        saved.append({path.name: path.read_bytes() for path in (tmp_path / name).glob("*.*g")})
        saved[-1] |= {path.name: path.read_bytes() for path in (tmp_path / name).glob("*.pdf")}
    assert len(saved[0]) == 2 * len(ALL)
    assert saved[1].items() <= saved[0].items()


def test_captions_tell_samples_and_worlds_and_numbers_need_no_eyes(drawn):
    for item in drawn.values():
        assert "n = " in item.caption, item.name
        assert "world" in item.caption.lower(), item.name
        assert re.search(r"\d", item.alt), item.name
        assert "nan" not in item.caption + item.alt, item.name


def test_axes_have_units(drawn):
    for name, item in drawn.items():
        labels = [axes.get_xlabel() + axes.get_ylabel() for axes in item.figure.axes]
        labels += [text.get_text() for text in item.figure.texts] + [item.figure.get_supxlabel()]
        assert "(m)" in "".join(labels) or name in ("fig1", "fig2"), name
    assert drawn["fig1"].figure.axes[0].get_xlabel() == "time (s)"
    assert "(dBm)" in drawn["fig2"].figure.axes[0].get_xlabel()


def test_world_marks_starts_and_ends_of_the_runs(robot, drawn):
    position_m = robot.truth["shadowing"]["truth.position_m"][0]
    panels = drawn["world"].figure.axes
    assert len(panels) == RUNS
    for number, axes in enumerate(panels):
        (mark,) = axes.texts
        assert mark.get_text() == f"{number + 1}"
        np.testing.assert_allclose(mark.xy, position_m[number, 0])
        np.testing.assert_allclose(dots(axes, "x"), position_m[number, LENGTHS[number] - 1][None])
    assert "n = 4 to 9 iterations" in drawn["world"].caption


def test_histogram_counts_whole_levels(drawn):
    bars = drawn["fig2"].figure.axes[0].patches
    found = {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in bars}
    assert found == {-62: 1, -61: 2, -60: 3, -58: 1}


def test_curve_marks_every_distance_of_one_level(robot, drawn):
    for axes, family in zip(drawn["fig3"].figure.axes, FAMILIES, strict=True):
        curve_dbm = robot.observed[family]["calibration.rss_dbm"][0]
        level = float(np.median(curve_dbm))
        expected = crossings(np.arange(1.0, 8.0), curve_dbm, level)
        np.testing.assert_allclose(expected, [3 + 2 / 3, 5])
        marks = next(line for line in axes.get_lines() if line.get_marker() == "D")
        np.testing.assert_allclose(marks.get_xdata(), expected)
        np.testing.assert_allclose(marks.get_ydata(), level)
        assert axes.get_title(loc="left") == family


def test_trials_stand_under_the_printed_ones(robot, drawn):
    (axes,) = drawn["table1"].figure.axes
    printed = dots(axes, "D")
    trials = [float(robot.printed(f"table1.trial{run}")) for run in range(1, 7)]
    np.testing.assert_allclose(printed[:, 0], [*trials, 0.948])
    np.testing.assert_allclose(printed[:, 1], range(7))
    shadowing, ambiguity = dots(axes, "o"), dots(axes, "s")
    expected = np.array([*(0.5 + 0.1 * np.arange(1, 7)), 0.85]) + 0.1 * np.mean(range(WORLDS))
    np.testing.assert_allclose(shadowing[:, 0], expected)
    np.testing.assert_allclose(ambiguity[:, 0], expected + 1)
    assert (shadowing[:, 1] < ambiguity[:, 1]).all()


def test_error_over_iterations_is_that_of_run_2_of_the_first_world(robot, drawn):
    for axes, family in zip(drawn["fig5"].figure.axes, FAMILIES, strict=True):
        lines = {line.get_label(): line for line in axes.get_lines()}
        assert set(lines) == {"trilateration_alone", "particle_filter"}
        for row, line in lines.items():
            own = robot.errors(row, family)
            own = own[(own["world"] == 0) & (own["sample"] // EPOCHS == 1)]
            np.testing.assert_array_equal(line.get_xdata(), range(1, LENGTHS[1] + 1))
            np.testing.assert_allclose(line.get_ydata(), own["error_m"])
    assert "run 2" in drawn["fig5"].caption
    assert f"n = {LENGTHS[1]} iterations" in drawn["fig5"].caption


def test_runs_are_compared_with_table_2(drawn):
    iterations, trilaterations, final = drawn["table2"].figure.axes
    np.testing.assert_allclose(dots(iterations, "D")[:, 0], [9, 17, 12, 23, 18, 14, 15.5])
    np.testing.assert_allclose(dots(trilaterations, "D")[:-1, 0], [15.45, 59.06, 13.83, 11.22, 12.60, 21.35])
    np.testing.assert_allclose(dots(final, "D")[:, 0], [0.20, 0.78, 0.30, 0.63, 0.15, 0.50, 0.427])
    np.testing.assert_allclose(dots(iterations, "o")[:-1, 0], np.array(LENGTHS) + 0.15)
    assert [label.get_text() for label in iterations.get_yticklabels()][-1] == "mean"


def test_summary_counts_the_worlds_that_reach_the_printed_mean(robot, drawn):
    (axes,) = drawn["summary"].figure.axes
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert any("2 of 4 worlds at or below 0.427 m" in label for label in lines if "shadowing" in label)
    assert any("0 of 4 worlds at or below 0.427 m" in label for label in lines if "ambiguity" in label)
    values = next(line.get_xdata() for label, line in lines.items() if "shadowing" in label)
    np.testing.assert_allclose(sorted(set(np.asarray(values)[1:])), [0.3, 0.4, 0.5, 0.6])
    unprinted = replace(robot, paper={})
    found = {item.name: item for item in draw(unprinted)}["summary"]
    assert "printed" not in found.caption
    assert "0.427" not in found.alt


def test_rows_stand_with_their_own_task(drawn):
    def rows(name):
        return [label.get_text() for label in drawn[name].figure.axes[0].get_yticklabels()]

    assert rows("ablations") == list(TRACKING)
    assert rows("trilateration") == list(TRILATERATION)
    labels = {line.get_label() for line in drawn["distribution"].figure.axes[0].get_lines()}
    assert labels == set(TRACKING)


def test_controls_far_away_do_not_squeeze_the_rows(drawn):
    for axes in drawn["ablations"].figure.axes:
        assert axes.get_xlim()[1] < 4
        assert any("\N{RIGHTWARDS ARROW}" in text.get_text() for text in axes.texts)


def test_trilateration_shows_the_best_fit_and_all_outputs(robot, drawn):
    axes = drawn["trilateration"].figure.axes[0]
    best = [figures.per_world(robot, "shadowing", row).mean() for row in TRILATERATION]
    outputs = [2 * mean + 0.15 for mean in TRILATERATION.values()]
    np.testing.assert_allclose(dots(axes, "o")[:, 0], best)
    np.testing.assert_allclose(dots(axes, "s")[:, 0], outputs)


def test_heat_map_holds_the_mean_shares_and_the_limit(drawn):
    axes, _ = drawn["convergence"].figure.axes
    assert [text.get_text() for text in axes.texts] == [
        *("90", "96", "\N{EN DASH}", "99.9"),
        *("10", "55", "\N{EN DASH}", "98"),
    ]
    assert axes.get_xlim() == (3, 7)
    red = [line for line in axes.get_lines() if line.get_color() == "#d7191c" and len(line.get_xdata())]
    # The limit of step 0.05 lies left of the classes that occur, that of 0.4 at a distance of 0.2 m.
    assert NEAREST_M[3] == 0.2
    assert [list(line.get_xdata()) for line in red] == [[3.0, 3.0]]
    assert [list(line.get_ydata()) for line in red] == [[1, 2]]
    assert "n = 2 worlds of family shadowing" in drawn["convergence"].caption
    assert "50.0 % at 0.05, 50.0 % at 0.4" in drawn["convergence"].caption


def test_sweeps_have_a_curve_for_each_family(robot, drawn):
    for name in ("particles", "sigma"):
        (axes,) = drawn[name].figure.axes
        lines = [line for line in axes.get_lines() if not line.get_label().startswith("_")]
        assert [line.get_label() for line in lines] == list(FAMILIES)
        assert len(axes.get_lines()) == 3 * len(FAMILIES), "each band has its two ends"
        for family, line in zip(FAMILIES, lines, strict=True):
            own = robot.measures
            own = own[(own["algorithm"] == name) & (own["metric"] == "mean_m") & (own["family"] == family)]
            np.testing.assert_array_equal(line.get_xdata(), SWEEPS[name][1])
            np.testing.assert_allclose(line.get_ydata(), own.groupby("value")["x"].mean())


def test_figures_of_what_was_left_out_are_left_out(robot):
    quick = kept(replace(robot, sweeps={}), lambda m: ~m["algorithm"].isin(SWEEPS))
    assert names(quick) == [name for name in ALL if name not in ("convergence", "particles", "sigma")]
    no_filter = kept(robot, lambda m: ~m["algorithm"].isin(TRACKING))
    left = ("fig5", "summary", "ablations", "distribution")
    assert names(no_filter) == [name for name in ALL if name not in left]
    no_ranging = kept(robot, lambda m: m["algorithm"] != "curve_crossings")
    assert names(no_ranging) == [name for name in ALL if name != "table1"]
    assert len({item.name: item for item in draw(no_ranging)}["table2"].figure.axes) == 2
    alone = kept(robot, lambda m: m["algorithm"].isin(["particle_filter", "particles"]))
    without = ("table1", "trilateration", "convergence", "sigma")
    assert names(alone) == [name for name in ALL if name not in without]


def test_row_that_one_family_lacks_has_a_dot_in_the_other_alone(robot):
    some = kept(robot, lambda m: (m["algorithm"] != "particle_filter_product") | (m["family"] == "shadowing"))
    found = {item.name: item for item in draw(some)}
    shadowing, ambiguity = found["ablations"].figure.axes
    assert len(dots(shadowing, "o")) == len(dots(ambiguity, "o")) + 1
    assert list(found) == ALL


@pytest.mark.filterwarnings("error")
def test_one_family_and_one_world_are_enough(robot):
    single = kept(robot, lambda m: (m["world"] == 0) & (m["family"] == "shadowing"))
    found = {item.name: item for item in draw(single)}
    assert list(found) == ALL
    for item in found.values():
        assert "ambiguity" not in item.caption + item.alt
        assert "single experiments" not in item.caption or item.name in ("particles", "sigma")
        with drawing():
            item.figure.draw_without_rendering()
    bars = [line for line in found["ablations"].figure.axes[0].get_lines() if len(line.get_xdata()) == 2]
    assert bars == []
    assert not any(isinstance(part, LineCollection) for part in found["sigma"].figure.axes[0].collections)


SOLVED = {
    "pseudo_inverse": (-0.5435, 1.2408),
    "iterative_fractional_printed": (1.0306, 0.7756),
    "iterative_absolute": (0.9014, 0.9410),
}


def scenario(rows=SOLVED, paper=PAPER):
    settings = {name: s["value"] for name, s in PAPER["settings"]["bluetooth_scenario"].items()}
    worlds = bluetooth_scenario.simulate(settings, [np.random.default_rng(0)])
    index = {"world": np.arange(1), "seed": np.arange(1)}
    lines = [
        ("figure_4", row, np.nan, 0, metric, x)
        for row, (x_m, y_m) in rows.items()
        for metric, x in (("x_m", x_m), ("y_m", y_m), ("mean_m", 1.0))
    ]
    return StudyResults(
        study="bluetooth_scenario",
        rows=tuple(rows),
        sweeps={},
        measures=pd.DataFrame(lines, columns=MEASURES),
        error_files=(),
        observed={"figure_4": {**index, **worlds.observed}},
        truth={"figure_4": {**index, **worlds.truth}},
        paper=paper,
    )


def test_scenario_shows_circles_solutions_and_printed_points():
    (item,) = draw(scenario())
    assert item.name == "fig4"
    whole, zoom = item.figure.axes
    radii = sorted(patch.radius for patch in whole.patches if hasattr(patch, "radius"))
    np.testing.assert_allclose(radii, [0.752835, 3.07207, 4.4])
    found = {line.get_label(): (line.get_xdata()[0], line.get_ydata()[0]) for line in whole.get_lines()}
    assert {row: found[row] for row in SOLVED} == SOLVED
    np.testing.assert_allclose(found["printed pseudo-inverse"], (-1.2049, 3.7668))
    np.testing.assert_allclose(found["printed iterative"], (1.0306, 0.7756))
    np.testing.assert_allclose(found["true place"], (1.05, 0.79))
    gap = np.hypot(-1.2049 + 0.5435, 3.7668 - 1.2408)
    assert f"lies {gap:.4f} m from that of pseudo_inverse" in item.caption
    assert "pseudo_inverse (\N{MINUS SIGN}0.5435, 1.2408) m" in item.caption
    assert zoom.get_title(loc="left") == "\N{PLUS-MINUS SIGN}0.3 m about the true place"
    for low, high in (zoom.get_xlim(), zoom.get_ylim()):
        assert high - low == pytest.approx(0.6)
    for x, y in SOLVED.values():
        assert whole.get_xlim()[0] < x < whole.get_xlim()[1]
        assert whole.get_ylim()[0] < y < whole.get_ylim()[1]


def test_scenario_without_printed_points_or_rows_is_drawn():
    (item,) = draw(scenario({"iterative_absolute": (0.9, 0.9)}, {}))
    labels = {line.get_label() for line in item.figure.axes[0].get_lines()}
    assert labels == {"beacon", "true place", "iterative_absolute"}
    assert "lies" not in item.caption


def test_recordings_keep_distances_apart_from_positions(tmp_path):
    recordings = ("hall", "roof")
    frames = {
        "path_loss": errors_of(0.9, families=recordings).assign(error_distance_m=1.0),
        "iterative_absolute": errors_of(1.5, families=recordings).assign(error_x_m=1.0, error_y_m=1.0),
        "control_oracle": errors_of(0.5, families=("roof",)).assign(error_x_m=1.0, nees=2.0),
    }
    frames = {row: frame[frame["world"] == 0] for row, frame in frames.items()}
    later = frames["iterative_absolute"]
    frames["iterative_absolute"] = later[later["sample"] > 3]
    paths = [write(tmp_path, "bluetooth_real", row, frame) for row, frame in frames.items()]
    results = StudyResults(
        study="bluetooth_real",
        rows=tuple(frames),
        sweeps={},
        measures=pd.concat([measure(read_row_errors([p])[0], Path(p).parent.name) for p in paths]),
        error_files=tuple(paths),
        observed={name: {} for name in recordings},
        truth={},
    )
    found = {item.name: item for item in draw(results)}
    assert list(found) == [
        *("error_distribution", "mean_error"),
        *("distance_error_distribution", "distance_mean_error"),
    ]
    shown = {
        name: [{line.get_label() for line in axes.get_lines()} for axes in item.figure.axes]
        for name, item in found.items()
    }
    assert shown["error_distribution"] == [{"iterative_absolute"}, {"iterative_absolute", "control_oracle"}]
    assert shown["distance_error_distribution"] == [{"path_loss"}, {"path_loss"}]
    total = sum(LENGTHS)
    titles = [axes.get_title(loc="left") for axes in found["error_distribution"].figure.axes]
    assert titles == [f"hall (n = {total - 4})", f"roof (n = {total - 4} to {total})"]
    for name, item in found.items():
        quantity = "distance" if name.startswith("distance") else "position"
        assert all(f"{quantity} error (m)" in axes.get_xlabel() for axes in item.figure.axes)


def test_rows_of_the_studies_have_strokes_and_variants_share_a_marker():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["studies"]
    for study in ("bluetooth_robot", "bluetooth_scenario", "bluetooth_real"):
        for row, line in config.get(study, {"algorithms": {}})["algorithms"].items():
            assert row in KNOWN
            assert contrast(KNOWN[row].color, "#ffffff") >= 3
            original = (line or {}).get("use", row)
            assert KNOWN[row].marker == KNOWN[original].marker
            assert original == row or KNOWN[row].line != KNOWN[original].line
