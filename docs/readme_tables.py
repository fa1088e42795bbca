"""Fill the blocks of the documents from the accepted ledger: ``python docs/readme_tables.py``.

A block stands between two comments, ``<!-- NAME:start WORDS -->`` and ``<!-- NAME:end -->``, each on a line
of its own. Everything in it is written here, from ``tests/golden/claims.csv``, ``data/papers/`` and
``config/config.yaml``, so that no computed number is typed into a text. The README has one, ``summary``;
the pages of ``docs/reproduction/`` have

============ =========================================================================================
``verdicts`` the page's claims counted, by study and verdict
``settings`` how many settings of each study the paper prints, and how many are assumed
``readings`` what is unclear in the paper, and how it is read; the words are studies
``claims``   printed beside rebuilt; the words are patterns of claims, as in ``fig4.*``
``differs``  the same of those claims alone that came out otherwise than the paper has it
``tried``    the sweeps of the configuration; the words are studies
============ =========================================================================================
"""

import csv
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from positioning.errors import InputError
from positioning.files import read_yaml, replacing, write_text
from positioning.presentation.tones import GROUPS

LEDGER = Path("tests/golden/claims.csv")
PAPERS = Path("data/papers")
CONFIG = Path("config/config.yaml")
README = Path("README.md")
PAGES = Path("docs/reproduction")
PICTURE = Path("results/figures/fingerprint_loo/table1.svg")
SHOWN = Path("docs/images/table1.svg")

DIFFERS = (*GROUPS["differs"], *GROUPS["contradicts itself"], "undecided")
"""Verdicts of claims that a page must explain."""
NOTHING = "\N{EN DASH}"
HEAD = ("claim", "what", "printed", "rebuilt", "interval", "verdict")

_BLOCK = re.compile(
    r"^<!-- (?P<name>\w+):start(?P<words>[^\n]*?) -->\n(?P<inside>.*?)^<!-- (?P=name):end -->$",
    re.DOTALL | re.MULTILINE,
)
_MARK = re.compile(r"<!-- \w+:(?:start|end)")


@dataclass(frozen=True)
class Facts:
    """What the blocks are made of.

    Attributes
    ----------
    ledger
        Claims with their verdicts, one mapping of columns to texts each.
    papers
        What each paper reports, by key.
    studies
        Studies of the configuration, by name.
    titles
        By key, what the paper is about in a few words: the heading of its page.
    """

    ledger: Sequence[Mapping[str, str]]
    papers: Mapping[str, Mapping[str, Any]]
    studies: Mapping[str, Any]
    titles: Mapping[str, str]


def blocks(text: str) -> list[tuple[str, list[str], str]]:
    """Return the blocks of a text: name, words, and what stands in it without surrounding blank lines.

    Raises
    ------
    InputError
        Where a marker has no counterpart.
    """
    found = list(_BLOCK.finditer(text))
    if len(_MARK.findall(text)) != 2 * len(found) or any(_MARK.search(block["inside"]) for block in found):
        raise InputError(
            "document",
            "a marker of a block has no counterpart, or stands in another block",
            "Write <!-- NAME:start --> and <!-- NAME:end -->, each on a line of its own",
        )
    return [(block["name"], block["words"].split(), block["inside"].strip()) for block in found]


def filled(text: str, facts: Facts, paper: str = "") -> str:
    """Return a text with its blocks written anew, and nothing else changed.

    Parameters
    ----------
    text
        The document.
    facts
        Ledger and papers.
    paper
        The paper that the document is about; none for the README.

    Raises
    ------
    InputError
        Where a marker has no counterpart, or a block has an unknown name or names a claim or a study that
        is not there.
    """
    blocks(text)

    def written(block: re.Match[str]) -> str:
        name, words = block["name"], block["words"].split()
        if name not in MAKERS:
            raise InputError(f"block {name}", "there is no such block", f"Use one of {', '.join(MAKERS)}")
        inside = MAKERS[name](facts, paper, words)
        return f"<!-- {name}:start{block['words']} -->\n\n{inside}\n\n<!-- {name}:end -->"

    return _BLOCK.sub(written, text)


