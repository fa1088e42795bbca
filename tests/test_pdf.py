"""The report on paper, drawings in few bytes, captions of the provenance report, tables for LaTeX."""

import dataclasses
import html
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_report_pages import FOUND, chapter

from positioning.errors import InputError
from positioning.presentation import pdf, tables
from positioning.presentation.captions import Captions, escaped, label
from positioning.presentation.figures import Drawn, save
from positioning.presentation.style import drawing
from positioning.presentation.svg import compact

ROOT = Path(__file__).resolve().parents[1]
MANIFEST = {"commit": "0abc", "dirty": True, "packages": {"numpy": "2"}, "seconds_by_rule": {"run": 7}}


def drawn(name: str, points: int = 4000) -> Drawn:
    """A figure with lines, markers, a filled band and text."""
    with drawing():
        figure = Figure(figsize=(4, 3), layout="constrained")
        axes = figure.subplots()
        place = np.linspace(0, 1, points)
        axes.plot(place, np.sin(20 * place), label="line")
        axes.plot(place[::400], place[::400], "o", label="markers")
        axes.fill_between(place, place, place + 0.1, alpha=0.3)
        axes.set_xlabel("a length (m)")
        axes.legend()
    return Drawn(name, figure, "A {line} of *stars*", "n = 3 places_", "three `points`")


def as_matplotlib_writes(item: Drawn) -> str:
    text = io.StringIO()
    with drawing():
        item.figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return text.getvalue()


def picture(svg: str) -> bytes:
    """An SVG as Typst draws it, in few pixels."""
    import typst

    source = (
        b'#set page(width: auto, height: auto, margin: 0pt)\n#image(bytes(sys.inputs.svg), format: "svg")'
    )
    made = typst.compile(source, sys_inputs={"svg": svg}, format="png", ppi=100.0, ignore_system_fonts=True)
    return made if isinstance(made, bytes) else made[0]


def test_a_compact_drawing_looks_the_same_in_far_fewer_bytes() -> None:
    image = pytest.importorskip("PIL.Image")
    text = as_matplotlib_writes(drawn("fig1"))
    short = compact(text)
    assert len(short) < 0.7 * len(text)
    first, second = (
        np.asarray(image.open(io.BytesIO(picture(svg))).convert("L"), float) for svg in (text, short)
    )
    assert first.shape == second.shape
    assert first.std() > 10
    # A step of the renderer's grey is a quarter of a pixel; one decimal less makes it 0.27 and more.
    assert np.abs(first - second).max() <= 64
    assert np.abs(first - second).mean() < 0.1


def test_a_compact_drawing_keeps_what_is_referred_to_and_nothing_else() -> None:
    short = compact(as_matplotlib_writes(drawn("fig1")))
    used = re.findall(r"href=\"#([^\"]+)\"|url\(#([^)]+)\)", short)
    names = re.findall(r"\bid=\"([^\"]+)\"", short)
    assert names
    assert len(names) == len(set(names))
    assert set(names) == {first or second for first, second in used}
    assert "<!--" not in short
    assert "<metadata" not in short
    assert re.search(r"(?<![.\d])\d+\.\d{3,}", re.sub(r"(scale|opacity|style)[^/>]*", "", short)) is None


def test_scales_and_styles_are_not_rounded() -> None:
    text = '<svg><g id="unused"><path id="a" d="M 1.23456 -0.001 \nL 2 3.999\nz" transform="scale(0.015625)"'
    text += ' style="stroke-width: 0.125; fill: none"/><use href="#a" x="0.0049"/></g></svg>'
    assert compact(text) == (
        '<svg><g><path id="p0" d="M1.23 0L2 4z" transform="scale(0.015625)"'
        ' style="stroke-width:0.125;fill:none"/><use href="#p0" x="0"/></g></svg>\n'
    )


