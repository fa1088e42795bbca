"""The texts hold: links, keys, commands, numbers and filled blocks, and examples that run."""

import ast
import csv
import importlib
import importlib.util
import inspect
import os
import re
import subprocess
import sys
from collections import Counter
from dataclasses import fields, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from conftest import ROOT, Project, make_project
from planning.config import resolve
from planning.entries import CONTEXT

from positioning.errors import InputError
from positioning.evaluation.claims import COLUMNS, VERDICTS, quantities
from positioning.evaluation.comparison_lines import COLUMNS as COMPARISON
from positioning.evaluation.measures import MEASURES, PAIRED, TABLE
from positioning.files import read_yaml, write_tree
from positioning.filters.plane import with_leading_axis
from positioning.model import Calibration, Query, Recording, Site, Survey, Walks, Worlds
from positioning.recordings.register import COLUMNS as REGISTER_COLUMNS
from positioning.registry import class_name, factory
from positioning.seeds import stream
from positioning.simulation.fingerprint_loo import simulate
from positioning.tasks import tracking
from positioning.tasks.fingerprinting import PROTOCOLS

GOLDEN = ROOT / "tests/golden/claims.csv"
TEXTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    ROOT / "config/README.md",
    ROOT / "data/README.md",
    ROOT / "reports/README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
TEXT_NAMES = [str(path.relative_to(ROOT)) for path in TEXTS]
NOTHING = "\N{EN DASH}"
PAPERS = [path.stem for path in sorted((ROOT / "data/papers").glob("*.yaml"))]


