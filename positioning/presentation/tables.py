"""Tables of a study: rebuilt numbers beside printed ones, as Markdown, as LaTeX and for pages."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from positioning.evaluation.claims import VERDICTS
from positioning.evaluation.entries import protocol_of, task_of
from positioning.evaluation.ranks import LEAST_COVERAGE
from positioning.evaluation.statistics import single_experiment_interval
from positioning.presentation.tones import is_control

TEXT = {
    "algorithm",
    "family",
    "against",
    "unit",
    "note",
    "claim",
    "paper",
    "study",
    "where",
    "what",
    "printed",
    "verdict",
    "reason",
    "source",
    "file",
    "kind",
    "licence",
    "version",
    "sha256",
    "where_from",
    "cite",
}
"""Columns of words and of printed digits, in all tables that are read."""

HEADINGS = {
    "mean_m": "mean",
    "p50_m": "50 %",
    "p75_m": "75 %",
    "p90_m": "90 %",
    "p95_m": "95 %",
    "se_m": "standard error",
    "rmse_m": "RMSE",
    "max_m": "largest",
}
"""Metrics in the order of the columns; all are metres."""

COUNTS = ("candidates", "iterations", "neighbours", "neurons", "samples", "trilaterations", "weights")
"""Units of claims that count things: told without decimals."""

MARKS = {
    "reproduced": "r",
    "not reproduced": "n",
    "calibrated": "c",
    "undecided": "u",
    "exact": "e",
    "none given": "o",
}
"""The letter behind a number in a LaTeX table, for verdicts that a number can have."""

NOTHING = "\N{EN DASH}"


@dataclass(frozen=True)
class Cell:
    """One metric of one row: rebuilt, where single experiments lie, printed, and the verdict on it."""

    rebuilt: float
    low: float = math.nan
    high: float = math.nan
    printed: str = ""
    verdict: str = ""
    reason: str = ""

    @property
    def text(self) -> str:
        """The rebuilt number."""
        return decimals(self.rebuilt, self.printed)

    @property
    def span(self) -> str:
        """The interval, empty where there is none."""
        return span(self.low, self.high, self.printed)


@dataclass(frozen=True)
class Row:
    """One algorithm on one family of worlds or one recording; ``note`` says why it did not run."""

    algorithm: str
    family: str
    worlds: int
    samples: int
    cells: dict[str, Cell] = field(default_factory=dict)
    sd_worlds: str = NOTHING
    note: str = ""


def read_table(path: str | Path) -> pd.DataFrame:
    """Read a CSV table of the workflow: printed digits stay as they are, other numbers become numbers.

    Parameters
    ----------
    path
        The file; columns of words and of printed digits are kept as text, empty where empty.
    """
    frame = pd.read_csv(path, dtype=str, keep_default_na=False)
    for name in frame.columns:
        if name not in TEXT and not name.startswith("published_"):
            frame[name] = pd.to_numeric(frame[name], errors="coerce")
    return frame


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a frame's lines as mappings of column names to values."""
    return [{str(name): value for name, value in line.items()} for line in frame.to_dict("records")]


def families(table: pd.DataFrame) -> list[str]:
    """Return the families of a table in their order."""
    return list(dict.fromkeys(str(family) for family in table["family"]))


