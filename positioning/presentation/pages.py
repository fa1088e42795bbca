"""Pages for readers: one of each study, and the front page. Each is one file that needs no other."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup

from positioning.errors import InputError
from positioning.evaluation.entries import task_of
from positioning.files import read_json
from positioning.presentation import tables
from positioning.presentation.claim_lines import told
from positioning.presentation.environment import as_text, environment
from positioning.presentation.papers import kinds_of
from positioning.presentation.study_lines import (
    breakable,
    coded,
    row_lines,
    scene_line,
    setting_lines,
    sweep_lines,
    world_lines,
)
from positioning.presentation.svg import inline_svg
from positioning.presentation.tables import Row

WORLDS_NEEDED = 39
"""Fewer worlds than this cannot promise a 95 % interval of single experiments."""

PREDICATES = {
    "exact": ("is rebuilt to the last digit", "are rebuilt to the last digit"),
    "reproduced": ("is reproduced", "are reproduced"),
    "holds": ("holds", "hold"),
    "depends": ("depends on the world", "depend on the world"),
    "not reproduced": ("is not reproduced", "are not reproduced"),
    "fails": ("fails", "fail"),
    "contradicts itself": (
        "contradicts the paper's own numbers or words",
        "contradict the paper's own numbers or words",
    ),
    "calibrated": ("set a free setting and counts for nothing", "set free settings and count for nothing"),
    "none given": ("has no printed number", "have no printed number"),
    "not testable": ("cannot be tested here", "cannot be tested here"),
    "undecided": ("is undecided for want of worlds", "are undecided for want of worlds"),
}


@dataclass(frozen=True)
class Picture:
    """A drawn figure as it goes into a page."""

    name: str
    title: str
    caption: str
    svg: Markup
    sweeps: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """The paper's number, where the name says one, and the title."""
        number = re.fullmatch(r"(fig|table)(\d+[a-z]?)", self.name)
        place = {"fig": "Figure", "table": "Table"}[number[1]] + f" {number[2]}: " if number else ""
        return place + self.title


@dataclass(frozen=True)
class Report:
    """All that the page of a study says.

    Attributes
    ----------
    study
        Its name.
    plan
        ``title``, ``entries`` (settings by row), ``families`` (settings by family), ``recordings``,
        ``worlds``, ``first_seed``, ``sweeps`` (setting and values by name), ``reference``, ``quick``; and
        ``scene`` and ``meanings`` (in words, by family or recording), where they are told.
    table, paired, times, claims
        As `tables.read_table` reads them.
    pictures
        Figures in their order.
    paper
        What the paper reports: settings, readings, claims.
    calibration
        One mapping a calibrated setting.
    manifest
        Commit, versions and whatever else names the build.
    sources
        The register of data sets; None where the study uses none.
    new
        Rows that the project does not ship; they are marked.
    """

    study: str
    plan: Mapping[str, Any]
    table: pd.DataFrame
    paired: pd.DataFrame
    times: pd.DataFrame
    claims: pd.DataFrame
    pictures: Sequence[Picture]
    paper: Mapping[str, Any]
    calibration: Sequence[Mapping[str, Any]] = ()
    manifest: Mapping[str, Any] = field(default_factory=dict)
    sources: pd.DataFrame | None = None
    new: Collection[str] = ()


def read_pictures(folder: str | Path, study: str, only: str = "") -> list[Picture]:
    """Read a folder of figures, in the order of its ``captions.json``.

    Parameters
    ----------
    folder
        As `positioning.presentation.figures.save` writes it.
    study
        Whose figures they are; keeps the figures of several studies apart on one page.
    only
        Name of a single figure; without it, all. A name that is not there gives none.

    Raises
    ------
    InputError
        Where a figure has no text for readers who cannot see it.
    """
    pictures = []
    for line in read_json(Path(folder) / "captions.json"):
        if only not in ("", line["name"]):
            continue
        if not line["alt"].strip():
            raise InputError(f"figure {line['name']}", "its alt text is empty", "Say in words what it shows")
        text = (Path(folder) / f"{line['name']}.svg").read_text(encoding="utf-8")
        svg = Markup(inline_svg(text, f"{study}-{line['name']}", line["alt"]))
        pictures.append(Picture(line["name"], line["title"], line["caption"], svg, tuple(line["sweeps"])))
    return pictures


