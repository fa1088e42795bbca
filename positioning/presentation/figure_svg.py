"""Figures as SVG: once with letters as paths, once as text."""

import io
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure

POINTS_AN_INCH = 72
"""The unit of SVG files is the point."""


def draw_svg(figure: Figure) -> tuple[str, str]:
    """Return a figure as two SVG files: with its letters as paths, and with its letters as text.

    Paths look the same where the fonts are missing, as in a page; text can be searched and copied, as in a
    PDF. The figure is laid out and drawn once for both, in half the time of two calls of ``savefig``.

    Parameters
    ----------
    figure
        The figure. It keeps its size; its resolution becomes that of SVG.
    """
    # The layout measures letters as the canvas would draw them, so it must be the one of SVG.
    FigureCanvasSVG(figure)
    dots_an_inch, figure.dpi = figure.dpi, POINTS_AN_INCH
    figure.set_facecolor(mpl.rcParams["savefig.facecolor"])
    width, height = figure.get_size_inches()
    file = io.StringIO()
    vectors = _BothLetters(width * POINTS_AN_INCH, height * POINTS_AN_INCH, file, dots_an_inch)
    # What asks for it, as a bar of colours does, becomes a picture.
    renderer: Any = MixedModeRenderer(figure, width, height, dots_an_inch, vectors)  # type: ignore[no-untyped-call]
    figure.draw(renderer)
    renderer.finalize()
    whole, paths, letters, last = file.getvalue(), [], [], 0
    for start, middle, end in vectors.places:
        paths.append(whole[last:middle])
        letters += [whole[last:start], whole[middle:end]]
        last = end
    return "".join([*paths, whole[last:]]), "".join([*letters, whole[last:]])


class _BothLetters(RendererSVG):
    """Writes every text twice, as paths and as text.

    Attributes
    ----------
    places
        For each text, where in the file the paths start, where the text starts, and where it ends.
    """

    def __init__(self, width: float, height: float, file: io.StringIO, dots_an_inch: float) -> None:
        nothing = {"Date": None, "Creator": None}  # equal figures give equal bytes
        super().__init__(width, height, file, image_dpi=dots_an_inch, metadata=nothing)  # type: ignore[no-untyped-call]
        self.places: list[tuple[int, int, int]] = []
        self._file = file

    def draw_text(self, *args: Any, **settings: Any) -> None:
        # A tag that is still open ends before the place is noted.
        self.writer.comment("")  # type: ignore[no-untyped-call]
        start = self._file.tell()
        self._draw_letters("path", *args, **settings)
        middle = self._file.tell()
        self._draw_letters("none", *args, **settings)
        self.places.append((start, middle, self._file.tell()))

    def _draw_letters(self, kind: str, *args: Any, **settings: Any) -> None:
        # Not `rc_context`, which copies all settings for each text.
        before = mpl.rcParams["svg.fonttype"]
        mpl.rcParams["svg.fonttype"] = kind
        try:
            super().draw_text(*args, **settings)  # type: ignore[no-untyped-call]
        finally:
            mpl.rcParams["svg.fonttype"] = before