def readme_tables() -> Any:
    """Import docs/readme_tables.py, which stands in no package."""
    spec = importlib.util.spec_from_file_location("readme_tables", ROOT / "docs/readme_tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def prose(text: str) -> str:
    """Return Markdown without its fenced blocks."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def fenced(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


def tables_of(text: str) -> list[list[list[str]]]:
    """Return every Markdown table as its lines of cells, the rule left out."""
    found = []
    for part in re.findall(r"(?:^\|.*\|\n)+", prose(text) + "\n", flags=re.MULTILINE):
        lines = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in part.splitlines()]
        found.append([lines[0], *lines[2:]])
    return found


def section(text: str, heading: str) -> str:
    """Return what stands under a heading, up to the next one."""
    found = re.search(
        rf"^#+ {re.escape(heading)}$(.*?)(?=^#+ |\Z)", prose(text), flags=re.DOTALL | re.MULTILINE
    )
    assert found is not None, heading
    return found[1]


def anchors(text: str) -> set[str]:
    """Return the names under which the headings of a page can be linked to."""
    headings = re.findall(r"^#+ (.*)$", prose(text), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


# Numbers of the README


def ledger() -> pd.DataFrame:
    assert GOLDEN.is_file(), "there is no accepted ledger; `make accept` makes it"
    frame = pd.read_csv(GOLDEN, dtype=str, keep_default_na=False)
    assert list(frame.columns) == COLUMNS
    assert set(frame["verdict"]) <= set(VERDICTS)
    return frame


def test_the_readme_counts_the_verdicts_of_the_accepted_ledger() -> None:
    accepted, module = ledger(), readme_tables()
    head, *lines = tables_of(read("README.md"))[0]
    assert head == ["paper", "claims", *module.GROUPS]
    told = {}
    for line in lines:
        link = re.fullmatch(r"\[(.+)\]\(docs/reproduction/(\w+)\.md\)", line[0])
        assert link is not None
        assert read(f"docs/reproduction/{link[2]}.md").startswith(f"# {link[1]}\n")
        told[link[2]] = [int(cell) if cell.isdecimal() else 0 for cell in line[1:]]
    assert set(told) == set(accepted["paper"]) == set(PAPERS)
    for paper, (claims, *counted) in told.items():
        found = Counter(accepted[accepted["paper"] == paper]["verdict"])
        assert claims == found.total() == sum(counted)
        assert counted == [sum(found[v] for v in verdicts) for verdicts in module.GROUPS.values()]


def test_every_verdict_is_in_one_group() -> None:
    module = readme_tables()
    assert sorted(v for verdicts in module.GROUPS.values() for v in verdicts) == sorted(VERDICTS)
    assert set(module.DIFFERS) < set(VERDICTS)


def test_the_readme_is_short() -> None:
    assert len(read("README.md").splitlines()) < 120
    assert max(len(line) for table in tables_of(read("README.md")) for line in table) <= 8


@pytest.mark.parametrize("name", ["README.md", *(f"docs/reproduction/{paper}.md" for paper in PAPERS)])
def test_blocks_are_those_of_the_accepted_ledger(name: str) -> None:
    module = readme_tables()
    paper = "" if name == "README.md" else Path(name).stem
    text = read(name)
    assert module.blocks(text)
    assert module.filled(text, module.read_facts(ROOT), paper) == text, "call `python docs/readme_tables.py`"


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    """A project of one paper with three claims, and documents with blocks that are not filled."""
    lines = [
        ["a.one", "p", "s", "", "first | one", "m", "2.5", "3.14159", "2", "4", "40", "reproduced", ""],
        ["a.two", "p", "s", "", "second", "", "", "0.01", "0", "0.1", "40", "fails", ""],
        ["b", "p", "s", "", "third", "m", "", "7", "7", "7", "40", "none given", ""],
    ]
    texts = {
        "tests/golden/claims.csv": "\n".join(",".join(line) for line in [COLUMNS, *lines]) + "\n",
        "config/config.yaml": "studies: {s: {worlds: 3, sweeps: {k: {use: knn, over: {k: [1, 2.0]}}}}}\n",
        "data/papers/p.yaml": "settings: {s: {x: {value: 1, where: here}, y: {value: 2, assumed: true}}}\n"
        "readings: {s: [{equation: '1', problem: a | b, used: c}]}\n",
        "README.md": "# A\n\n<!-- summary:start -->\nold\n<!-- summary:end -->\n\nlast\n",
        "docs/reproduction/p.md": "# About p\n"
        + "".join(
            f"<!-- {words.replace(' ', ':start ', 1) if ' ' in words else words + ':start'} -->\n"
            f"<!-- {words.split()[0]}:end -->\n"
            for words in ("verdicts", "settings", "readings s", "claims a.* b", "differs *", "tried s")
        ),
    }
    for path, text in texts.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text, encoding="utf-8")
    return tmp_path


def test_readme_tables_fill_the_blocks_and_change_nothing_else(toy: Path) -> None:
    module = readme_tables()
    module.main(toy)
    readme = (toy / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("# A\n\n<!-- summary:start -->\n\n| paper |")
    assert readme.endswith("|\n\n<!-- summary:end -->\n\nlast\n")
    assert tables_of(readme)[0][1] == [
        "[About p](docs/reproduction/p.md)",
        "3",
        "1",
        NOTHING,
        NOTHING,
        "1",
        NOTHING,
        "1",
    ]
    page = (toy / "docs/reproduction/p.md").read_text(encoding="utf-8")
    verdicts, settings, readings, claims, differs, tried = tables_of(page)
    assert verdicts[1] == ["`s`", "3", "1", "1", "1"]
    assert settings[1] == ["`s`", "1", "1", "`x`"]
    assert readings[1] == ["1", "a \\| b", "c", NOTHING]
    assert claims[1:] == [
        ["`a.one`", "first \\| one", "2.5 m", "3.14 m", "2.00 to 4.00", "reproduced"],
        ["`a.two`", "second", NOTHING, "1 % of the worlds", "0 % to 10 %", "fails"],
        ["`b`", "third", NOTHING, "7 m", NOTHING, "none given"],
    ]
    assert differs[1:] == [claims[2]]
    assert tried[1] == ["`k`", "`knn`", "`k`", "1, 2", "3"]
    assert not (toy / module.SHOWN).exists()
    (toy / module.PICTURE).parent.mkdir(parents=True)
    (toy / module.PICTURE).write_text("<svg/>", encoding="utf-8")
    module.main(toy)
    assert (toy / module.SHOWN).read_bytes() == b"<svg/>"
    assert (toy / "README.md").read_text(encoding="utf-8") == readme
    assert (toy / "docs/reproduction/p.md").read_text(encoding="utf-8") == page


@pytest.mark.parametrize(
    ("block", "told"),
    [
        ("<!-- claims:start c.* -->\n<!-- claims:end -->\n", "no claim of p"),
        ("<!-- readings:start t -->\n<!-- readings:end -->\n", "no such study"),
        ("<!-- tried:start t -->\n<!-- tried:end -->\n", "no such study"),
        ("<!-- numbers:start -->\n<!-- numbers:end -->\n", "no such block"),
        ("<!-- claims:start a.* -->\n", "counterpart"),
        ("<!-- claims:end -->\n", "counterpart"),
        ("<!-- claims:end -->\n<!-- claims:start a.* -->\n", "counterpart"),
        ("<!-- claims:start a.* -->\n<!-- differs:start * -->\n<!-- claims:end -->\n", "counterpart"),
    ],
)
def test_a_block_that_cannot_be_filled_is_named_and_nothing_is_changed(
    toy: Path, block: str, told: str
) -> None:
    page = toy / "docs/reproduction/p.md"
    page.write_text(page.read_text(encoding="utf-8") + block, encoding="utf-8")
    before = [path.read_bytes() for path in (toy / "README.md", page)]
    with pytest.raises(InputError, match=told):
        readme_tables().main(toy)
    assert [path.read_bytes() for path in (toy / "README.md", page)] == before


def test_without_a_ledger_the_cure_is_told(toy: Path) -> None:
    (toy / "tests/golden/claims.csv").unlink()
    with pytest.raises(InputError, match="make accept"):
        readme_tables().main(toy)


# Reproduction notes


def without_blocks(text: str) -> str:
    """Return a page without what is filled in, and without fenced blocks."""
    return re.sub(r"^<!-- (\w+):start.*?^<!-- \1:end -->$", "", prose(text), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("paper", PAPERS)
def test_a_page_has_a_reason_for_every_claim_that_came_out_otherwise(paper: str) -> None:
    module, accepted = readme_tables(), ledger()
    own = accepted[(accepted["paper"] == paper) & accepted["verdict"].isin(module.DIFFERS)]["claim"]
    blocks = [
        words for name, words, _ in module.blocks(read(f"docs/reproduction/{paper}.md")) if name == "differs"
    ]
    explained = [
        [claim for claim in own if any(fnmatchcase(claim, word) for word in words)] for words in blocks
    ]
    assert set(own) == {claim for claims in explained for claim in claims}
    assert [words for words, claims in zip(blocks, explained, strict=True) if not claims] == []


@pytest.mark.parametrize("paper", PAPERS)
def test_a_page_has_its_parts_and_all_readings(paper: str) -> None:
    text = read(f"docs/reproduction/{paper}.md")
    facts = read_yaml(ROOT / f"data/papers/{paper}.yaml")
    assert facts["title"] in " ".join(text.split())
    parts = ["Printed beside rebuilt", "What the paper leaves open", "What is corrected"]
    parts += ["What came out otherwise", "What was tried", "Open questions"]
    assert re.findall(r"^## (.*)$", text, flags=re.MULTILINE) == parts
    assert "**What the paper claims.**" in text
    shown = {word for name, words, _ in readme_tables().blocks(text) if name == "readings" for word in words}
    assert shown == set(facts["readings"])


@pytest.mark.parametrize("paper", PAPERS)
def test_numbers_in_the_words_of_a_page_are_the_paper_s_or_settings(paper: str) -> None:
    """A computed number stands in a block; here it would grow stale."""
    known = set(re.findall(r"\d+\.\d+", read(f"data/papers/{paper}.yaml") + read("config/config.yaml")))
    text = re.sub(r"`[^`]*`", "", without_blocks(read(f"docs/reproduction/{paper}.md")))
    # Sections and equations of papers have such numbers, too.
    text = re.sub(r"\b([Ss]ections?|[Ee]quations?) [\d., and]+", "", text)
    assert [number for number in re.findall(r"\d+\.\d+", text) if number not in known] == []


@pytest.mark.parametrize("paper", PAPERS)
def test_names_in_the_words_of_a_page_exist(paper: str) -> None:
    studies = read_yaml(ROOT / "config/config.yaml")["studies"]
    known = {*studies, *VERDICTS}
    for study in studies.values():
        known |= {*study["algorithms"], *study.get("sweeps", {}), *study.get("families", {})}
    claims = list(ledger().query("paper == @paper")["claim"])
    for name in re.findall(r"`([^`\n]+)`", without_blocks(read(f"docs/reproduction/{paper}.md"))):
        if "/" in name or name in known:
            continue
        assert any(fnmatchcase(claim, name) or claim.endswith(name) for claim in claims), name


# Links, commands, keys


@pytest.mark.parametrize("name", TEXT_NAMES)
def test_links_lead_somewhere(name: str) -> None:
    text = re.sub(r"`[^`\n]*`", "", prose(read(name)))
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        assert ":" not in target, f"{target}: texts link to the project's own files only"
        path, _, anchor = target.partition("#")
        file = (ROOT / name).parent / path if path else ROOT / name
        assert file.exists(), target
        assert not anchor or anchor in anchors(file.read_text(encoding="utf-8")), target


def test_links_are_found_and_headings_become_anchors() -> None:
    assert anchors("# A `b`: c\n```\n# no\n```\n## d_e (f)\n") == {"a-b-c", "d_e-f"}
    assert "docs/data-formats.md" in re.findall(r"\]\(([^)\s]+)\)", prose(read("README.md")))


@pytest.mark.parametrize("name", TEXT_NAMES)
def test_make_targets_exist(name: str) -> None:
    targets = set(re.findall(r"^([a-z]+):", read("Makefile"), flags=re.MULTILINE))
    assert {"all", "quick", "accept"} <= targets
    text = read(name)
    code = [*re.findall(r"`([^`\n]+)`", prose(text)), *fenced(text, "(?:ba)?sh")]
    named = [
        word for part in code for words in re.findall(r"\bmake((?: [a-z]+)+)", part) for word in words.split()
    ]
    assert set(named) <= targets


FOLDERS = r"(?:algorithms|positioning|workflow|tests|config|docs|data/papers|benchmarks|profiles)"


def made_by_guides() -> set[str]:
    """Return the files that the guides have their readers write."""
    texts = [read(name) for name in TEXT_NAMES if name.startswith("docs/")]
    named = re.findall(r"`([\w/]+\.\w+)`:\n\n```", "\n".join(texts))
    written = re.findall(r" > ([\w/]+\.py)$", "\n".join(texts), flags=re.MULTILINE)
    return {*named, *written}


@pytest.mark.parametrize("name", TEXT_NAMES)
def test_files_of_the_project_that_texts_name_exist(name: str) -> None:
    text = read(name)
    commands = "\n".join(fenced(text, "(?:ba)?sh"))
    paths = [
        *re.findall(rf"`({FOLDERS}/[\w./\-]*)`", prose(text)),
        *re.findall(rf"(?<![\w/])({FOLDERS}/[\w./\-]+)", commands),
    ]
    for path in paths:
        assert (ROOT / path).exists() or path in made_by_guides(), path


@pytest.mark.parametrize("name", TEXT_NAMES)
def test_results_and_pages_that_texts_name_are_written_by_a_rule(name: str) -> None:
    rules = "".join(path.read_text("utf-8") for path in (ROOT / "workflow/rules").glob("*.smk"))
    rules += read("Makefile")
    studies = [*read_yaml(ROOT / "config/config.yaml")["studies"], "corridor"]
    # What stands in for all studies, tasks or rows is called so in the rules as well.
    stems = "|".join(map(re.escape, studies))
    written = rules.replace("{{", "<").replace("}}", ">").replace("{REPORTS}", "reports")
    written = written.replace("{RESULTS}", "results")
    named = re.findall(r"`((?:reports|results)/[\w<>./\-]+\.\w+)`", prose(read(name)))
    for path in named:
        general = re.sub(rf"/(?:{stems})(?=[._/])", "/<study>", path.replace("/quick/", "/"))
        if "/logs/" not in general and not general.startswith("results/figures/"):
            assert re.search(rf'["/ ]{re.escape(general)}', written) or general in MANY, path


MANY = {
    "results/errors/<study>/<row>/<batch>.parquet",
    "results/comparison/<task>.csv",
}
"""Files in folders that a rule writes as a whole."""


@pytest.mark.parametrize("name", TEXT_NAMES)
def test_targets_that_texts_give_to_snakemake_exist(name: str) -> None:
    studies = {*read_yaml(ROOT / "config/config.yaml")["studies"], "corridor"}
    text = read(name)
    parts = [*re.findall(r"`(snakemake [^`\n]+)`", prose(text)), *fenced(text, "(?:ba)?sh")]
    for part in parts:
        for target in re.findall(r"^snakemake (\w+)(?= |$)", part, flags=re.MULTILINE):
            assert target in studies, part


def schema_keys() -> dict[str, set[str]]:
    """Return the keys of the configuration by the heading of config/README.md that explains them."""
    schema = read_yaml(ROOT / "workflow/schemas/config.schema.yaml")
    study, entry = schema["$defs"]["study"]["properties"], schema["$defs"]["entry"]
    nodes = {
        "Top level": schema["properties"],
        "Folders": schema["properties"]["folders"]["properties"],
        "Study": study,
        "Calibrate": study["calibrate"]["items"]["properties"],
        "Recordings": study["recordings"]["additionalProperties"]["properties"],
        "Row": entry["properties"],
        "Sweep": study["sweeps"]["additionalProperties"]["properties"],
    }
    assert sorted(map(sorted, nodes.values())) == sorted(map(sorted, properties_of(schema)))
    return {heading: set(node) for heading, node in nodes.items()}


def properties_of(node: Any) -> list[set[str]]:
    """Return the keys of every mapping that a schema describes."""
    parts = node.values() if isinstance(node, dict) else node if isinstance(node, list) else []
    own = (
        [set(node["properties"])]
        if isinstance(node, dict) and isinstance(node.get("properties"), dict)
        else []
    )
    return own + [keys for part in parts for keys in properties_of(part)]


@pytest.mark.parametrize(
    "heading", ["Top level", "Folders", "Study", "Calibrate", "Recordings", "Row", "Sweep"]
)
def test_every_key_of_the_configuration_is_explained_and_no_other(heading: str) -> None:
    table = tables_of(section(read("config/README.md"), heading))[0]
    assert table[0] == ["key", "meaning", "unit, type", "default", "source"]
    keys = [line[0].strip("`") for line in table[1:]]
    assert len(keys) == len(set(keys))
    assert set(keys) == schema_keys()[heading]
    assert all(line[1] and line[2] and line[3] for line in table[1:])


def test_every_protocol_and_adapter_is_explained() -> None:
    text = read("config/README.md")
    protocols = tables_of(section(text, "Row"))[1]
    assert {line[0].strip("`") for line in protocols[1:]} == set(PROTOCOLS)
    adapters = tables_of(section(text, "Recordings"))[1]
    modules = {path.stem for path in (ROOT / "positioning/recordings").glob("*.py")} - {
        "__init__",
        "register",
        "csv_table",
        "mat_file",
    }
    assert {line[0].strip("`") for line in adapters[1:]} == modules
    for line in adapters[1:]:
        load = importlib.import_module(f"positioning.recordings.{line[0].strip('`')}").load
        options = [p.name for p in inspect.signature(load).parameters.values() if p.kind is p.KEYWORD_ONLY]
        assert all(f"`{option}`" in line[1] for option in options)


def test_every_setting_of_an_algorithm_is_explained_with_its_default() -> None:
    table = tables_of(section(read("config/README.md"), "Settings of the algorithms"))[0]
    told = {(line[0].strip("`"), line[1].strip("`")): yaml.safe_load(line[3]) for line in table[1:]}
    assert len(told) == len(table) - 1
    # Those of the table and of the papers' rows; a user's own algorithm needs no line.
    names = {name for name, _ in told}
    for study in read_yaml(ROOT / "config/config.yaml")["studies"].values():
        claims = read_yaml(ROOT / f"data/papers/{study['paper']}.yaml")["claims"]
        rows = {q["algorithm"] for c in claims for q in quantities(c) if "algorithm" in q}
        entries = study["algorithms"]
        names |= {(entries[row] or {}).get("use", row) for row in rows & entries.keys()}
    expected = {}
    for path in (ROOT / "algorithms").glob("*/*.py"):
        if path.stem in names:
            module = importlib.import_module(f"algorithms.{path.parent.name}.{path.stem}")
            for parameter in inspect.signature(getattr(module, class_name(path.stem))).parameters.values():
                if parameter.name not in CONTEXT:
                    default = parameter.default
                    expected[path.stem, parameter.name] = (
                        list(default) if isinstance(default, tuple) else default
                    )
    assert told == expected


def test_the_shipped_values_named_are_those_of_the_configuration() -> None:
    config = read_yaml(ROOT / "config/config.yaml")
    study = config["studies"]["fingerprint_loo"]
    text = read("config/README.md")
    for heading, values in (
        ("Folders", config["folders"]),
        ("Study", {key: study[key] for key in ("worlds", "first_seed", "batch")}),
        ("Calibrate", {k: v for k, v in study["calibrate"][0].items() if k != "between"}),
    ):
        lines = {line[0].strip("`"): line[3] for line in tables_of(section(text, heading))[0][1:]}
        for key, value in values.items():
            assert re.search(rf"shipped `?{re.escape(str(value))}`?(,|$)", lines[key]), key
    low, high = study["calibrate"][0]["between"]
    assert f"shipped {low} to {high} dB" in section(text, "Calibrate")


# Architecture and formats


def test_every_rule_stands_in_the_table_of_rules_with_its_script_and_file() -> None:
    expected = set()
    for path in (ROOT / "workflow/rules").glob("*.smk"):
        for rule, body in re.findall(
            r"^rule (\w+):\n(.*?)(?=^rule |\Z)", path.read_text("utf-8"), re.DOTALL | re.M
        ):
            script = re.search(r'"\.\./scripts/(\w+\.py)"', body)
            assert script is not None
            expected.add((rule, script[1], path.name))
    table = tables_of(section(read("docs/architecture.md"), "Rules"))[0]
    assert {tuple(cell.strip("`") for cell in line[:3]) for line in table[1:]} == expected


def test_every_rule_stands_in_the_picture() -> None:
    (picture,) = fenced(read("docs/architecture.md"), "mermaid")
    table = tables_of(section(read("docs/architecture.md"), "Rules"))[0]
    shown = set(re.findall(r"[a-z_]+", " ".join(re.findall(r'-- "(.*?)" -->', picture))))
    assert {line[0].strip("`") for line in table[1:]} - {"study_manifest"} <= shown
    nodes = set(re.findall(r"^  (\w+)\[", picture, flags=re.MULTILINE))
    arrows = re.findall(r'^  (\w+) (?:-- ".*?" )?--> (\w+)$', picture, flags=re.MULTILINE)
    assert nodes == {name for arrow in arrows for name in arrow}
    assert len(picture.splitlines()) == 1 + len(nodes) + len(arrows)


def test_the_table_of_rooms_has_every_room() -> None:
    table = tables_of(section(read("docs/architecture.md"), "Rooms of the tree"))[0]
    told = {path for line in table[1:] for path in re.findall(r"`([\w/.]+)`", line[0])}
    packages = {f"{path.parent.relative_to(ROOT)}/" for path in (ROOT / "positioning").glob("*/__init__.py")}
    rooms = {"config/", "algorithms/", "positioning/", "workflow/", "profiles/", "results/", "reports/"}
    rooms |= {"data/papers/", "data/sources.csv", "tests/", "benchmarks/", "docs/"}
    assert told == rooms | packages


def test_imports_go_the_way_that_the_architecture_tells() -> None:
    later = ("positioning.evaluation", "positioning.presentation")
    for path in [*(ROOT / "positioning").rglob("*.py"), *(ROOT / "algorithms").rglob("*.py")]:
        room = ".".join(path.relative_to(ROOT).with_suffix("").parts[:2])
        if room == "positioning.presentation":
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            else:
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            forbidden = later[1:] if room in later else later
            assert [name for name in names if name.startswith(forbidden)] == [], path


def test_every_verdict_and_kind_is_explained() -> None:
    text = section(read("docs/architecture.md"), "Verdicts")
    assert [verdict for verdict in VERDICTS if f"`{verdict}`" not in text] == []
    schema = read_yaml(ROOT / "workflow/schemas/paper.schema.yaml")
    kinds = {kind.strip("` ") for line in tables_of(text)[0][1:] for kind in line[0].split(",")}
    assert kinds == set(schema["$defs"]["claim"]["properties"]["kind"]["enum"])


@pytest.mark.parametrize(
    ("heading", "columns"),
    [
        ("Tables", [*TABLE, "note", *PAIRED]),
        ("Claims", COLUMNS),
        ("Measures", MEASURES),
        ("Comparison", COMPARISON),
    ],
)
def test_every_column_is_explained(heading: str, columns: list[str]) -> None:
    text = section(read("docs/data-formats.md"), heading)
    assert [column for column in columns if f"`{column}`" not in text] == []


def test_the_columns_of_the_register_stand_in_its_guide() -> None:
    assert ",".join(REGISTER_COLUMNS) in read("docs/add-a-data-set.md")


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one batch of worlds, as the workflow writes it."""
    folder = tmp_path_factory.mktemp("worlds")
    settings = read_yaml(ROOT / "data/papers/robo_sar.yaml")["settings"]["fingerprint_loo"]
    made = simulate(
        {name: setting["value"] for name, setting in settings.items()}, [stream(1, "fingerprint_loo")]
    )
    write_worlds(folder, "fingerprint_loo", "floor", made)
    return folder


def write_worlds(folder: Path, study: str, family: str, made: Worlds) -> None:
    index = {"world": np.arange(1), "seed": np.ones(1, dtype=int)}
    target = folder / f"data/synthetic/{study}/00000"
    write_tree(target / "observed.npz", {family: {**index, **made.observed}})
    write_tree(target / "truth.npz", {family: {**index, **made.truth}})


def test_the_example_reads_worlds_with_numpy_alone(worlds: Path) -> None:
    (example,) = fenced(read("docs/data-formats.md"), "python")
    done = subprocess.run(
        [sys.executable, "-I", "-c", example], cwd=worlds, capture_output=True, text=True, check=True
    )
    found = re.fullmatch(r"mean error ([\d.]+) m, median ([\d.]+) m\n", done.stdout)
    assert found is not None
    assert 1 < float(found[2]) < float(found[1]) < 8
    assert set(re.findall(r"import (\w+)", example)) == {"numpy"}


SYNTHETIC = [
    (name, study["paper"])
    for name, study in read_yaml(ROOT / "config/config.yaml")["studies"].items()
    if "recordings" not in study
]


@pytest.mark.parametrize(("study", "paper"), SYNTHETIC)
def test_every_array_of_the_worlds_is_explained(study: str, paper: str) -> None:
    told = {
        line[0].strip("`"): line for line in tables_of(section(read("docs/data-formats.md"), "Worlds"))[0][1:]
    }
    told |= {name.strip("` "): line for line in told.values() for name in line[0].split(",")}
    settings = read_yaml(ROOT / f"data/papers/{paper}.yaml")["settings"][study]
    module = importlib.import_module(f"positioning.simulation.{study}")
    made = module.simulate({name: s["value"] for name, s in settings.items()}, [stream(1, study)])
    for side, arrays in (("observed", made.observed), ("truth", made.truth)):
        for name, values in arrays.items():
            line = told[name]
            assert line[3] in (side, "both")
            shapes = re.findall(r"\[([^]]*)\]", line[1])
            assert values.ndim in [len(shape.split(",")) for shape in shapes], name


def test_the_guide_names_the_template_and_lines_that_exist() -> None:
    guide = read("docs/add-an-algorithm.md")
    commands = "\n".join(fenced(guide, "bash"))
    assert "class Template(" in read("algorithms/fingerprinting/template.py")
    assert "algorithms/fingerprinting/template.py > algorithms/fingerprinting/my_method.py" in commands
    (line,) = set(re.findall(r'^line = "(.*)\\n"$', commands, flags=re.MULTILINE))
    config = read("config/config.yaml")
    assert config.index(line) < config.index("fingerprint_real:")
    for name in re.findall(r"sklearn[\w.]*", commands):
        module, _, cls = name.rpartition(".")
        assert hasattr(importlib.import_module(module), cls)


def test_the_example_from_python_follows_the_walk_that_it_tells(capsys: pytest.CaptureFixture[str]) -> None:
    guide = read("docs/add-an-algorithm.md")
    (example,) = fenced(guide.partition("\n## From Python\n")[2].partition("\n## ")[0], "python")
    names: dict[str, Any] = {}
    exec(compile(example, "docs/add-an-algorithm.md", "exec"), names)
    recording, calibration, beacon_m = (names[name] for name in ("recording", "calibration", "beacon_m"))
    # Its strengths are those of the law of its calibration along its commands, in whole dBm.
    heading_rad = np.cumsum(recording.turn_before_rad + recording.turn_after_rad) - recording.turn_after_rad
    step_m = recording.advance_m[:, None] * np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=-1)
    walk_m = np.array([2.0, 2.0]) + np.cumsum(step_m, axis=0)
    reference_dbm = calibration.rss_dbm[calibration.distance_m == 1.0]
    distance_m = np.linalg.norm(walk_m[:, None] - beacon_m, axis=-1)
    np.testing.assert_allclose(recording.rss_dbm, reference_dbm - 20 * np.log10(distance_m), atol=0.5)
    assert np.linalg.norm(names["track"].position_m - walk_m, axis=-1)[1:].max() < 0.75
    printed = [[float(cell) for cell in line.split()] for line in capsys.readouterr().out.splitlines()]
    assert [line[0] for line in printed] == recording.time_s.tolist()
    np.testing.assert_allclose([line[1:] for line in printed], names["track"].position_m, atol=0.0051)