def study_page(report: Report) -> str:
    """Return the page of a study as HTML.

    Parameters
    ----------
    report
        What it says.
    """
    rows = tables.rows_of(report.table, report.claims, report.paper)
    kinds = kinds_of([report.paper])
    settings = report.paper.get("settings", {}).get(report.study, {})
    return (
        environment()
        .get_template("study.html")
        .render(
            title=report.plan["title"],
            here="study",
            study=report.study,
            plan=report.plan,
            paper=report.paper,
            answer=answer(report.claims, worlds_in_words(report.plan)),
            counts=tables.counts(report.claims),
            families=[_family(name, rows, report) for name in tables.families(report.table)],
            calibration=report.calibration,
            pictures=report.pictures,
            claims=told(
                tables.records(report.claims),
                kinds,
                {report.study: [picture.name for picture in report.pictures]},
            ),
            settings=setting_lines(settings, report.plan["families"], report.calibration),
            readings=report.paper.get("readings", {}).get(report.study, []),
            scene=scene_line(report.plan.get("scene", "")),
            kinds_of_worlds=world_lines(report.plan, settings, report.calibration),
            entries=row_lines(report.plan["entries"]),
            new=report.new,
            printed_in_table=any(cell.printed for row in rows for cell in row.cells.values()),
            tasks=list(dict.fromkeys(task_of(value) for value in report.plan["entries"].values())),
            seconds=_seconds_by_rule(report.manifest),
            build=build_lines(report.manifest),
            sources=_sources(report),
            sweeps=sweep_lines(
                report.plan["sweeps"],
                {sweep: picture.name for picture in report.pictures for sweep in picture.sweeps},
            ),
            coded=coded,
            breakable=breakable,
            worlds=worlds_in_words(report.plan),
            worlds_needed=WORLDS_NEEDED,
        )
    )


def answer(claims: pd.DataFrame, where: str) -> str:
    """Return the verdicts of a ledger in one sentence.

    Parameters
    ----------
    claims
        The ledger.
    where
        On what they were judged, in words.
    """
    found = tables.counts(claims)
    if not found:
        return f"No claim of the paper speaks of this study; the algorithms are compared {where}."
    told = [f"{count} {PREDICATES.get(v, (v, v))[count != 1]}" for v, count in found.items()]
    return f"Of {len(claims)} claim{'s' * (len(claims) != 1)}, judged {where}, {tables.listed(told)}."


def worlds_in_words(plan: Mapping[str, Any]) -> str:
    """Return in words what a study runs on."""
    if plan["recordings"]:
        count = len(plan["recordings"])
        simulated = sum("simulated" in name.split("_") for name in plan["recordings"])
        kind, rest = ("", f", {simulated} of them simulated") if simulated else ("real ", "")
        return f"on {count} {kind}recording{'s' * (count != 1)}{rest}"
    families = len(plan["families"])
    worlds = f"on {plan['worlds']} synthetic world{'s' * (plan['worlds'] != 1)}"
    return worlds + (f" in each of {families} families" if families > 1 else "")