def read_facts(root: Path) -> Facts:
    """Read ledger, papers and the headings of the pages.

    Raises
    ------
    InputError
        Where there is no accepted ledger.
    """
    if not (root / LEDGER).is_file():
        raise InputError(str(LEDGER), "there is no such file", "Build the full report, then `make accept`")
    with (root / LEDGER).open(encoding="utf-8", newline="") as lines:
        ledger = list(csv.DictReader(lines))
    papers = {path.stem: read_yaml(path) for path in sorted((root / PAPERS).glob("*.yaml"))}
    headings = {
        path.stem: path.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        for path in sorted((root / PAGES).glob("*.md"))
    }
    # In the order of the ledger, which is that of the report.
    order = dict.fromkeys(line["paper"] for line in ledger)
    titles = {paper: headings[paper] for paper in order if paper in headings}
    studies = read_yaml(root / CONFIG)["studies"]
    return Facts(ledger=ledger, papers=papers, studies=studies, titles=titles)


def main(root: Path = Path()) -> None:
    """Write all blocks, and take the picture of the README over from the last full build where there is one.

    Parameters
    ----------
    root
        The project's folder.

    Raises
    ------
    InputError
        Where there is no accepted ledger, or a block cannot be written; nothing is changed then.
    """
    facts = read_facts(root)
    pages = [(root / README, ""), *((path, path.stem) for path in sorted((root / PAGES).glob("*.md")))]
    texts = {path: filled(path.read_text(encoding="utf-8"), facts, paper) for path, paper in pages}
    for path, text in texts.items():
        write_text(path, text)
    if (root / PICTURE).is_file():
        with replacing(root / SHOWN) as temporary:
            temporary.write_bytes((root / PICTURE).read_bytes())