def test_the_lines_of_the_guide_make_rows() -> None:
    guide = read("docs/add-an-algorithm.md")
    ranging, parts, _ = fenced(guide, "yaml")
    config = read_yaml(ROOT / "config/config.yaml")
    first, second = parts.splitlines()
    for study, lines in (("bluetooth_robot", ranging), ("access_points_real", first), ("riss_wifi", second)):
        rows = yaml.safe_load("algorithms:\n" + lines)["algorithms"]
        config["studies"][study]["algorithms"] |= rows
        assert set(rows) <= set(resolve(config, ROOT)[study].entries)


def test_every_task_of_the_guide_has_a_template_and_its_methods() -> None:
    table = tables_of(section(read("docs/add-an-algorithm.md"), "Other tasks"))[0]
    task, told = "", {}
    for line in table[1:]:
        task = line[0] or task
        told.setdefault(task, []).append(re.match(r"`(\w+)\((.*)\)`", line[1]))
    assert {*told, "fingerprinting"} == {p.parent.name for p in (ROOT / "algorithms").glob("*/template.py")}
    for task, methods in told.items():
        template = importlib.import_module(f"algorithms.{task}.template").Template
        for method, arguments in (found.groups() for found in methods if found is not None):
            if hasattr(template, method):
                known = list(inspect.signature(getattr(template, method)).parameters)[1:]
                assert known[: len(arguments.split(", "))] == arguments.split(", ")