def build_lines(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what the numbers came from, as pairs of a name and a text.

    Parameters
    ----------
    manifest
        As the rule of this name writes it.
    """
    seconds = manifest.get("seconds_by_rule", {})
    told = [
        ("commit", str(manifest.get("commit", "unknown")) + ", with changes" * bool(manifest.get("dirty"))),
        ("configuration", str(manifest.get("config_digest", "unknown"))[:16]),
        ("versions", as_text({"python": manifest.get("python", "unknown"), **manifest.get("packages", {})})),
        ("machine", ", ".join(str(manifest[name]) for name in ("system", "processor") if name in manifest)),
        (
            "seconds of all jobs",
            as_text({rule: float(used) for rule, used in sorted(seconds.items(), key=lambda item: -item[1])}),
        ),
    ]
    return [(name, text) for name, text in told if text]


def _family(name: str, rows: Sequence[Row], report: Report) -> dict[str, Any]:
    """Return everything that is told of one family of worlds or one recording."""
    own = [row for row in rows if row.family == name]
    reference, entries = report.plan["reference"], report.plan["entries"]
    # Rows of another measure are not paired with the row of reference; a family may be without that row.
    paired = report.paired[report.paired["family"] == name]
    near = paired.loc[paired["against"] == reference, "algorithm"]
    comparable = {reference, *near} if len(near) else set(paired["algorithm"])
    best = tables.best_row([row for row in own if row.algorithm in comparable], entries)
    competitors = list(dict.fromkeys([reference, *([best] if best else [])]))
    return {
        "name": name,
        "rows": own,
        "tables": [_task_table(task, lines) for task, lines in tables.by_task(own, entries).items()],
        "paired": [
            {"against": against, "is_best": against == best, "lines": lines}
            for against in competitors
            if (lines := _paired(report.paired, name, against))
        ],
        "times": _times(report, name, own),
    }


def _task_table(task: str, rows: Sequence[Row]) -> dict[str, Any]:
    silent: dict[str, list[str]] = {}
    for row in rows:
        if row.note:
            silent.setdefault(row.note.rstrip("."), []).append(row.algorithm)
    return {
        "task": task,
        "rows": [row for row in rows if not row.note],
        "silent": silent,
        "spread": any(row.sd_worlds != tables.NOTHING for row in rows),
        "differ": len({row.samples for row in rows if row.cells}) > 1,
        "size": tables.size_of(rows),
        "central": tables.central_of(tables.worlds_by_row(rows)),
    }


def _paired(frame: pd.DataFrame, family: str, against: str) -> list[dict[str, Any]]:
    own = frame[(frame["family"] == family) & (frame["against"] == against)]
    return [
        {
            "algorithm": line["algorithm"],
            "difference": tables.metres(line["difference_m"]),
            "span": " to ".join(tables.metres(line[end]) for end in ("low_m", "high_m")),
            "share": f"{100 * line['share_smaller']:.0f} %",
            "n": int(line["n"]),
            "unit": line["unit"] + "s",
            "outcome": _outcome(line["low_m"], line["high_m"]),
        }
        for line in tables.records(own)
        if line["n"] > 1
    ]


def _outcome(low_m: float, high_m: float) -> str:
    """Return which way an interval decides; an end that is printed as zero decides nothing."""
    if float(tables.metres(high_m).replace("\N{MINUS SIGN}", "-")) < 0:
        return "smaller"
    return "larger" if float(tables.metres(low_m).replace("\N{MINUS SIGN}", "-")) > 0 else "open"


def _times(report: Report, family: str, rows: Sequence[Row]) -> list[dict[str, Any]]:
    own = report.times[(report.times["family"] == family) & report.times["value"].isna()]
    median_s = own.groupby("algorithm")["seconds"].median()
    return [
        {"algorithm": row.algorithm, "seconds": _seconds(float(median_s.loc[row.algorithm]))}
        for row in rows
        if row.algorithm in median_s.index
    ]


def _seconds_by_rule(manifest: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return time and share of each rule's jobs, longest first; then their sum."""
    seconds = {rule: float(used) for rule, used in manifest.get("seconds_by_rule", {}).items()}
    whole = sum(seconds.values())
    longest = sorted(seconds.items(), key=lambda item: -item[1])
    return [
        (rule, _seconds(used), f"{100 * used / (whole or 1):.0f} %")
        for rule, used in [*longest, *([("all", whole)] if longest else [])]
    ]


def _seconds(seconds: float) -> str:
    if seconds < 1:
        return f"{1000 * seconds:.2g} ms" if seconds < 0.0995 else f"{1000 * seconds:.0f} ms"
    return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"


def _sources(report: Report) -> list[dict[str, Any]]:
    if report.sources is None:
        return []
    used = {options["source"] for options in report.plan["recordings"].values()}
    return [line for line in tables.records(report.sources) if line["source"] in used]
