"""Drawings inside pages, and as PDF."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

EPOCH = 0
"""Seconds since 1970 that a PDF gives as its time: equal contents are equal to the byte."""


def inline_svg(text: str, name: str, alt: str) -> str:
    """Return an SVG file's drawing as it may stand inside a page.

    Declarations and metadata go, because a page needs none; names inside it get the figure's name in
    front, because all figures of a page share one space of names.

    Parameters
    ----------
    text
        The file.
    name
        The figure.
    alt
        What is said to those who cannot see it.
    """
    body = text[text.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>|<!--.*?-->", "", body, flags=re.DOTALL)
    head, rest = body.split(">", 1)
    head = re.sub(r"\s(xmlns(:\w+)?|width|height|version)=\"[^\"]*\"", "", head)
    rest = rest.replace("xlink:href=", "href=")
    rest = re.sub(r"\bid=\"([^\"]+)\"", rf'id="{name}-\1"', rest)
    rest = re.sub(r"href=\"#([^\"]+)\"", rf'href="#{name}-\1"', rest)
    rest = re.sub(r"url\(#([^)]+)\)", rf"url(#{name}-\1)", rest)
    rest = re.sub(r"\n\s*", "\n", rest)
    return f'{head} role="img" aria-label="{_attribute(alt)}">{rest.strip()}'


def _attribute(text: str) -> str:
    marks: Mapping[str, str] = {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;"}
    return "".join(marks.get(letter, letter) for letter in text)


def compact(text: str, digits: int = 2) -> str:
    """Return an SVG file of Matplotlib in fewer bytes, which looks the same and is whole by itself.

    Coordinates keep ``digits`` decimals of a point, finer than print; comments, metadata, names that
    nothing refers to and spaces that mean nothing go; the names that stay are numbers in their order.

    Parameters
    ----------
    text
        The file.
    digits
        Decimals of coordinates.
    """
    text = _UNSEEN.sub("", text)
    text = _PLACED.sub(lambda found: _NUMBER.sub(lambda n: _rounded(n[0], digits), found[0]), text)
    text = _PATH.sub(lambda found: f' d="{_joined(found[1])}"', text)
    text = _STYLE.sub(lambda found: _MARK.sub(r"\1", found[0]), text)
    used = {name: f"p{place}" for place, name in enumerate(dict.fromkeys(_USED.findall(text)))}
    text = _ID.sub(lambda found: f' id="{used[found[1]]}"' if found[1] in used else "", text)
    text = _USED.sub(lambda found: f"#{used[found[1]]}", text)
    return re.sub(r">\s+<", "><", text).strip() + "\n"


def svg_to_pdf(text: str, title: str) -> bytes:
    """Return an SVG file of Matplotlib as a PDF of the same size, with its fonts embedded.

    Typst cuts fonts to the letters that are used in milliseconds, where Matplotlib's own PDF takes a third
    of a second a figure.

    Parameters
    ----------
    text
        The file, its letters as text (``svg.fonttype: none``) in the fonts that come with Matplotlib.
    title
        The title that the PDF tells.
    """
    import typst  # of 30 MB: who only puts drawings into pages does not wait for it

    source: Any = _ONE_DRAWING  # typst's own types know paths alone
    pdf: bytes = typst.compile(
        source,
        sys_inputs={"drawing": text, "title": title},
        font_paths=_fonts(),
        format="pdf",
        timestamp=datetime.fromtimestamp(EPOCH, UTC),
    )
    return pdf


@cache
def _fonts() -> Any:
    import matplotlib as mpl
    import typst

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    return typst.Fonts(include_system_fonts=False, include_embedded_fonts=False, font_paths=[str(folder)])


_ONE_DRAWING = b"""#set document(title: sys.inputs.title)
#set page(width: auto, height: auto, margin: 0pt, fill: none)
#image(bytes(sys.inputs.drawing), format: "svg")
"""
_UNSEEN = re.compile(r"<metadata>.*?</metadata>|<!--.*?-->|<!DOCTYPE.*?>", re.DOTALL)
_NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
_PLACED = re.compile(r"\s(?:d|x|y|x1|x2|y1|y2|width|height|points)=\"[^\"]*\"|(?:translate|rotate)\([^)]*\)")
_PATH = re.compile(r"\sd=\"([^\"]*)\"")
_STYLE = re.compile(r"\sstyle=\"([^\"]*)\"")
_MARK = re.compile(r"([:;]) ")
_ID = re.compile(r"\sid=\"([^\"]*)\"")
_USED = re.compile(r"(?:(?<=href=\")|(?<=url\())#([^\")]+)")


def _rounded(number: str, digits: int) -> str:
    text = f"{float(number):.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _joined(path: str) -> str:
    """Return a path without spaces that mean nothing: a letter ends a number."""
    return re.sub(r" ?([A-Za-z]) ?", r"\1", " ".join(path.split()))