def test_the_tracker_of_the_guide_follows_a_drive_in_spite_of_its_bias() -> None:
    guide = read("docs/add-an-algorithm.md")
    part = guide.partition("\n## A tracker with gyroscope and odometer\n")[2].partition("\n## ")[0]
    (example,) = fenced(part, "python")
    names: dict[str, Any] = {}
    exec(compile(example, "docs/add-an-algorithm.md", "exec"), names)
    time_s = (np.arange(1500) + 0.5) * 0.01
    moving = time_s > 5
    recording = Recording(
        time_s=np.arange(0.0, 15.5, 5.0),
        motion_time_s=time_s,
        gyro_rad_per_s=0.02 + np.where(time_s > 10, np.pi / 10, 0.0),
        odometer_m_per_s=np.where((time_s > 7) & (time_s < 8), np.nan, 1.0 * moving),
        start_position_m=np.array([1.0, 2.0]),
        start_heading_rad=np.pi / 2,
    )
    site = Site(corner_m=np.array([[-10.0, -10.0], [10.0, 10.0]]))
    tracker = names["MyDrive"]()
    track = tracker.track(recording, None, site, np.random.default_rng(0))
    # Five metres on, then a quarter of a circle of radius 10 / pi to the left.
    radius_m = 10 / np.pi
    expected_m = [[1, 2], [1, 2], [1, 7], [1 - radius_m, 7 + radius_m]]
    np.testing.assert_allclose(track.position_m, expected_m, atol=0.02)
    assert "odometer" in tracker.skip(replace(recording, odometer_m_per_s=None), None, site)
    observed = {**with_leading_axis(recording).to_arrays(), **with_leading_axis(site).to_arrays()}
    outcome = tracking.run(lambda **_: tracker, observed, None, {}, [np.random.default_rng(0)])
    np.testing.assert_array_equal(outcome.estimates["position_m"][0], track.position_m)


