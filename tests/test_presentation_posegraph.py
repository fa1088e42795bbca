"""Figures of the pose graphs, from invented answers whose numbers the test knows."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from positioning.evaluation.measures import MEASURES
from positioning.evaluation.results import StudyResults
from positioning.files import read_tree, write_tree
from positioning.geometry import rotated
from positioning.presentation import figures
from positioning.presentation.study_figures import draw
from positioning.presentation.style import drawing, stroke

COSTS = {"dead_reckoning": 123456.0, "levenberg_marquardt": 215.84, "robust_cauchy": 386.6}
STEPS = {"dead_reckoning": 0, "levenberg_marquardt": 17, "robust_cauchy": 1449}
ERRORS_M = {"dead_reckoning": 49.4, "levenberg_marquardt": 35.4, "robust_cauchy": 2.31}
NAMES = ["trajectories_blind", "trajectories_seen", "costs"]


def path_m() -> np.ndarray:
    along = np.linspace(0, 2 * np.pi, 30)
    return np.stack([20 * np.sin(along), 8 * np.cos(along)], axis=-1)


def answer_m(row: str) -> np.ndarray:
    place = list(COSTS).index(row)
    return rotated(path_m() * (1 + 0.05 * place), 0.3 * place) + 5.0 * place


@pytest.fixture
def results(tmp_path: Path) -> StudyResults:
    families = ("blind", "seen")
    lines, paths = [], []
    for row in COSTS:
        for family in families:
            lines += [
                (family, row, np.nan, 0, "cost", COSTS[row]),
                (family, row, np.nan, 0, "iterations", STEPS[row]),
            ]
        lines.append(("seen", row, np.nan, 0, "mean_m", ERRORS_M[row]))
        step = {"world": np.arange(1), "value": np.array(np.nan), "skipped": np.array("")}
        step["estimate.position_m"] = answer_m(row)[None]
        path = tmp_path / row / "00000.npz"
        write_tree(path, {f"{family}/0": step for family in families})
        paths.append(str(path))
    graph = {
        "graph.position_m": path_m()[None] + 3.0,
        "graph.motion": np.zeros((1, 31, 3)),
        "graph.near_from": np.zeros((1, 7), int),
    }
    true_m = path_m()[None].copy()
    true_m[0, 5] = np.nan
    return StudyResults(
        study="posegraph_real",
        rows=(*COSTS, "gtsam_levenberg_marquardt"),
        sweeps={},
        measures=pd.DataFrame(lines, columns=MEASURES),
        error_files=(),
        observed=dict.fromkeys(families, graph),
        truth={
            "blind": {"truth.position_m": np.full((1, 30, 2), np.nan)},
            "seen": {"truth.position_m": true_m},
        },
        estimate_files=tuple(paths),
    )


def lines_of(item: figures.Drawn) -> dict[str, list[np.ndarray]]:
    """What each panel draws, by its title."""
    return {
        axes.get_title(loc="left"): [line.get_xydata() for line in axes.get_lines()]
        for axes in item.figure.axes
        if axes.get_visible()
    }


@pytest.mark.filterwarnings("error")
def test_every_row_that_ran_has_a_panel_with_its_answer(results: StudyResults) -> None:
    found = {item.name: item for item in draw(results)}
    assert list(found) == NAMES
    blind = lines_of(found["trajectories_blind"])
    assert list(blind) == list(COSTS)
    for row, drawn in blind.items():
        np.testing.assert_allclose(drawn[-1], answer_m(row))
        # The start is behind it, but for the row that is the start.
        assert len(drawn) == 1 + (row != "dead_reckoning")
    for item in found.values():
        with drawing():
            item.figure.draw_without_rendering()
    assert "30 poses, 31 motions and 7 pairs" in found["trajectories_blind"].caption
    assert "Nobody knows the true places" in found["trajectories_blind"].caption
    assert "grey: where the search starts" in found["trajectories_blind"].caption
    assert "Nobody" not in found["trajectories_seen"].caption


def test_answers_are_laid_on_the_truth_where_it_is_known(results: StudyResults) -> None:
    found = {item.name: item for item in draw(results)}
    seen = lines_of(found["trajectories_seen"])
    for place, (row, drawn) in enumerate(seen.items()):
        assert len(drawn) == 2
        offset_m = np.linalg.norm(drawn[1] - path_m(), axis=-1).mean()
        # What was turned and shifted comes back; what was stretched stays so.
        assert offset_m == pytest.approx(0.05 * place * np.linalg.norm(path_m(), axis=-1).mean(), abs=0.15)
        assert f"{row} {ERRORS_M[row]:.2f} m" in found["trajectories_seen"].alt


def test_costs_are_drawn_and_written_with_steps_and_known_errors(results: StudyResults) -> None:
    item = draw(results)[-1]
    blind, seen = item.figure.axes
    for axes, known in ((blind, False), (seen, True)):
        assert axes.get_xscale() == "log"
        assert [label.get_text() for label in axes.get_yticklabels()] == list(COSTS)
        dots = [line.get_xdata()[0] for line in axes.get_lines()]
        assert dots == list(COSTS.values())
        texts = [text.get_text() for text in axes.texts]
        assert texts[0] == "123,456, 0 steps" + (", 49.40 m" if known else "")
        assert texts[1] == "215.8, 17 steps" + (", 35.40 m" if known else "")
        assert axes.get_xlim()[1] > 10 * max(dots)
    assert "Costs of seen: dead_reckoning 123,456, 0 steps, 49.40 m" in item.alt
    assert "gtsam" not in item.alt


def test_searches_that_did_not_end_by_themselves_are_hollow_and_told(results: StudyResults) -> None:
    for path in results.estimate_files:
        tree = read_tree(path)
        for family, step in tree.items():
            if "dead_reckoning" not in path:
                step["estimate.extra_converged"] = np.array(["robust" not in path or family == "seen/0"])
        write_tree(path, tree)
    found = {item.name: item for item in draw(results)}
    item = found["costs"]
    blind, seen = item.figure.axes
    for axes, hollow in ((blind, ["robust_cauchy"]), (seen, [])):
        rows = [label.get_text() for label in axes.get_yticklabels()]
        drawn = [
            rows[int(dot.get_ydata()[0])] for dot in axes.get_lines() if dot.get_markerfacecolor() == "white"
        ]
        assert drawn == hollow
        assert [rows[i] for i, text in enumerate(axes.texts) if "(stopped)" in text.get_text()] == hollow
    for name in ("costs", "trajectories_blind"):
        assert "as a rule at the limit of its steps: robust_cauchy in blind." in found[name].caption
    assert "limit of its steps" not in found["trajectories_seen"].caption


def test_a_peer_that_ran_is_drawn_and_one_row_is_enough(results: StudyResults, tmp_path: Path) -> None:
    step = {"world": np.arange(1), "value": np.array(np.nan), "skipped": np.array("")}
    step["estimate.position_m"] = path_m()[None]
    path = tmp_path / "gtsam_levenberg_marquardt" / "00000.npz"
    write_tree(path, {"blind/0": step})
    own = results.measures[results.measures["algorithm"] == "levenberg_marquardt"]
    own = own.assign(algorithm="gtsam_levenberg_marquardt")
    peer = replace(
        results,
        measures=pd.concat([results.measures, own[own["family"] == "blind"]]),
        estimate_files=(*results.estimate_files, str(path)),
    )
    found = {item.name: item for item in draw(peer)}
    assert list(lines_of(found["trajectories_blind"])) == [*COSTS, "gtsam_levenberg_marquardt"]
    assert list(lines_of(found["trajectories_seen"])) == list(COSTS)
    alone = replace(results, measures=results.measures[results.measures["algorithm"] == "dead_reckoning"])
    assert [item.name for item in draw(alone)] == NAMES
    nothing = replace(results, measures=results.measures.iloc[:0])
    assert draw(nothing) == []


def test_each_answer_has_the_colour_of_its_row(results: StudyResults) -> None:
    item = draw(results)[0]
    with drawing(results.rows):
        expected = [stroke(row).color for row in COSTS]
    panels = [axes for axes in item.figure.axes if axes.get_visible()]
    assert [axes.get_lines()[-1].get_color() for axes in panels] == expected
