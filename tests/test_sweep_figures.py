"""The figure that a sweep gets where a study's own figures do not show it."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from positioning.evaluation.measures import MEASURES
from positioning.evaluation.results import StudyResults
from positioning.presentation import figures
from positioning.presentation.families import Study
from positioning.presentation.figures import Drawn
from positioning.presentation.sweep_figures import others, sweep_figure

K = (1.0, 4.0, 10.0)
FLOOR_M, HALL_M = (3.0, 2.0, 4.0), (2.5, 2.6, 2.7)
FEW = np.asarray([0.1, -0.1, 0.0])


def study(
    families: dict[str, int], *, sweeps: dict[str, tuple[float, ...]] | None = None, metric: str = "mean_m"
) -> Study:
    """A study with one row and sweeps whose means are known: worlds by family."""
    sweeps = {"neighbours": K} if sweeps is None else sweeps
    lines = []
    for number, (family, worlds) in enumerate(families.items()):
        for world in range(worlds):
            off = FEW[world % 3] if worlds > 1 else 0.0
            lines.append((family, "knn", np.nan, world, metric, 1.0))
            for sweep, values in sweeps.items():
                levels = np.resize(HALL_M if number % 2 else FLOOR_M, len(values))
                lines += [
                    (family, sweep, value, world, metric, level + off)
                    for value, level in zip(values, levels, strict=True)
                ]
    results = StudyResults(
        study="corridor",
        rows=("knn",),
        sweeps={sweep: ("k", values) for sweep, values in sweeps.items()},
        measures=pd.DataFrame(lines, columns=MEASURES),
        error_files=(),
        observed={family: {} for family in families},
        truth={},
    )
    return Study.of(results)


def only(found: list[Drawn]) -> Drawn:
    (item,) = found
    return item


def test_a_sweep_that_no_figure_shows_gets_one() -> None:
    found = others(study({"floor": 6}, sweeps={"neighbours": K, "power": (1.0, 2.0)}), [])
    assert [(item.name, item.sweeps) for item in found] == [
        ("sweep_neighbours", ("neighbours",)),
        ("sweep_power", ("power",)),
    ]


def test_a_sweep_that_a_figure_shows_is_not_drawn_again() -> None:
    made = study({"floor": 6}, sweeps={"neighbours": K, "power": (1.0, 2.0)})
    own = Drawn("fig2", figures.new_figure(1), "t", "c", "a", sweeps=("neighbours",))
    assert [item.sweeps for item in others(made, [own])] == [("power",)]


def test_curves_are_means_over_worlds_and_words_tell_them() -> None:
    item = only(others(study({"floor": 6, "hall": 6}), []))
    (axes,) = item.figure.axes
    curves = {str(line.get_label()): line for line in axes.get_lines()}
    assert_allclose(curves["floor"].get_xdata(), K)
    assert_allclose(curves["floor"].get_ydata(), FLOOR_M)
    assert_allclose(curves["hall"].get_ydata(), HALL_M)
    assert axes.get_xlabel() == "k"
    for text in (item.caption, item.alt):
        assert "floor: 3.00 m at 1, 2.00 m at 4, 4.00 m at 10; smallest at 4" in text
    assert "n = 6 of floor and 6 of hall; bands: central 71 % of single experiments" in item.caption


def test_bands_of_fewer_worlds_have_their_own_coverage() -> None:
    item = only(others(study({"floor": 39, "hall": 6}), []))
    assert "n = 39 of floor and 6 of hall; bands: central 95 %" in item.caption
    assert "(hall: central 71 %)" in item.caption


@pytest.mark.parametrize(
    ("families", "words"),
    [({"floor": 1}, "against k, in one world."), ({"a": 1, "b": 1}, "against k, one world a family.")],
)
def test_one_world_has_no_band(families: dict[str, int], words: str) -> None:
    item = only(others(study(families), []))
    assert not item.figure.axes[0].collections
    assert words in item.caption
    assert "experiments" not in item.caption


def test_many_families_stand_in_panels_in_which_each_has_its_look() -> None:
    item = only(others(study({f"site_{number}": 2 for number in range(6)}), []))
    shown = [[line for line in axes.get_lines() if line.get_marker() != "None"] for axes in item.figure.axes]
    assert [len(lines) for lines in shown] == [4, 2]
    assert all(len({line.get_color() for line in lines}) == len(lines) for lines in shown)


@pytest.mark.parametrize(
    ("values", "scale"), [((1.0, 4.0, 10.0), "linear"), ((1.0, 30.0), "log"), ((0.0, 30.0), "linear")]
)
def test_settings_far_apart_stand_on_a_logarithmic_axis(values: tuple[float, ...], scale: str) -> None:
    (axes,) = only(others(study({"floor": 2}, sweeps={"s": values}), [])).figure.axes
    assert axes.get_xscale() == scale
    assert_allclose(axes.get_xticks(), values)


def test_what_was_not_measured_is_not_drawn() -> None:
    assert others(study({"floor": 2}, metric="rmse_m"), []) == []
    assert sweep_figure(study({"floor": 2}), "power", "power", label="p", title="t") is None


def test_a_note_stands_in_the_caption() -> None:
    item = sweep_figure(study({"floor": 2}), "neighbours", "n", label="k", title="t", note="Not printed.")
    assert item is not None
    assert ". Not printed. floor: 3.00 m" in item.caption