@pytest.fixture(scope="module")
def corridor(tmp_path_factory: pytest.TempPathFactory) -> tuple[Project, list[str]]:
    """A project without studies, after the files and commands of the guide to studies; what they print."""
    guide = read("docs/add-a-study.md")
    folders = {"data": "data", "results": "results", "reports": "reports", "realdata": "absent"}
    project = make_project(tmp_path_factory.mktemp("study"), {"folders": folders, "studies": {}})
    config = project.folder / "config/config.yaml"
    # The guide adds its study at the end of the configuration, in the style of the shipped one.
    assert list(read_yaml(ROOT / "config/config.yaml"))[-1] == "studies"
    assert config.read_text("utf-8").endswith("studies: {}\n")
    config.write_text(config.read_text("utf-8").replace("studies: {}", "studies:"), encoding="utf-8")
    files = re.findall(r"`([\w/]+\.\w+)`:\n\n```\w+\n(.*?)^```$", guide, flags=re.DOTALL | re.MULTILINE)
    assert len(files) == 4
    for path, text in files:
        (project.folder / path).write_text(text, encoding="utf-8")
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(project.folder),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    said = []
    for block in fenced(guide, "bash"):
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", block],
            cwd=project.folder,
            env=environment,
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
        said.append(done.stdout)
    return project, said


