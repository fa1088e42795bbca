"""The whole report as one PDF, set by Typst from data; and the ledger of claims as a LaTeX long table."""

import json
import math
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from positioning.errors import InputError
from positioning.files import read_json
from positioning.presentation import tables
from positioning.presentation.claim_lines import claim_line
from positioning.presentation.front import glance, in_short, main_claims, shown_groups
from positioning.presentation.method import MEANINGS
from positioning.presentation.pages import answer, build_lines, worlds_in_words
from positioning.presentation.papers import kinds_of
from positioning.presentation.study_lines import setting_lines
from positioning.presentation.svg import EPOCH
from positioning.presentation.tones import GROUPS, PALETTES, TONES

TEMPLATE = Path(__file__).parent / "templates" / "report.typ"
"""How the report is laid out; it holds no numbers and no texts of a study."""


@dataclass(frozen=True)
class Chapter:
    """What the report says of one study.

    Attributes
    ----------
    study
        Its name.
    plan
        ``title``, ``worlds``, ``families``, ``recordings``, ``entries`` and ``quick``, as on its page.
    table, claims
        As `tables.read_table` reads them; the claims of this study alone.
    paper
        What the paper reports: ``key``, ``short``, ``authors``, ``title``, ``claims``.
    figures
        The folder of its figures.
    calibration
        One mapping a calibrated setting, as the rule of this name writes them.
    """

    study: str
    plan: Mapping[str, Any]
    table: pd.DataFrame
    claims: pd.DataFrame
    paper: Mapping[str, Any]
    figures: Path
    calibration: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True)
class _Grid:
    """A table of cells of text; ``verdict`` colours what is small under a number."""

    head: list[str]
    lines: list[list[dict[str, str]]] = field(default_factory=list)
    caption: str = ""


def report_pdf(
    chapters: Sequence[Chapter],
    manifest: Mapping[str, Any],
    seconds: int = EPOCH,
    comparison: Path | None = None,
) -> bytes:
    """Return the report as a PDF with bookmarks, page numbers and figures whose fonts are embedded.

    Parameters
    ----------
    chapters
        One a study, in their order.
    manifest
        Commit, versions and whatever else names the build.
    seconds
        The time that the file gives as its own, since 1970; equal input gives equal bytes.
    comparison
        The folder of the figures that put all algorithms of a task beside each other.

    Raises
    ------
    InputError
        Without any study, or where a figure's PDF is not there.
    """
    import typst  # of 30 MB: who only reads the texts of this module does not wait for it

    folders = [chapter.figures for chapter in chapters] + ([comparison] if comparison else [])
    root = _common(folders)
    data = json.dumps(report_data(chapters, manifest, root, comparison), ensure_ascii=False)
    template: Any = TEMPLATE.read_bytes()  # typst's own types want template and root to be of one kind
    pdf: bytes = typst.compile(
        template,
        root=str(root),
        sys_inputs={"report": data},
        ignore_system_fonts=True,
        format="pdf",
        timestamp=datetime.fromtimestamp(seconds, UTC),
    )
    return pdf


def report_data(
    chapters: Sequence[Chapter], manifest: Mapping[str, Any], root: Path, comparison: Path | None = None
) -> dict[str, Any]:
    """Return all that the template sets, as texts.

    Parameters
    ----------
    chapters, manifest, comparison
        As in `report_pdf`.
    root
        The folder to which the paths of figures are relative.

    Raises
    ------
    InputError
        Without any study, or where a figure's PDF is not there.
    """
    if not chapters:
        raise InputError("the report", "has no study", "Name studies in the configuration")
    ledger = pd.concat([chapter.claims for chapter in chapters])
    papers = {str(chapter.paper["key"]): chapter.paper for chapter in chapters}
    groups = shown_groups(ledger)
    return {
        "title": "Reposition",
        "subtitle": "Experiments of positioning papers, run again: what holds and what does not",
        "build": _commit(manifest),
        "quick": any(chapter.plan.get("quick") for chapter in chapters),
        "answer": in_short(ledger),
        "groups": [[group, len(verdicts)] for group, verdicts in groups.items()],
        "verdicts": [verdict for verdicts in groups.values() for verdict in verdicts],
        "matrix": [{**line, "name": papers[line["paper"]]["short"]} for line in glance(list(papers), ledger)],
        "tones": {verdict: PALETTES["light"][tone] for verdict, tone in TONES.items()},
        "mains": _mains(chapters),
        "meanings": [[verdict, MEANINGS[verdict]] for verdicts in GROUPS.values() for verdict in verdicts],
        "chapters": [_chapter(chapter, root) for chapter in chapters],
        "comparison": _figures(comparison, root) if comparison else [],
        "manifest": build_lines(manifest),
    }