def summary(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return the README's table: claims counted by paper and by what the verdicts come to."""
    lines = []
    for key, title in facts.titles.items():
        found = Counter(line["verdict"] for line in facts.ledger if line["paper"] == key)
        counted = [sum(found[verdict] for verdict in verdicts) for verdicts in GROUPS.values()]
        about = f"[{title}]({(PAGES / key).as_posix()}.md)"
        lines.append([about, str(found.total()), *map(_count, counted)])
    return _table(["paper", "claims", *GROUPS], lines)


def verdicts(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return the claims of a paper, counted by study and verdict."""
    own = [line for line in facts.ledger if line["paper"] == paper]
    found = Counter((line["study"], line["verdict"]) for line in own)
    shown = [v for group in GROUPS.values() for v in group if any(line["verdict"] == v for line in own)]
    studies = list(dict.fromkeys(line["study"] for line in own))
    lines = [
        [f"`{study}`", str(sum(line["study"] == study for line in own))]
        + [_count(found[study, verdict]) for verdict in shown]
        for study in studies
    ]
    return _table(["study", "claims", *shown], lines)


def settings(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return how many settings of each study are printed in the paper, and how many are assumed."""
    lines = []
    for study, values in _paper(facts, paper)["settings"].items():
        assumed = sum("assumed" in value for value in values.values())
        printed = [f"`{name}`" for name, value in values.items() if "assumed" not in value]
        lines.append([f"`{study}`", str(assumed), str(len(printed)), ", ".join(printed) or NOTHING])
    return _table(["study", "assumed", "printed", "printed ones"], lines)


def readings(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return what is unclear in a paper, and how it is read; ``words`` are studies."""
    by_study = _paper(facts, paper)["readings"]
    lines = []
    for study in words:
        if study not in by_study:
            raise InputError(f"block readings {study}", "no such study", f"Use one of {', '.join(by_study)}")
        for reading in by_study[study]:
            others = reading.get("others", "")
            told = [reading["equation"], reading["problem"], reading["used"], others or NOTHING]
            lines.append([_cell(text) for text in told])
    return _table(["where", "what is open", "read here as", "other readings"], lines)


def claims(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return claims of a paper, printed beside rebuilt; ``words`` are patterns of their names."""
    return _table(list(HEAD), [_line(claim) for claim in matching(facts, paper, words)])


def differs(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return those claims that came out otherwise than the paper has it."""
    found = [claim for claim in matching(facts, paper, words) if claim["verdict"] in DIFFERS]
    return _table(list(HEAD), list(map(_line, found))) if found else "None of these claims differs any more."


def tried(facts: Facts, paper: str, words: Sequence[str]) -> str:
    """Return the sweeps of studies: what was set, to which values, on how many worlds."""
    lines = []
    for study in words:
        if study not in facts.studies:
            raise InputError(f"block tried {study}", "no such study", "Use one of config/config.yaml")
        for name, sweep in facts.studies[study].get("sweeps", {}).items():
            worlds = str(sweep.get("worlds", facts.studies[study]["worlds"]))
            for setting, values in sweep["over"].items():
                told = ", ".join(map(_plain, values))
                lines.append([f"`{name}`", f"`{sweep['use']}`", f"`{setting}`", told, worlds])
    return _table(["sweep", "algorithm", "setting", "values", "worlds"], lines)


def matching(facts: Facts, paper: str, words: Sequence[str]) -> list[Mapping[str, str]]:
    """Return the claims of a paper that a pattern names, in the order of the ledger.

    Raises
    ------
    InputError
        For a pattern that names no claim.
    """
    own = [line for line in facts.ledger if line["paper"] == paper]
    for pattern in words:
        if not any(fnmatchcase(line["claim"], pattern) for line in own):
            raise InputError(
                f"block with {pattern}",
                f"no claim of {paper} has such a name",
                f"Look the names up in {PAPERS.as_posix()}/{paper}.yaml",
            )
    return [line for line in own if any(fnmatchcase(line["claim"], pattern) for pattern in words)]


MAKERS: Mapping[str, Callable[[Facts, str, Sequence[str]], str]] = {
    maker.__name__: maker for maker in (summary, verdicts, settings, readings, claims, differs, tried)
}


def _paper(facts: Facts, paper: str) -> Mapping[str, Any]:
    if paper not in facts.papers:
        raise InputError(f"page {paper}", "there is no such paper", "Call the page like its paper's file")
    return facts.papers[paper]


def _line(claim: Mapping[str, str]) -> list[str]:
    # A condition has no unit: what was rebuilt is the share of worlds in which it is so.
    share = not claim["unit"]
    told = [_number(claim[name], claim["printed"], share) for name in ("rebuilt", "low", "high")]
    unit = "" if claim["unit"] in ("", "1", "share") else f" {claim['unit']}"
    rebuilt = told[0] and told[0] + (" of the worlds" if share else unit)
    interval = f"{told[1]} to {told[2]}" if told[1] and told[1] != told[2] else ""
    printed = claim["printed"] and claim["printed"] + unit
    cells = [f"`{claim['claim']}`", _cell(claim["what"]), printed, rebuilt, interval, claim["verdict"]]
    return [cell or NOTHING for cell in cells]


def _number(text: str, printed: str, share: bool) -> str:
    """Return a number of the ledger: digits as printed, two decimals at least, or three digits that tell."""
    if not text:
        return ""
    if share:
        return f"{100 * float(text):.0f} %"
    decimals = -int(Decimal(printed).as_tuple().exponent) if printed else 0
    if decimals > 0:
        return f"{float(text):.{max(decimals, 2)}f}"
    return f"{float(text):.3g}" if abs(float(text)) < 100 else f"{float(text):.0f}"


def _count(number: int) -> str:
    return str(number) if number else NOTHING


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"Error. {error}")