@pytest.mark.slow
@pytest.mark.xdist_group("study")
def test_the_guide_s_own_files_and_commands_add_a_study(corridor: tuple[Project, list[str]]) -> None:
    project, said = corridor
    verdicts = dict(re.findall(r"^ *(\S+) .*?([a-z][a-z ]+)$", said[-1].partition("\n")[2], re.MULTILINE))
    paper = read_yaml(project.folder / "data/papers/corridor.yaml")
    assert set(verdicts) == {"claim", *(claim["id"] for claim in paper["claims"])}
    assert verdicts["table1.knn.mean"].strip() == "calibrated"
    assert verdicts["cost"].strip() == "not testable"
    claims = pd.read_csv(project.folder / "results/claims/corridor.csv").set_index("claim")
    assert claims.loc["table1.knn.mean", "rebuilt"] == pytest.approx(2.9, abs=0.2)
    assert 0.5 < claims.loc["order", "rebuilt"] <= 1
    assert 0 < claims.loc["ends", "rebuilt"] < 1
    page = (project.folder / "reports/corridor.html").read_text("utf-8")
    assert "Error along the corridor" in page
    assert (project.folder / "results/figures/corridor/fig2.svg").is_file()


@pytest.mark.slow
@pytest.mark.xdist_group("study")
def test_the_guide_s_code_keeps_to_the_style(corridor: tuple[Project, list[str]]) -> None:
    folder = corridor[0].folder
    (folder / "pyproject.toml").write_text(read("pyproject.toml"), encoding="utf-8")
    files = [str(path.relative_to(folder)) for path in folder.rglob("positioning/**/corridor.py")]
    assert len(files) == 3
    for command in (["check"], ["format", "--check"]):
        subprocess.run([sys.executable, "-m", "ruff", *command, *files], cwd=folder, check=True)