def ledger_latex(claims: pd.DataFrame, kinds: Mapping[str, str]) -> str:
    """Return the ledger of claims as a LaTeX table over many pages, for longtable and booktabs.

    Parameters
    ----------
    claims
        As `tables.read_table` reads them.
    kinds
        The kind of each claim by its id: the rebuilt number of some is a share of worlds.
    """
    head = " & ".join(("claim", "where", "printed", "rebuilt", "interval", "worlds", "verdict")) + " \\\\"
    parts = [
        "% Needs \\usepackage{booktabs,longtable,array} and an input encoding of UTF-8.",
        "\\begin{longtable}{>{\\raggedright}p{0.24\\linewidth}>{\\raggedright}p{0.2\\linewidth}rrrrl}",
        f"\\caption{{{tables.latex(_ledger_caption(claims))}}}\\label{{tab:claims}}\\\\",
        f"\\toprule\n{head}\n\\midrule\n\\endfirsthead",
        f"\\toprule\n{head}\n\\midrule\n\\endhead",
        "\\bottomrule\n\\endfoot",
    ]
    for study in dict.fromkeys(str(name) for name in claims["study"]):
        own = tables.records(claims[claims["study"] == study])
        name = f"\\texttt{{{tables.latex(study)}}}, {len(own)} claim{'s' * (len(own) != 1)}"
        parts.append(f"\\multicolumn{{7}}{{l}}{{{name}}} \\\\*")
        for line in own:
            told = _claim(line, kinds)
            # Dots and underscores of an id are places where a narrow column may break it.
            claim = re.sub(r"(\.|\\_)", r"\1\\allowbreak{}", tables.latex(told["claim"]))
            cells = (told[name] for name in ("where", "printed", "rebuilt", "span", "worlds", "verdict"))
            parts.append(" & ".join([f"\\texttt{{{claim}}}", *map(tables.latex, cells)]) + " \\\\")
        parts.append("\\addlinespace")
    return "\n".join([*parts, "\\end{longtable}"]) + "\n"


def _chapter(chapter: Chapter, root: Path) -> dict[str, Any]:
    kinds = kinds_of([chapter.paper])
    return {
        "study": chapter.study,
        "title": chapter.plan["title"],
        "paper": f"{chapter.paper['authors']}: {chapter.paper['title']}",
        "answer": answer(chapter.claims, worlds_in_words(chapter.plan)),
        "tables": [vars(grid) for grid in _grids(chapter)],
        "figures": _figures(chapter.figures, root),
        "settings": [vars(grid) for grid in _settings(chapter)],
        "claims": [_claim(line, kinds) for line in tables.records(chapter.claims)],
    }


def _mains(chapters: Sequence[Chapter]) -> list[dict[str, Any]]:
    """Return what each paper mainly claims, with verdicts and numbers."""
    found: dict[str, list[dict[str, str]]] = {}
    for chapter in chapters:
        lines = main_claims(chapter.paper.get("claims", []), chapter.claims)
        found.setdefault(str(chapter.paper["short"]), []).extend(lines)
    return [{"paper": paper, "lines": lines} for paper, lines in found.items() if lines]


def _settings(chapter: Chapter) -> Iterable[_Grid]:
    """Yield what the paper reports of the worlds, what had to be assumed, and how it is read."""
    settings = setting_lines(
        chapter.paper.get("settings", {}).get(chapter.study, {}),
        chapter.plan["families"],
        chapter.calibration,
    )
    for kind, where in (("reported", "where"), ("assumed", "why")):
        grid = _Grid(
            head=["setting", "value", where, "used instead"],
            caption={"reported": "Reported by the paper", "assumed": "Assumed: the paper does not print it"}[
                kind
            ],
        )
        for line in settings[kind]:
            used = "; ".join(
                one["text"]
                + (f" in {', '.join(one['families'])}" if one["families"] else "")
                + (", calibrated" if one["calibrated"] else "")
                for one in line["used"]
            )
            texts = (
                line["name"],
                f"{line['value']} {line['unit']}",
                line["where"].striptags(),
                used or tables.NOTHING,
            )
            grid.lines.append([{"text": text, "small": "", "verdict": ""} for text in texts])
        if grid.lines:
            yield grid
    readings = chapter.paper.get("readings", {}).get(chapter.study, [])
    if readings:
        grid = _Grid(
            head=["place", "problem", "reading used", "others"],
            caption="Where the paper can be read in more than one way",
        )
        for reading in readings:
            told = [reading.get(name, tables.NOTHING) for name in ("equation", "problem", "used", "others")]
            grid.lines.append(
                [{"text": str(text).replace("`", ""), "small": "", "verdict": ""} for text in told]
            )
        yield grid