def rows_of(table: pd.DataFrame, claims: pd.DataFrame, paper: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a study's table, each number with the printed one and its verdict.

    Parameters
    ----------
    table
        The study's table as `read_table` reads it.
    claims
        The study's ledger.
    paper
        What the paper reports; its value claims tell which verdict belongs to which number.
    """
    ledger = {str(line["claim"]): line for line in records(claims)}
    order = families(table)
    judged = {}
    for claim in paper.get("claims", []):
        quantity = claim.get("quantity", {})
        if claim["kind"] == "value" and "algorithm" in quantity and claim["id"] in ledger and order:
            family = quantity.get("family", order[0])
            judged[(family, quantity["algorithm"], quantity["metric"])] = ledger[claim["id"]]
    rows = []
    for line in records(table):
        algorithm, family = str(line["algorithm"]), str(line["family"])
        if line["note"]:
            rows.append(Row(algorithm=algorithm, family=family, worlds=0, samples=0, note=str(line["note"])))
            continue
        cells = {}
        for metric in HEADINGS:
            found = judged.get((family, algorithm, metric))
            if found is not None:
                cells[metric] = Cell(
                    rebuilt=float(line[metric]),
                    low=float(found["low"]),
                    high=float(found["high"]),
                    printed=str(found["printed"]),
                    verdict=str(found["verdict"]),
                    reason=str(found["reason"]),
                )
            elif metric == "mean_m":
                cells[metric] = Cell(
                    float(line[metric]), float(line["mean_low_m"]), float(line["mean_high_m"])
                )
            else:
                cells[metric] = Cell(float(line[metric]))
        rows.append(
            Row(
                algorithm=algorithm,
                family=family,
                worlds=int(line["worlds"]),
                samples=int(line["n"]),
                cells=cells,
                sd_worlds=decimals(float(line["sd_worlds_m"])),
            )
        )
    return rows


def counts(claims: pd.DataFrame) -> dict[str, int]:
    """Return how often each verdict was given, in the order of the rules; none that was not."""
    found = Counter(str(verdict) for verdict in claims["verdict"])
    order = [*VERDICTS, *sorted(found.keys() - set(VERDICTS))]
    return {verdict: found[verdict] for verdict in order if found[verdict]}


def best_row(rows: Iterable[Row], entries: Mapping[str, Mapping[str, Any]]) -> str | None:
    """Return the competing row of smallest mean error: no control, no tested sample in training, and whole.

    Parameters
    ----------
    rows
        Rows of one family.
    entries
        Settings of the rows, as the configuration has them.
    """
    competing = [
        row
        for row in whole_rows(rows)
        if not is_control(row.algorithm) and protocol_of(entries.get(row.algorithm, {})) != "resubstitution"
    ]
    return min(competing, key=lambda row: row.cells["mean_m"].rebuilt).algorithm if competing else None


def whole_rows(rows: Iterable[Row]) -> list[Row]:
    """Return the rows of one family that answer at least `LEAST_COVERAGE` of what another one answers.

    A mean over easy samples, or over fewer worlds, is no merit beside one over all.
    """
    answering = [row for row in rows if row.cells]
    most = max((row.samples * row.worlds for row in answering), default=0)
    return [row for row in answering if row.samples * row.worlds >= LEAST_COVERAGE * most]


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def by_task(rows: Iterable[Row], entries: Mapping[str, Mapping[str, Any]]) -> dict[str, list[Row]]:
    """Return rows by their task, in the order in which they stand: errors of tasks are not alike."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(task_of(entries.get(row.algorithm, {})), []).append(row)
    return found


def decimals(value: float | None, printed: str = "", least: int = 2) -> str:
    """Return a number with the decimals of the printed one, and at least ``least``; a true minus sign."""
    if value is None or math.isnan(value):
        return NOTHING
    digits = max(least, -int(Decimal(printed).as_tuple().exponent)) if printed else least
    return f"{value:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def metres(value: float) -> str:
    """Return a length with two decimals, a third one below a decimetre."""
    return decimals(value, least=2 if math.isnan(value) or abs(value) >= 0.1 else 3)


def span(low: float, high: float, printed: str = "", least: int = 2) -> str:
    """Return an interval in words, empty where there is none.

    Its ends have the decimals of `decimals`, but no more than three digits that count, or as many as the
    printed number has; whole numbers stay whole.
    """
    if math.isnan(low) or math.isnan(high):
        return ""
    most = max(3, len(Decimal(printed).as_tuple().digits) if printed else 0)
    return " to ".join(_end(value, printed, least, most) for value in (low, high))


def _end(value: float, printed: str, least: int, most: int) -> str:
    shown = decimals(value, printed, least)
    before = len(shown.partition(".")[0].lstrip("\N{MINUS SIGN}").lstrip("0"))
    after = len(shown.partition(".")[2])
    too_many = before + after - most if before else 0
    return shown if too_many <= 0 else f"{value:.{max(0, after - too_many)}f}".replace("-", "\N{MINUS SIGN}")


_SINGLE = " of single experiments"


def central(worlds: int) -> str:
    """Return in words what an interval of single experiments covers with that many worlds.

    Few worlds cannot promise 95 %; saying so would be untrue.
    """
    coverage = single_experiment_interval(np.zeros(max(worlds, 1))).coverage
    return f"central {100 * coverage:.0f} %{_SINGLE}"


def central_of(worlds: Mapping[str, int]) -> str:
    """Return in words what intervals cover, by name of what they are of, where some have fewer worlds.

    Parameters
    ----------
    worlds
        Number of worlds by name; one world has no interval and is left out.
    """
    most = central(max(worlds.values(), default=0))
    others: dict[str, list[str]] = {}
    for name, count in worlds.items():
        if count > 1 and (own := central(count)) != most:
            others.setdefault(own, []).append(name)
    told = [f"{', '.join(names)}: {own.removesuffix(_SINGLE)}" for own, names in others.items()]
    return most + (f" ({'; '.join(told)})" if told else "")


def worlds_by_row(rows: Iterable[Row]) -> dict[str, int]:
    """Return the number of worlds behind each row that ran."""
    return {row.algorithm: row.worlds for row in rows if row.cells}


def study_markdown(title: str, table: pd.DataFrame, claims: pd.DataFrame, paper: Mapping[str, Any]) -> str:
    """Return a study's table as Markdown, one section a family.

    Parameters
    ----------
    title
        The study's title.
    table, claims, paper
        As in `rows_of`.
    """
    rows = rows_of(table, claims, paper)
    parts = [f"# {plain(title)}", ""]
    for family in families(table):
        own = [row for row in rows if row.family == family]
        parts += [f"## {plain(family)}", ""]
        parts.append(
            f"Errors in metres: mean over worlds ({central_of(worlds_by_row(own))}), then the printed number"
            f" and the verdict. {size_of(own)}"
        )
        parts.append("")
        head = ["algorithm", *HEADINGS.values(), "sd over worlds", "note"]
        lines = [
            [
                code(row.algorithm),
                *(_markdown_cell(row.cells.get(m)) for m in HEADINGS),
                row.sd_worlds,
                plain(row.note),
            ]
            for row in own
        ]
        parts += [*markdown(head, lines), ""]
    return "\n".join(parts).rstrip() + "\n"


def size_of(rows: Sequence[Row]) -> str:
    """Return in words how many samples and worlds stand behind rows of a family: of most, then of others."""
    sizes: dict[tuple[int, int], list[str]] = {}
    for row in rows:
        if row.cells:
            sizes.setdefault((row.samples, row.worlds), []).append(row.algorithm)
    if not sizes:
        return ""
    if len(sizes) > 3 and len({worlds for _, worlds in sizes}) == 1:
        (low, worlds), (high, _) = min(sizes), max(sizes)
        return f"n = {low} to {high} samples" + (f" in each of {worlds} worlds." if worlds > 1 else ".")
    samples, worlds = max(sizes, key=lambda size: (len(sizes[size]), size))
    others = []
    for (n, count), names in sorted(sizes.items()):
        told = [f"n = {n}"] * (n != samples) + [f"{count} world{'s' * (count != 1)}"] * (count != worlds)
        others += [f"{', '.join(names)}: {' in '.join(told)}"] * bool(told)
    text = f"n = {samples} sample{'s' * (samples != 1)}" + (
        f" in each of {worlds} worlds" if worlds > 1 else ""
    )
    return text + (f" ({'; '.join(others)})" if others else "") + "."


def _markdown_cell(cell: Cell | None) -> str:
    if cell is None:
        return NOTHING
    text = cell.text + (f" ({cell.span})" if cell.span else "")
    return text + (f"; printed {cell.printed}: {cell.verdict}" if cell.printed else "")


def ledger_markdown(claims: pd.DataFrame) -> str:
    """Return the ledger of all claims as Markdown, one section a study."""
    parts = ["# Claims", ""]
    parts += [
        "For an ordering, a ratio or a bound, the rebuilt number is the share of worlds in which it holds.",
        "",
    ]
    for study in dict.fromkeys(str(name) for name in claims["study"]):
        own = claims[claims["study"] == study]
        told = ", ".join(f"{count} {verdict}" for verdict, count in counts(own).items())
        head = ["claim", "where", "what", "printed", "rebuilt", "interval", "worlds", "verdict", "reason"]
        parts += [f"## {plain(study)}", "", f"{len(own)} claims: {told}.", ""]
        lines = []
        for line in records(own):
            printed = str(line["printed"])
            unit = f" {line['unit']}" if line["unit"] and printed else ""
            least = 0 if line["unit"] in COUNTS else 2
            lines.append(
                [
                    code(str(line["claim"])),
                    plain(str(line["where"])),
                    plain(str(line["what"])),
                    plain(printed + unit),
                    decimals(float(line["rebuilt"]), printed, least),
                    span(float(line["low"]), float(line["high"]), printed, least) or NOTHING,
                    worlds_text(line["worlds"]),
                    str(line["verdict"]),
                    plain(str(line["reason"])),
                ]
            )
        parts += [*markdown(head, lines), ""]
    return "\n".join(parts).rstrip() + "\n"


def worlds_text(worlds: float) -> str:
    """Return a number of worlds, a dash where none were asked."""
    return NOTHING if math.isnan(float(worlds)) or not int(worlds) else str(int(worlds))


def markdown(head: Sequence[str], lines: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a Markdown table whose cells are Markdown already."""
    rule = ["---"] * len(head)
    return ["| " + " | ".join(cells) + " |" for cells in (head, rule, *lines)]


def plain(text: str) -> str:
    """Return text so that Markdown shows it as it is, also inside a table."""
    for letter, shown in (
        ("\\", "\\\\"),
        ("|", "\\|"),
        ("*", "\\*"),
        ("`", "\\`"),
        ("&", "&amp;"),
        ("<", "&lt;"),
    ):
        text = text.replace(letter, shown)
    return " ".join(text.split())


def code(name: str) -> str:
    """Return a name set as code in Markdown."""
    return "`" + name.replace("`", "'").replace("|", "\\|") + "`"


def study_latex(
    study: str, title: str, table: pd.DataFrame, claims: pd.DataFrame, paper: Mapping[str, Any]
) -> str:
    """Return a study's tables as LaTeX for the package booktabs, one table a family.

    Printed numbers stand below the rebuilt ones, so that a table fits the width of a page.

    Parameters
    ----------
    study, title
        Its name, which becomes the label, and its title.
    table, claims, paper
        As in `rows_of`.
    """
    rows = rows_of(table, claims, paper)
    parts = ["% Needs \\usepackage{booktabs} and an input encoding of UTF-8."]
    for family in families(table):
        own = [row for row in rows if row.family == family]
        printed = [m for m in HEADINGS if any(row.cells.get(m, Cell(math.nan)).printed for row in own)]
        shown = [m for m in HEADINGS if m in printed or m in ("mean_m", "p50_m", "p75_m", "p90_m", "p95_m")]
        letters = sorted({cell.verdict for row in own for cell in row.cells.values() if cell.verdict})
        marks = ", ".join(f"$^{{{MARKS.get(verdict, '?')}}}$~{verdict}" for verdict in letters)
        caption = f"{latex(title)} ({latex(family)}): position errors in metres. {latex(size_of(own))}"
        counts = worlds_by_row(own)
        several = max(counts.values(), default=0) > 1
        caption += f" Last column: of the mean, {latex(central_of(counts))}." if several else ""
        caption += (
            " Printed numbers stand below the rebuilt means over worlds, in parentheses;" if printed else ""
        )
        caption += f" {marks}." if printed else ""
        last = [[], ["interval"]][several]
        parts += [
            "\\begin{table}",
            "\\centering\\footnotesize\\setlength{\\tabcolsep}{3pt}",
            f"\\caption{{{caption}}}",
            f"\\label{{tab:{study}:{family}}}".replace("_", "-"),
            f"\\begin{{tabular}}{{l{'r' * len(shown)}{'l' * len(last)}}}",
            "\\toprule",
            " & ".join(["algorithm", *(latex(HEADINGS[metric]) for metric in shown), *last]) + " \\\\",
            "\\midrule",
        ]
        for row in own:
            name = f"\\texttt{{{latex(row.algorithm)}}}"
            if row.note:
                parts.append(
                    f"{name} & \\multicolumn{{{len(shown) + len(last)}}}{{l}}{{{latex(row.note)}}} \\\\"
                )
                continue
            cells = [row.cells[metric] for metric in shown]
            marked = [f"$^{{{MARKS.get(cell.verdict, '?')}}}$" if cell.verdict else "" for cell in cells]
            values = [latex(cell.text) + mark for cell, mark in zip(cells, marked, strict=True)]
            span = [latex(row.cells["mean_m"].span) for _ in last]
            parts.append(" & ".join([name, *values, *span]) + " \\\\")
            if any(cell.printed for cell in cells):
                below = [f"({cell.printed})" if cell.printed else "" for cell in cells]
                parts.append(" & ".join(["", *below, *("" for _ in last)]) + " \\\\")
        parts += ["\\bottomrule", "\\end{tabular}", "\\end{table}", ""]
    return "\n".join(parts).rstrip() + "\n"


def latex(text: str) -> str:
    """Return text so that LaTeX shows it as it is."""
    special = {letter: f"\\{letter}" for letter in "&%$#_{}"}
    special |= {"\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}"}
    special |= {"<": "\\textless{}", ">": "\\textgreater{}", "\N{MINUS SIGN}": "$-$", NOTHING: "--"}
    special |= {"±": "$\\pm$", "·": "$\\cdot$", "√": "$\\surd$", "°": "$^\\circ$", "²": "$^2$"}
    special |= {"\N{MULTIPLICATION SIGN}": "$\\times$", "\N{GREEK SMALL LETTER SIGMA}": "$\\sigma$"}
    special |= {"\N{NARROW NO-BREAK SPACE}": "\\,"}
    return "".join(special.get(letter, letter) for letter in text)