@pytest.mark.slow
def test_tables_and_entries_of_the_guide_to_data_sets_make_rows(tmp_path: Path) -> None:
    """Its CSV files and its entries of the configuration, as they stand, through the workflow."""
    guide = read("docs/add-a-data-set.md")
    shipped = read_yaml(ROOT / "config/config.yaml")["studies"]
    rows = {"fingerprint_real": ["nearest_neighbour"], "bluetooth_real": ["path_loss", "pseudo_inverse"]}
    config: dict[str, Any] = {
        "folders": {"data": "data", "results": "results", "reports": "reports", "realdata": "recordings"},
        "studies": {
            study: {**shipped[study], "reference": names[0], "recordings": {}, "sweeps": {}}
            | {"algorithms": {name: shipped[study]["algorithms"][name] for name in names}}
            for study, names in rows.items()
        },
    }
    entries = [yaml.safe_load(text)["studies"] for text in fenced(guide, "yaml")]
    for study, added in [*entries[0].items(), *entries[-1].items()]:
        config["studies"][study]["recordings"] |= added["recordings"]
    project = make_project(tmp_path, config)
    survey, walk, beacons, calibration = fenced(guide, "csv")[:4]
    files = {"my_office/survey": survey, "my_hall/walk": walk}
    files |= {"my_hall/beacons": beacons, "my_hall/calibration": calibration}
    for name, text in files.items():
        assert f"`{name.rpartition('/')[2]}.csv`" in guide or f"{name}.csv`" in guide
        path = project.folder / f"recordings/{name}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    project.snakemake(*(f"results/tables/{study}.csv" for study in rows))
    for study, recording, samples in (
        ("fingerprint_real", "my_office", survey.count("\n") - 1),
        ("bluetooth_real", "my_hall", walk.count("\n") - 1),
    ):
        table = pd.read_csv(project.folder / f"results/tables/{study}.csv")
        table = table[table["family"] == recording].set_index("algorithm")
        assert list(table.index) == rows[study]
        assert table["note"].isna().all()
        assert (table["mean_m"] > 0).all()
        assert 0 < table["n"].iloc[-1] <= samples