def _claim(line: Mapping[str, Any], kinds: Mapping[str, str]) -> dict[str, str]:
    """Return a claim as pages tell it; a dash where there is nothing."""
    told = claim_line(line, kinds)
    names = ("claim", "where", "what", "printed", "rebuilt", "span", "worlds", "verdict", "reason")
    return {name: str(told[name]) or tables.NOTHING for name in names}


def _grids(chapter: Chapter) -> Iterable[_Grid]:
    """Yield a table for each family and task: rebuilt numbers, under them those that are printed."""
    rows = tables.rows_of(chapter.table, chapter.claims, chapter.paper)
    for family in tables.families(chapter.table):
        own = [row for row in rows if row.family == family]
        for task, lines in tables.by_task(own, chapter.plan["entries"]).items():
            ran = [row for row in lines if row.cells]
            shown = [
                m
                for m in tables.HEADINGS
                if m in ("mean_m", "p50_m", "p75_m", "p90_m", "p95_m")
                or any(row.cells[m].printed for row in ran)
            ]
            spans = any(row.cells["mean_m"].span for row in ran)
            grid = _Grid(
                head=[
                    "algorithm",
                    *(tables.HEADINGS[m] for m in shown),
                    *(["mean, interval"] if spans else []),
                ],
                caption=_caption(family, task, ran, lines),
            )
            for row in ran:
                cells = [row.cells[m] for m in shown]
                grid.lines.append(
                    [
                        {"text": row.algorithm, "small": "", "verdict": ""},
                        *(
                            {"text": c.text, "small": _printed(c), "verdict": c.verdict if c.printed else ""}
                            for c in cells
                        ),
                        {"text": row.cells["mean_m"].span or tables.NOTHING, "small": "", "verdict": ""},
                    ][: len(grid.head)]
                )
            yield grid


def _printed(cell: tables.Cell) -> str:
    """Return the printed digits with the letter of their verdict, which does not depend on colours."""
    return f"{cell.printed} {tables.MARKS.get(cell.verdict, '?')}" if cell.printed else ""


def _caption(family: str, task: str, ran: Sequence[tables.Row], lines: Sequence[tables.Row]) -> str:
    told = f"{family}, {task.replace('_', ' ')}: position errors in metres. {tables.size_of(ran)}"
    found = {cell.verdict for row in ran for cell in row.cells.values() if cell.printed}
    if found:
        letters = ", ".join(f"{tables.MARKS.get(verdict, '?')} {verdict}" for verdict in sorted(found))
        told += f" Under a rebuilt number: what the paper prints; {letters}."
    if any(row.cells["mean_m"].span for row in ran):
        told += f" Interval: {tables.central_of(tables.worlds_by_row(ran))}."
    skipped: dict[str, list[str]] = {}
    for row in lines:
        if not row.cells:
            skipped.setdefault(row.note, []).append(row.algorithm)
    return told + "".join(f" Did not run: {', '.join(names)} ({why})." for why, names in skipped.items())


def _figures(folder: Path, root: Path) -> list[dict[str, str]]:
    figures = []
    for line in read_json(folder / "captions.json"):
        path = folder / f"{line['name']}.pdf"
        if not path.is_file():
            raise InputError(f"figure {path}", "is not there", f"Draw the figures of {folder.name} again")
        number = re.fullmatch(r"(fig|table)(\d+[a-z]?)", line["name"])
        place = (
            {"fig": "Figure", "table": "Table"}[number[1]] + f" {number[2]} of the paper. " if number else ""
        )
        figures.append(
            {
                "path": "/" + path.resolve().relative_to(root).as_posix(),
                "title": place + line["title"],
                "caption": line["caption"],
                "alt": line["alt"],
            }
        )
    return figures


def _ledger_caption(claims: pd.DataFrame) -> str:
    worlds = [int(number) for number in claims["worlds"] if not math.isnan(float(number)) and number]
    told = f", judged on {min(worlds)} to {max(worlds)} worlds" if worlds else ""
    return (
        f"All {len(claims)} claims{told}. Of an ordering, a ratio or a bound, the rebuilt number is the share"
        " of worlds in which it is so; of a number, the interval is where single experiments lie."
    )


def _commit(manifest: Mapping[str, Any]) -> str:
    commit = str(manifest.get("commit", "unknown"))[:12]
    return commit + (" with changes that are not committed" if manifest.get("dirty") else "")


def _common(folders: Sequence[Path]) -> Path:
    """Return the folder that holds those of all figures."""
    return Path(os.path.commonpath([folder.resolve().parent for folder in folders])) if folders else Path()
