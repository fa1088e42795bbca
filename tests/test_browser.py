"""The pages in a real browser: a headless Chromium shows them without network and works their tables.

Pages of a small invented study are made here. ``REPOSITION_PAGES`` names a folder of pages that a build has
written, such as ``reports/quick``; then these are looked at, too.
"""

import html
import io
import json
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import pytest
from conftest import CHROMIUM
from test_comparison import built as comparison_built  # noqa: F401 - fixtures
from test_comparison import compared  # noqa: F401
from test_presentation import built as study_built  # noqa: F401

ROOT = Path(__file__).resolve().parents[1]
HARNESS = Path(__file__).with_name("browser.js")
WIDTHS = (1280, 390)
"""Pixels of a desk's screen and of a phone's."""

LARGEST_PAGE = 3_000_000
SHOT_HEIGHT = 1000
BUILT = os.environ.get("REPOSITION_PAGES")

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium (or google-chrome) is not installed"),
    pytest.mark.xdist_group("browser"),
]


@dataclass(frozen=True)
class Seen:
    """What a browser made of some pages: what is wrong by page, console lines, and requests."""

    pages: dict[str, dict[str, Any]]
    console: list[str]
    requests: list[str]


def chromium(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Start the browser with a profile of its own; no name is resolved, so nothing outside is reached."""
    command = [
        str(CHROMIUM),
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-background-networking",
    ]
    command += ["--host-resolver-rules=MAP * ~NOTFOUND", "--allow-file-access-from-files", "--no-first-run"]
    command += [f"--user-data-dir={folder / 'profile'}", "--hide-scrollbars", "--virtual-time-budget=60000"]
    return subprocess.run(
        [*command, *arguments], capture_output=True, text=True, encoding="utf-8", check=True, timeout=120
    )


def look_at(pages: list[Path], folder: Path) -> Seen:
    """Show pages in frames, one after the other, and read what the harness finds."""
    folder.mkdir(parents=True, exist_ok=True)
    asked = {"pages": [page.resolve().as_uri() for page in pages], "widths": WIDTHS}
    outer = folder / "harness.html"
    outer.write_text(
        '<!doctype html><meta charset="utf-8"><title>harness</title>'
        f'<body><script type="application/json" id="asked">{json.dumps(asked)}</script>'
        f"<script>{HARNESS.read_text(encoding='utf-8')}</script></body>",
        encoding="utf-8",
    )
    net = folder / "net.json"
    done = chromium(
        folder, "--enable-logging=stderr", "--v=0", f"--log-net-log={net}", "--dump-dom", outer.as_uri()
    )
    answer = re.search(r'<pre id="told">(.*)</pre>', done.stdout, flags=re.DOTALL)
    assert answer, done.stdout[-2000:] + done.stderr[-4000:]
    told = json.loads(html.unescape(answer[1]))
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    inside = [name for found in told.values() for name in found["requests"]]
    return Seen(
        {Path(unquote(urlsplit(name).path)).name: found for name, found in told.items()},
        console,
        sorted({name for name in [*inside, *asked_by_pages(net)] if urlsplit(name).scheme != "data"}),
    )


def asked_by_pages(net: Path) -> list[str]:
    """Requests in the browser's own log that some page made; the browser's own have no origin."""
    log = json.loads(net.read_text(encoding="utf-8"))
    start = log["constants"]["logEventTypes"]["URL_REQUEST_START_JOB"]
    made = [event["params"] for event in log["events"] if event["type"] == start and "params" in event]
    return [params["url"] for params in made if params.get("initiator", "not an origin") != "not an origin"]


def unresolved(seen: Seen, folder: Path) -> list[str]:
    """Links that lead nowhere: to a file that is not there, or to a name that its page does not have."""
    wrong = []
    for page, found in seen.pages.items():
        for link in found["links"]:
            name, _, anchor = unquote(link).partition("#")
            file = name.partition("?")[0] or page
            if urlsplit(link).scheme or link.startswith("//"):
                wrong.append(f"{page}: {link} leads outside")
            elif not (folder / file).is_file():
                wrong.append(f"{page}: {link} is no file")
            elif anchor and file in seen.pages and anchor not in seen.pages[file]["ids"]:
                wrong.append(f"{page}: {link} is no place on that page")
    return wrong


def screens(pages: list[Path], folder: Path, *arguments: str) -> list[np.ndarray[Any, Any]]:
    """Pictures of the tops of pages, desk beside phone: grey values, one array a page."""
    image = pytest.importorskip("PIL.Image")
    folder.mkdir(parents=True, exist_ok=True)
    frames = "".join(
        f'<div style="height:{SHOT_HEIGHT}px;white-space:nowrap;overflow:hidden">'
        + "".join(
            f'<iframe src="{page.resolve().as_uri()}" style="width:{w}px;height:{SHOT_HEIGHT}px;border:0">'
            "</iframe>"
            for w in WIDTHS
        )
        + "</div>"
        for page in pages
    )
    outer = folder / "screens.html"
    outer.write_text(f'<!doctype html><body style="margin:0">{frames}</body>', encoding="utf-8")
    shot = folder / "screens.png"
    size = f"--window-size={sum(WIDTHS)},{SHOT_HEIGHT * len(pages)}"
    chromium(folder, *arguments, size, f"--screenshot={shot}", outer.as_uri())
    grey = np.asarray(image.open(io.BytesIO(shot.read_bytes())).convert("L"), dtype=float)
    return [grey[SHOT_HEIGHT * i : SHOT_HEIGHT * (i + 1)] for i in range(len(pages))]


def written_by_hand(folder: Path, body: str, name: str = "page.html") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / name
    page.write_text(f"<!doctype html><meta charset='utf-8'><title>t</title><body>{body}", encoding="utf-8")
    return page


@pytest.fixture(scope="module")
def invented(study_built, comparison_built, tmp_path_factory):  # noqa: F811
    """A folder with all kinds of pages, of invented numbers."""
    folder = tmp_path_factory.mktemp("pages")
    for name, text in study_built.items():
        if name.endswith((".html", ".csv", ".md")):
            (folder / name).write_text(text, encoding="utf-8")
    (folder / "comparison.html").write_text(comparison_built[1], encoding="utf-8")
    # What pages link to and no fixture makes: the report on paper, and pages of the compared studies.
    (folder / "reposition.pdf").write_bytes(b"")
    for name in ("rooms", "halls"):
        drawing = "<svg role='img' aria-label='a square' width='9' height='9'></svg>"
        written_by_hand(folder, f"{drawing}<p id='figures'>of {name}", f"{name}.html")
    return folder


def folders() -> list[Any]:
    return ["invented", *([BUILT] if BUILT else [])]


@pytest.fixture(scope="module", params=folders())
def folder(request):
    return request.getfixturevalue("invented") if request.param == "invented" else Path(request.param)


@pytest.fixture(scope="module")
def seen(folder, tmp_path_factory):
    return look_at(sorted(folder.glob("*.html")), tmp_path_factory.mktemp("seen"))


def test_pages_have_nothing_wrong(seen):
    assert {page: found["wrong"] for page, found in seen.pages.items() if found["wrong"]} == {}


def test_the_console_is_silent_and_nothing_outside_is_asked_for(seen):
    assert seen.console == []
    assert seen.requests == []


def test_tables_to_work_and_drawings_are_there(seen):
    assert seen.pages["claims.html"]["sortable"] >= 1
    assert seen.pages["comparison.html"]["sortable"] >= 1
    assert all(found["drawings"] for page, found in seen.pages.items() if page not in ("method.html",))


def test_every_link_leads_somewhere(seen, folder):
    assert unresolved(seen, folder) == []


def test_pages_are_small(folder):
    sizes = {page.name: page.stat().st_size for page in folder.glob("*.html")}
    assert max(sizes.values()) < LARGEST_PAGE, sizes


def test_pages_are_not_blank_by_day_and_by_night(folder, tmp_path):
    pages = [folder / name for name in ("index.html", "claims.html", "comparison.html")]
    day = screens(pages, tmp_path / "day")
    night = screens(pages, tmp_path / "night", "--blink-settings=preferredColorScheme=0")
    for page, light, dark in zip(pages, day, night, strict=True):
        for first, last in ((0, WIDTHS[0]), (WIDTHS[0], sum(WIDTHS))):
            inked = np.abs(light[:, first:last] - np.median(light[:, first:last])) > 60
            assert 0.005 < inked.mean() < 0.6, (page.name, first, inked.mean())
            assert np.median(light[:, first:last]) > 200 > 60 > np.median(dark[:, first:last]), page.name


def test_what_is_wrong_is_found(tmp_path):
    bad = written_by_hand(
        tmp_path / "bad",
        '<script>console.error("oops"); fetch("http://elsewhere.invalid/x").catch(() => 0)</script>'
        "<script>no_such()</script>"
        '<img src="gone.png"><svg role="img" aria-label="a"><use href="#nothing"/></svg>'
        '<a href="gone.html">a</a><a href="#gone">b</a><a href="http://x.invalid">c</a>'
        '<p style="width:600px">wide</p>'
        '<table class="sortable" id="t"><thead><tr><th data-sort="number">n</th></tr></thead>'
        "<tbody><tr><td>2</td></tr><tr><td>1</td></tr></tbody></table>",
    )
    seen = look_at([bad], tmp_path / "seen")
    wrong = " | ".join(seen.pages["page.html"]["wrong"])
    for found in ("390 px: wider", "nothing is drawn at #nothing", "did not load", "no button"):
        assert found in wrong
    assert any("oops" in line for line in seen.console)
    assert any("no_such" in line for line in seen.console)
    assert "http://elsewhere.invalid/x" in seen.requests
    assert len(unresolved(seen, bad.parent)) == 3


DAMAGE = {
    "descending ? compare(b, a)": ("descending ? compare(a, b)", "not descending"),
    "return (a === null) - (b": ("return (b === null) - (a", "empty cells are not last"),
    "row.hidden = !(": ("row.hidden = !!(", "rows are shown and"),
    "`${shown} of": ("`${shown + 1} of", "told"),
    '/\\u2212/g, "-"': ('/\\u2212/g, ""', "not ascending"),
}
"""Ways to break the script of the tables, and how each is noticed."""


def test_a_script_that_sorts_or_filters_wrongly_is_found(tmp_path):
    script = (ROOT / "positioning/presentation/templates/sort.js").read_text(encoding="utf-8")
    assert all(script.count(before) == 1 for before in DAMAGE)
    rows = [("b", "x", "2"), ("a", "y", "10"), ("d", "x", "\N{EN DASH}"), ("c", "y", "\N{MINUS SIGN}3")]
    table = (
        '<select data-filter="kind" data-table="t"><option value="">all</option><option>x</option></select>'
        '<input type="search" data-table="t"><output data-count="t"></output><table class="sortable" id="t">'
        '<thead><tr><th data-sort="text">name</th><th data-sort="number">size</th></tr></thead><tbody>'
        + "".join(f'<tr data-kind="{kind}"><td>{name}</td><td>{size}</td></tr>' for name, kind, size in rows)
        + "</tbody></table>"
    )
    scripts = [script, *(script.replace(before, after) for before, (after, _) in DAMAGE.items())]
    seen = look_at(
        [
            written_by_hand(tmp_path, f"{table}<script>{text}</script>", f"{place}.html")
            for place, text in enumerate(scripts)
        ],
        tmp_path / "seen",
    )
    assert seen.pages["0.html"]["wrong"] == []
    for place, (_, found) in enumerate(DAMAGE.values(), start=1):
        assert any(found in line for line in seen.pages[f"{place}.html"]["wrong"]), found