def test_the_guide_to_data_sets_names_every_array_with_its_dimensions() -> None:
    table = next(t for t in tables_of(read("docs/add-a-data-set.md")) if t[0][0] == "array")
    told: dict[str, int] = {}
    for names, shapes, _ in table[1:]:
        part = ""
        found = re.findall(r"\[([^]]*)\]", shapes)
        listed = re.findall(r"`([\w.]+)`", names)
        found = found * len(listed) if len(found) == 1 else found + found[-1:] * (len(listed) - len(found))
        for name, shape in zip(listed, found, strict=True):
            part = name.partition(".")[0] if "." in name else part
            told[f"{part}.{name.rpartition('.')[2]}"] = len(shape.split(",")) - 1
    for part in (Site, Survey, Query, Calibration, Recording, Walks):
        text = inspect.getdoc(part) or ""
        for field in fields(part):
            name = f"{part.__name__}.{field.name}"
            assert name in told, name
            shape = re.search(
                rf"\b{field.name}\b.*?\[\.\.\.(.*?)\]", text.partition("Attributes")[2], re.DOTALL
            )
            assert shape is not None
            if "fill" not in name:
                assert told[name] == len([x for x in shape[1].split(",") if x.strip()]), name


def test_the_adapter_of_the_guide_gives_what_the_filters_need(tmp_path: Path) -> None:
    (example,) = [part for part in fenced(read("docs/add-a-data-set.md"), "python") if "Recording(" in part]
    names: dict[str, Any] = {}
    exec(compile(example, "docs/add-a-data-set.md", "exec"), names)
    time_s = np.arange(0.05, 20, 0.1)
    speed = np.where(time_s > 5, 0.4, 0.0)
    place_m = np.stack(np.meshgrid(np.arange(0.0, 7, 2), np.arange(-2.0, 3, 2)), axis=-1).reshape(-1, 2)
    scan_s = np.arange(0.0, 20)
    scan_m = np.stack([np.maximum(scan_s - 5, 0) * 0.4, np.zeros(20)], axis=-1)

    def heard(position_m: Any) -> Any:
        beacon_m = np.array([[0.0, -3], [6, -3], [0, 3], [6, 3]])
        return -40 - 5 * np.linalg.norm(position_m[:, None] - beacon_m, axis=-1)

    for name, columns in (
        ("motion", [time_s, np.full(len(time_s), 0.5), speed]),
        ("scans", [scan_s, scan_m, heard(scan_m)]),
        ("survey", [place_m, heard(place_m)]),
    ):
        np.savetxt(tmp_path / f"{name}.csv", np.column_stack(columns), delimiter=",", header="x", comments="")
    worlds = names["load"](tmp_path)
    for use in ("riss", "riss_particle_filter", "riss_kalman_filter"):
        outcome = tracking.run(
            factory(use, "tracking", {}), worlds.observed, None, {}, [np.random.default_rng(0)]
        )
        assert outcome.skipped == ""
        error_m = tracking.score(outcome.estimates, worlds.truth)["error_m"]
        assert error_m.max() < (0.05 if use == "riss" else 2.5), use


# Papers of the project itself


def test_citation_changes_and_licence_agree_with_the_package() -> None:
    project = read("pyproject.toml")
    version = re.search(r'^version = "(.*)"$', project, flags=re.MULTILINE)
    assert version is not None
    citation = yaml.safe_load(read("CITATION.cff"))
    assert {"cff-version", "message", "title", "authors", "version", "license", "references"} <= set(citation)
    assert citation["title"] == "Reposition"
    assert citation["version"] == version[1]
    assert f'license = "{citation["license"]}"' in project
    paper = read_yaml(ROOT / "data/papers/robo_sar.yaml")
    assert paper["title"] in [reference["title"] for reference in citation["references"]]
    assert re.search(
        rf"^## ({re.escape(version[1])}\b|[Uu]nreleased)", read("CHANGELOG.md"), flags=re.MULTILINE
    )
    licence = read("LICENSE")
    assert citation["license"] == "BSD-3-Clause"
    assert licence.startswith("BSD 3-Clause License")
    assert len(re.findall(r"^[123]\. ", licence, flags=re.MULTILINE)) == 3
    assert "Neither the name" in licence


def test_hooks_are_local_and_continuous_integration_calls_the_same_script() -> None:
    hooks = yaml.safe_load(read(".pre-commit-config.yaml"))
    assert [repository["repo"] for repository in hooks["repos"]] == ["local"]
    for hook in hooks["repos"][0]["hooks"]:
        assert hook["language"] == "system"
        assert hook["entry"].startswith(".venv/bin/python -m ")
    steps = yaml.safe_load(read(".github/workflows/ci.yml"))["jobs"]["all"]["steps"]
    assert steps[-1]["run"] == "bash .ci/run"
    assert (ROOT / ".ci/run").is_file()


def test_the_register_is_named_with_its_licences() -> None:
    with (ROOT / "data/sources.csv").open(encoding="utf-8", newline="") as lines:
        assert all(row["licence"] for row in csv.DictReader(lines))
    assert "data/sources.csv" in read("README.md")
