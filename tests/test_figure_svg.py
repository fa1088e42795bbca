"""Figures as SVG: drawn once, with letters as paths and as text."""

import io

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from positioning.presentation.figure_svg import draw_svg
from positioning.presentation.style import drawing
from positioning.presentation.svg import compact


def figure() -> Figure:
    """Lines, a rasterised mesh with its bar of colours, hatches, a clipped text, formulas, equal axes."""
    made = Figure(figsize=(5, 4), layout="constrained")
    left, right = made.subplots(1, 2)
    left.plot([0, 1, 2], [1, 0, 3], "o-", label="a line $x^2$")
    left.bar([0, 1], [1, 2], hatch="//", alpha=0.5)
    left.text(0.5, 2.5, "clipped < & >", clip_on=True, rotation=30)
    left.set_xlabel("a length (m)")
    left.legend()
    mesh = right.pcolormesh(np.arange(12.0).reshape(3, 4), rasterized=True)
    right.set_aspect("equal")
    right.set_title("Écart-type")
    made.colorbar(mesh, ax=right)
    return made


def as_matplotlib_writes(letters: str) -> str:
    text = io.StringIO()
    with mpl.rc_context({"svg.fonttype": letters}):
        figure().savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return text.getvalue()


@pytest.mark.parametrize(("letters", "place"), [("path", 0), ("none", 1)])
def test_both_files_are_those_of_two_calls_of_savefig(letters: str, place: int) -> None:
    with drawing():
        ours, theirs = draw_svg(figure())[place], as_matplotlib_writes(letters)
        assert mpl.rcParams["svg.fonttype"] == "path"
    assert "data:image/png" in theirs
    assert ("<text" in theirs) == (letters == "none")
    assert compact(ours) == compact(theirs)


def test_equal_figures_give_equal_bytes() -> None:
    with drawing():
        assert draw_svg(figure()) == draw_svg(figure())