def test_saved_figures_repeat_to_the_byte_and_hold_their_fonts(tmp_path: Path) -> None:
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        save([drawn("fig1")], tmp_path / name)
    files = {path.name: path.read_bytes() for path in (tmp_path / "first").iterdir()}
    assert files == {path.name: path.read_bytes() for path in (tmp_path / "second").iterdir()}
    assert files.keys() == {"fig1.svg", "fig1.pdf", "captions.json"}
    assert b"/FontFile2" in files["fig1.pdf"]
    assert b"DejaVuSans" in files["fig1.pdf"]
    assert b"/Type3" not in files["fig1.pdf"]


def test_two_figures_of_one_name_are_refused_before_any_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="figure fig1: two figures have this name"):
        save([drawn("fig1"), drawn("fig2"), drawn("fig1")], tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_figures_pdf_looks_like_its_svg_in_the_same_size(tmp_path: Path) -> None:
    """The SVG has outlines of letters, which need no font: each letter stands at its place in the PDF."""
    image = pytest.importorskip("PIL.Image")
    import typst

    save([drawn("fig1", points=200)], tmp_path)
    seen = []
    for kind in ("svg", "pdf"):
        source = f'#set page(width: auto, height: auto, margin: 0pt, fill: white)\n#image("fig1.{kind}")'
        (tmp_path / f"{kind}.typ").write_text(source)
        made = typst.compile(str(tmp_path / f"{kind}.typ"), format="png", ppi=72.0)
        shot = image.open(io.BytesIO(made if isinstance(made, bytes) else made[0])).convert("L")
        seen.append(np.asarray(shot, dtype=float))
    svg, made_pdf = seen
    assert svg.shape == made_pdf.shape
    assert np.mean(np.abs(svg - made_pdf) > 64) < 0.001
    assert np.mean(svg < 128) > 0.005


def test_the_report_has_bookmarks_fonts_and_a_time_that_is_given(tmp_path: Path) -> None:
    one = chapter(tmp_path / "figures" / "first_study")
    made = pdf.report_pdf([one], MANIFEST)
    assert b"/Outlines" in made
    assert b"/FontFile" in made
    assert b"D:1970" in made
    assert b"D:2001" in pdf.report_pdf([one], MANIFEST, 10**9)
    assert len(made) < 1_000_000


def test_the_report_counts_every_claim_once(tmp_path: Path) -> None:
    one = chapter(tmp_path / "figures" / "first_study")
    data = pdf.report_data([one], MANIFEST, one.figures.parent)
    (line,) = data["matrix"]
    assert line["name"] == "First"
    assert line["total"] == sum(cell["count"] for cell in line["cells"]) == len(FOUND["first"])
    assert [cell["verdict"] for cell in line["cells"]] == data["verdicts"]
    assert sum(count for _, count in data["groups"]) == len(data["verdicts"])
    assert len(data["chapters"][0]["claims"]) == len(FOUND["first"])
    assert json.dumps(data)


def test_a_report_of_nothing_is_named() -> None:
    with pytest.raises(InputError, match="has no study"):
        pdf.report_pdf([], {})


def test_the_report_tells_main_claims_settings_and_the_comparison(tmp_path: Path) -> None:
    one = chapter(tmp_path / "figures" / "first_study")
    other = chapter(tmp_path / "comparison")
    claims = [{**claim, "main": number == 0} for number, claim in enumerate(one.paper["claims"])]
    settings = {
        "points": {"value": 257, "unit": "places", "where": "section `6`"},
        "noise_db": {"value": 4.5, "unit": "dB", "assumed": True, "why": "not <printed>"},
    }
    readings = [{"equation": "Eq. 1", "problem": "`x` or y", "used": "x"}]
    paper = {
        **one.paper,
        "claims": claims,
        "settings": {one.study: settings},
        "readings": {one.study: readings},
    }
    plan = {**one.plan, "families": {"floor": {"points": 257, "noise_db": 4.5}}}
    step = {"setting": "noise_db", "family": None, "value": 3.25}
    told = dataclasses.replace(one, paper=paper, plan=plan, calibration=[step])
    data = pdf.report_data([told], MANIFEST, tmp_path, other.figures)
    (mains,) = data["mains"]
    assert (mains["paper"], len(mains["lines"])) == ("First", 1)
    grids = data["chapters"][0]["settings"]
    texts = [[[cell["text"] for cell in line] for line in grid["lines"]] for grid in grids]
    assert texts == [
        [["points", "257 places", "section 6", "\N{EN DASH}"]],
        [["noise_db", "4.5 dB", "not <printed>", "3.25, calibrated"]],
        [["Eq. 1", "x or y", "x", "\N{EN DASH}"]],
    ]
    assert [figure["path"] for figure in data["comparison"]] == ["/comparison/fig1.pdf"]
    assert pdf.report_pdf([told], MANIFEST, comparison=other.figures).startswith(b"%PDF-")


def test_all_accepted_claims_are_plain_latex() -> None:
    ledger = tables.read_table(ROOT / "tests/golden/claims.csv")
    text = pdf.ledger_latex(ledger, {})
    assert text.isascii()
    rows = [line for line in text.splitlines() if line.startswith("\\texttt{")]
    assert len(rows) == len(ledger)
    assert {len(re.findall(r"(?<!\\)&", row)) for row in rows} == {6}


def test_captions_are_those_that_were_written_and_start_no_job_again(tmp_path: Path) -> None:
    before = Captions(str(tmp_path))
    shown = repr(before)
    assert before.title("fig1") == "fig1"
    assert before.caption("fig1") == before.alt("fig1") == ""
    save([drawn("fig1")], tmp_path)
    assert before.title("fig1") == "A {line} of *stars*"
    assert before.heading("fig1") == "A {line} of \\*stars\\*"
    assert before.caption("fig1") == "n = 3 places\\_"
    assert before.alt("fig1") == "three \\`points\\`"
    assert repr(before) == shown
    assert label(before.title("fig1")) == "A (line) of *stars*"


@pytest.mark.parametrize("text", ["a_ *b* `c` |d| [e]_ <f>", "1 * 2 ** 3", "`x <y>`__", "\\back"])
def test_escaped_text_is_shown_as_it_is(text: str) -> None:
    from docutils.core import publish_doctree

    shown = publish_doctree(escaped(text), settings_overrides={"report_level": 5})
    assert shown.astext() == text


def test_every_caption_file_of_the_provenance_report_is_used_and_there() -> None:
    rules = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "workflow/rules").glob("*.smk"))
    named = set(re.findall(r"\.\./report/(\w+\.rst)", rules))
    assert named == {path.name for path in (ROOT / "workflow/report").iterdir()}


@pytest.mark.slow
@pytest.mark.xdist_group("workflow")
def test_the_provenance_report_tells_every_figure_table_and_claim(copy) -> None:
    copy.snakemake("--report", "reports/provenance.html")
    text = (copy.folder / "reports/provenance.html").read_text(encoding="utf-8")
    start = 'var results = {"'
    results = json.JSONDecoder().raw_decode(text, text.index(start) + len(start) - 2)[0]
    figures = copy.folder / "results/figures/fingerprint_loo"
    for line in json.loads((figures / "captions.json").read_text(encoding="utf-8")):
        told = results[f"results/figures/fingerprint_loo/{line['name']}.svg"]
        assert told["labels"]["title"] == label(line["title"])
        shown = " ".join(re.sub(r"<[^>]*>", "", told["caption"]).split())
        assert html.escape(line["caption"], quote=False) in shown
    assert {"tables/fingerprint_loo.csv", "claims/fingerprint_loo.csv", "claims.csv"} <= {
        name.removeprefix("results/") for name in results
    }
    assert "reports/reposition.pdf" in results
    headings = {"Small", "All studies", "Comparison of all algorithms"}
    assert all(f'"{heading}"' in text for heading in headings)
