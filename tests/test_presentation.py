"""Figures, tables and pages from a small invented study."""

import dataclasses
import importlib.util
import itertools
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from positioning.errors import InputError
from positioning.evaluation import measures as m
from positioning.evaluation.claims import VERDICTS, judge
from positioning.evaluation.results import StudyResults, read_row_errors
from positioning.files import read_yaml, write_errors, write_json, write_tree
from positioning.presentation import figures, pages, recorded, tables
from positioning.presentation.claim_lines import claim_line
from positioning.presentation.study_figures import default_figures, draw
from positioning.presentation.style import KNOWN, contrast, difference, drawing, stroke, strokes
from positioning.presentation.svg import inline_svg
from positioning.presentation.tones import PALETTES, TONES

ROOT = Path(__file__).resolve().parents[1]
STUDY = "fingerprint_loo"
WORLDS, SAMPLES = 40, 30
MEANS = {"wknn": 3.0, "knn": 3.3, "rbf_resubstitution": 2.0, "control_oracle": 1.5, "control_centre": 11.0}
SWEEP = ("k", (1.0, 4.0, 10.0))
NASTY = 'orders <b>bold</b> & "quotes" | 50 % of $x_1$'
VOID = {"meta", "br", "link", "img", "hr", "input", "wbr"}


class Page(HTMLParser):
    """Checks that elements nest, and collects what a reader gets."""

    def __init__(self, text):
        super().__init__()
        self.open, self.names, self.links, self.drawings, self.words, self.tables = [], [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        self.names += [values["id"]] if "id" in values else []
        self.links += [values["href"]] if "href" in values else []
        self.links += [values["src"]] if "src" in values else []
        if tag == "svg":
            self.drawings.append(values)
        if tag == "table":
            self.tables.append({"caption": False, "unscoped": 0})
        if tag == "caption":
            self.tables[-1]["caption"] = True
        if tag == "th" and "scope" not in values:
            self.tables[-1]["unscoped"] += 1
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.handle_endtag(tag)

    def handle_endtag(self, tag):
        assert self.open[-1:] == [tag], f"</{tag}> closes nothing"
        self.open.pop()

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def script(name):
    """A rule's script as a module; names like ``figures`` are too common to import by path."""
    spec = importlib.util.spec_from_file_location(f"script_{name}", ROOT / "workflow/scripts" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def errors_file(folder, row, mean, values=(np.nan,), families=("floor",), skipped=None):
    shape = (len(families), len(values), WORLDS, SAMPLES)
    rng = np.random.default_rng(len(row))
    spread = rng.rayleigh(1 / np.sqrt(np.pi / 2), shape) * rng.normal(1, 0.05, (*shape[:3], 1))
    grid = np.meshgrid(*(np.arange(n) for n in shape), indexing="ij")
    shift = 1 + 0.2 * np.abs(np.arange(len(values)) - 1)[None, :, None, None] * (len(values) > 1)
    columns = {
        "family": np.asarray(families, dtype=np.str_)[grid[0].ravel()],
        "value": np.asarray(values, dtype=float)[grid[1].ravel()],
        "world": grid[2].ravel().astype(np.int32),
        "sample": grid[3].ravel().astype(np.int32),
        "error_m": (mean * shift * spread).ravel(),
    }
    path = folder / "errors" / STUDY / row / "00000.parquet"
    path.parent.mkdir(parents=True)
    keep = ~np.isin(columns["family"], list(skipped or {}))
    write_errors(path, {name: values[keep] for name, values in columns.items()}, skipped or {})
    return str(path)


def invented_paper():
    quantity = {"algorithm": "wknn", "metric": "mean_m"}
    other = {"algorithm": "knn", "metric": "mean_m"}
    value = {"study": STUDY, "kind": "value", "unit": "m"}
    return {
        "key": "invented",
        "short": "Invented",
        "authors": "A & B",
        "title": NASTY,
        "settings": {
            STUDY: {
                "points": {"value": 257, "unit": "places", "where": "section 6"},
                "noise_db": {"value": 4.5, "unit": "dB", "assumed": True, "why": "not printed <at all>"},
            }
        },
        "readings": {STUDY: [{"equation": "66", "problem": NASTY, "used": "ln d"}]},
        "claims": [
            {
                **value,
                "id": "t.wknn",
                "where": "Table 1",
                "what": NASTY,
                "printed": "3.00",
                "quantity": quantity,
            },
            {
                **value,
                "id": "t.knn",
                "where": "Table 1",
                "what": "mean",
                "printed": "7.10",
                "quantity": other,
            },
            {
                **value,
                "id": "t.knn.p50",
                "where": "Table 1",
                "what": "median",
                "printed": "3.1",
                "quantity": {**other, "metric": "p50_m"},
            },
            {
                **value,
                "id": "fig2.knn.k",
                "where": "6",
                "what": "best k",
                "unit": "",
                "printed": "4",
                "quantity": {"sweep": "knn_k", "argmin": "mean_m"},
            },
            {
                "id": "order",
                "study": STUDY,
                "where": "6",
                "what": "wknn < knn",
                "kind": "ordering",
                "quantities": [
                    {"algorithm": a, "metric": "p75_m"} for a in ("control_oracle", "control_centre")
                ],
            },
            {
                "id": "w",
                "study": STUDY,
                "where": "6",
                "what": "it is fast",
                "kind": "words",
                "reason": "no number",
            },
        ],
    }


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """All inputs of the three scripts, and what these make of them."""
    folder = tmp_path_factory.mktemp("study")
    paper = invented_paper()
    (folder / "paper.yaml").write_text(yaml.safe_dump(paper))
    rows = [*MEANS, "svm"]
    paths = {row: errors_file(folder, row, mean) for row, mean in MEANS.items()}
    paths["svm"] = errors_file(folder, "svm", 3.0, skipped={"floor": "kernel <too> large & slow"})
    paths["knn_k"] = errors_file(folder, "knn_k", 3.0, SWEEP[1])
    errors, skipped = {}, {}
    for row, path in paths.items():
        errors[row], reasons = read_row_errors([path])
        skipped |= {(family, row): reason for family, reason in reasons.items()}
    measures = pd.concat([m.measure(errors[row], row) for row in paths if row != "svm"], ignore_index=True)
    measures.to_parquet(folder / "measures.parquet")
    claims = judge(
        paper["claims"],
        measures,
        paper="invented",
        study=STUDY,
        family="floor",
        calibrated={"t.wknn": "sets noise"},
    )
    times = pd.DataFrame(
        {
            "family": "floor",
            "algorithm": rows[0],
            "value": np.nan,
            "world": range(3),
            "seconds": [0.1, 0.25, 9],
        }
    )
    own = measures[measures["value"].isna()]
    frames = {
        "table": m.table(own, rows, ["floor"], skipped, m.published_numbers(paper["claims"], ["floor"])),
        "paired": m.paired(errors, rows, ["floor"]),
        "times": times,
        "claims": claims,
    }
    for name, frame in frames.items():
        frame.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g")
    places = np.random.default_rng(0).uniform(0, 20, (2, SAMPLES, 2))
    index = {"world": np.arange(2), "seed": np.arange(2)}
    observed = {
        "site.corner_m": np.tile([[0.0, 0.0], [20.0, 20.0]], (2, 1, 1)),
        "site.access_point_m": places[:, :3],
        "site.wall_m": np.tile([[[0.0, 5.0], [20.0, 5.0]], [[np.nan] * 2] * 2], (2, 1, 1, 1)),
        "survey.position_m": places,
    }
    write_tree(folder / "observed.npz", {"floor": {**index, **observed}})
    write_tree(folder / "truth.npz", {"floor": {**index, "truth.field_dbm": -places[..., [0, 1, 1]]}})
    steps = {
        "setting": "noise_db",
        "family": None,
        "value": 4.321,
        "row": "wknn",
        "metric": "mean_m",
        "claim": "t.wknn",
    }
    steps |= {"printed": "3.00", "reached": 3.0003, "worlds": 20, "first_seed": 900, "settings_tried": 7}
    write_json(folder / "calibration.json", [steps])
    known = pd.DataFrame({"task": "fingerprinting", "algorithm": [row for row in rows if row != "knn"]})
    known.to_csv(folder / "algorithms.csv", index=False)
    write_json(
        folder / "manifest.json",
        {
            "commit": "0abc",
            "dirty": True,
            "packages": {"numpy": "2.4"},
            "seconds_by_rule": {"simulate": 1.5, "run": 12.0},
        },
    )
    plan = {
        "title": "Invented & <odd>",
        "paper": "invented",
        "figure": "table1",
        "entries": {row: {"use": row, "parameters": {"k": 6}, "options": {}} for row in rows},
        "families": {"floor": {"points": 30, "noise_db": 4.5}},
        "recordings": {},
        "worlds": WORLDS,
        "first_seed": 1000,
        "sweeps": {"knn_k": ["k", list(SWEEP[1])]},
        "reference": "wknn",
        "quick": False,
    }
    plan["entries"]["rbf_resubstitution"]["options"] = {"protocol": "resubstitution"}
    arguments = {
        "rows": rows,
        "sweeps": {"knn_k": ["k", list(SWEEP[1])]},
        "measures": str(folder / "measures.parquet"),
        "errors": list(paths.values()),
        "worlds": {side: str(folder / f"{side}.npz") for side in ("observed", "truth")},
        "paper": str(folder / "paper.yaml"),
    }
    script("figures").main(STUDY, **arguments, output=str(folder / "figures"))
    build = {"folder": folder, "plan": plan, "paper": paper, "figures": arguments, "claims": claims}
    return {**build, **render(build, "first"), "again": render(build, "second")}


def render(build, name, **changes):
    folder, out = build["folder"], build["folder"] / name
    names = ("table", "paired", "times", "claims")
    inputs = {n: str(folder / f"{n}.csv") for n in names} | {"sources": None}
    inputs |= {"figures": str(folder / "figures"), "paper": str(folder / "paper.yaml")}
    inputs["accepted"] = str(folder / "algorithms.csv")
    inputs |= {n: str(folder / f"{n}.json") for n in ("calibration", "manifest")}
    plan = {**build["plan"], **changes}
    endings = {"html": "html", "markdown": "md", "latex": "tex"}
    output = {kind: str(out / f"{STUDY}.{ending}") for kind, ending in endings.items()}
    script("page").main(STUDY, inputs, plan, output)
    files = {"tables": [inputs["table"]], "figures": [inputs["figures"]], "papers": [inputs["paper"]]}
    names = {"html": "index.html", "claims": "claims.html", "method": "method.html"}
    names |= {"csv": "claims.csv", "markdown": "claims.md"}
    written = {kind: str(out / file) for kind, file in names.items()}
    script("index").main({STUDY: plan}, files, inputs["claims"], inputs["manifest"], written)
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(out.iterdir())}


PAGES = (f"{STUDY}.html", "index.html", "claims.html", "method.html")


@pytest.fixture(scope="module", params=PAGES)
def page(request, built):
    return built[request.param]


def test_equal_inputs_give_equal_bytes(built):
    for name, text in built["again"].items():
        assert text == built[name], name


def test_figures_drawn_twice_are_equal_and_replace_what_was_there(built):
    folder = built["folder"] / "figures_again"
    folder.mkdir()
    (folder / "old.svg").write_text("old")
    script("figures").main(STUDY, **built["figures"], output=str(folder))
    first = {path.name: path.read_bytes() for path in (built["folder"] / "figures").iterdir()}
    assert first == {path.name: path.read_bytes() for path in folder.iterdir()}
    assert {"world.svg", "world.pdf", "knn_k.svg", "fig3.svg", "table1.pdf", "paired.svg"} < first.keys()
    assert not list(built["folder"].glob(".tmp-*"))


def test_pages_are_whole_and_accessible(page):
    found = Page(page)
    assert '<html lang="en">' in page
    assert len(found.names) == len(set(found.names))
    assert all(table == {"caption": True, "unscoped": 0} for table in found.tables)
    shown = [values for values in found.drawings if values.get("aria-hidden") != "true"]
    assert bool(shown) == ("Mean" in found.text or "drawn to scale" in found.text)
    assert all(values["role"] == "img" and len(values["aria-label"]) > 10 for values in shown)
    assert all(link[1:] in found.names for link in found.links if link.startswith("#"))


def test_pages_need_no_network(page):
    assert "http" not in page.lower()
    assert "@import" not in page
    assert "src=" not in page
    assert "@font-face" not in page
    inside = ("#", "data:")
    beside = {*PAGES, "comparison.html", "reposition.pdf", "claims.csv", "claims.md"}
    files = {re.split("[?#]", link)[0] for link in Page(page).links if not link.startswith(inside)}
    assert files <= beside
    assert len(page.encode()) < 3_000_000


@pytest.mark.parametrize("name", [f"{STUDY}.html", "index.html", "claims.html"])
def test_special_characters_are_shown_and_not_obeyed(built, name):
    assert "<b>bold" not in built[name]
    assert NASTY in Page(built[name]).text


def test_every_verdict_stands_in_words(built):
    words = set(built["claims"]["verdict"])
    assert words == {"calibrated", "not reproduced", "reproduced", "holds", "not testable"}
    for name in (f"{STUDY}.html", "claims.html", "method.html"):
        for word in words:
            assert f'{TONES[word]}">{word}</span>' in built[name]


def test_answer_counts_the_verdicts(built):
    told = Page(built[f"{STUDY}.html"]).text
    assert (
        "Of 6 claims, judged on 40 synthetic worlds, 2 are reproduced, 1 holds, 1 is not reproduced," in told
    )
    assert "1 set a free setting and counts for nothing and 1 cannot be tested here." in told


def test_study_page_tells_setting_calibration_skips_and_build(built):
    told = Page(built[f"{STUDY}.html"]).text
    assert "No errors: svm (kernel <too> large & slow)." in told
    assert "noise_db = 4.321 was set so that mean_m of wknn is the printed 3.00" in told
    assert "4.321 calibrated" in told
    assert "after 7 values tried" in told
    assert "0abc" in told
    assert "numpy = 2.4" in told
    assert "run 12 s 89 % simulate 1.5 s 11 % all 14 s 100 %" in told
    assert "250 ms" in told


def test_best_row_is_no_control_and_no_resubstitution(built):
    told = Page(built[f"{STUDY}.html"]).text
    assert "Differences to wknn , the reference row, the best row" in told
    assert "Differences to rbf_resubstitution" not in told
    assert "Differences to control_oracle" not in told


def test_rows_of_ones_own_are_marked_as_new(built):
    marked = re.findall(r'<tr class="new"><th scope="row"><code>(\w+)', built[f"{STUDY}.html"])
    assert marked == ["knn"] * 3, "errors, paired differences, settings"
    told = Page(built[f"{STUDY}.html"]).text
    assert "Marked new : knn , not in the project" in told


def test_quick_builds_say_so(built):
    quick = render(built, "quick", quick=True)
    for name in PAGES:
        assert "39 worlds decide" in Page(quick[name]).text
        assert "39 worlds decide" not in Page(built[name]).text


def test_markdown_and_latex_hold_the_numbers(built):
    table = tables.read_table(built["folder"] / "table.csv").set_index("algorithm")
    judged = built["claims"].set_index("claim")
    rebuilt = f"{table.loc['knn', 'mean_m']:.2f}"
    low, high = (f"{judged.loc['t.knn', end]:.2f}" for end in ("low", "high"))
    line = next(line for line in built[f"{STUDY}.md"].splitlines() if line.startswith("| `knn` |"))
    assert line.startswith(f"| `knn` | {rebuilt} ({low} to {high}); printed 7.10: not reproduced |")
    row = next(row for row in built[f"{STUDY}.tex"].splitlines() if row.startswith("\\texttt{knn}"))
    assert row.startswith(f"\\texttt{{knn}} & {rebuilt}$^{{n}}$ & ")
    assert f"{row}\n & (7.10) & (3.1) & " in built[f"{STUDY}.tex"]
    assert "\\texttt{control\\_oracle}" in built[f"{STUDY}.tex"]
    assert "Invented \\& \\textless{}odd\\textgreater{}" in built[f"{STUDY}.tex"]


def test_latex_rows_have_as_many_cells_as_columns(built):
    lines = [
        line for line in built[f"{STUDY}.tex"].splitlines() if line.endswith("\\\\") and "multi" not in line
    ]
    columns = next(line for line in built[f"{STUDY}.tex"].splitlines() if "begin{tabular}" in line)
    count = len(columns.removeprefix("\\begin{tabular}{").rstrip("}"))
    assert lines
    assert {line.replace("\\&", "").count("&") + 1 for line in lines} == {count}


def test_markdown_tables_are_rectangular_despite_bars_in_texts(built):
    for name in ("claims.md", f"{STUDY}.md"):
        blocks = built[name].split("\n\n")
        for block in blocks:
            widths = {
                line.replace("\\|", "").count("|") for line in block.strip().splitlines() if line[0] == "|"
            }
            assert len(widths) <= 1, block
    assert "&lt;b>bold" in built["claims.md"]


def test_ledger_is_passed_on_unchanged(built):
    assert built["claims.csv"] == (built["folder"] / "claims.csv").read_text()


def test_printed_digits_survive_reading(built):
    table = tables.read_table(built["folder"] / "table.csv").set_index("algorithm")
    assert table.loc["knn", "published_mean_m"] == "7.10"
    assert np.isnan(table.loc["svm", "mean_m"])
    assert tables.read_table(built["folder"] / "claims.csv")["printed"].iloc[0] == "3.00"


def test_study_without_a_module_gets_common_figures(built):
    arguments = built["figures"]
    results = StudyResults(
        study="another",
        rows=tuple(arguments["rows"]),
        sweeps={},
        measures=pd.read_parquet(arguments["measures"]),
        error_files=tuple(arguments["errors"]),
        observed={"floor": {}},
        truth={"floor": {}},
        paper=read_yaml(arguments["paper"]),
    )
    drawn = draw(results)
    assert [item.name for item in drawn] == ["error_distribution", "mean_error"]
    assert all(f"n = {SAMPLES} samples in each of {WORLDS} worlds" in item.caption for item in drawn)
    assert all(item.alt for item in drawn)


def tall(in_of: dict[str, float]):
    return figures.parts(list(in_of), lambda some: 1.0 + sum(in_of[family] for family in some))


def test_figures_too_tall_for_a_page_are_divided():
    whole = tall({"a": 3.0, "b": 3.0})
    assert whole == [figures.Part("", "", ["a", "b"])]
    assert tall({}) == []
    limit_in = figures.TALLEST_IN
    # A single one may be too tall; those at the limit still fit.
    found = tall({"a": 2 * limit_in, "b": limit_in / 2 - 0.5, "c": limit_in / 2 - 0.5, "d": 0.1})
    assert found == [
        figures.Part("", ", 1 of 3", ["a"]),
        figures.Part("_2", ", 2 of 3", ["b", "c"]),
        figures.Part("_3", ", 3 of 3", ["d"]),
    ]


@pytest.mark.parametrize("study", ["another", "fingerprint_real"])
def test_many_families_have_several_figures_that_show_each_once(tmp_path, study):
    sites = [f"site_{number}" for number in range(24)]
    rows = tuple(MEANS)
    paths = [errors_file(tmp_path, row, MEANS[row], families=sites) for row in rows]
    measured = [m.measure(read_row_errors([path])[0], row) for row, path in zip(rows, paths, strict=True)]
    results = StudyResults(
        study=study,
        rows=rows,
        sweeps={},
        measures=pd.concat(measured, ignore_index=True),
        error_files=tuple(paths),
        observed={site: {} for site in sites},
        truth={site: {} for site in sites},
    )
    drawn = draw(results)
    means = [item for item in drawn if item.name.startswith("mean_error")]
    assert len({item.name for item in drawn}) == len(drawn)
    assert len(means) > 1
    assert all(item.figure.get_size_inches()[1] <= figures.TALLEST_IN for item in drawn)
    titles = [axes.get_title(loc="left") for item in means for axes in item.figure.axes if axes.get_visible()]
    assert [title.split(" (")[0] for title in titles] == sites


def test_captions_tell_samples_and_worlds(built):
    for line in json.loads((built["folder"] / "figures" / "captions.json").read_text()):
        assert f"n = {SAMPLES}" in line["caption"], line
        assert f"{WORLDS}" in line["caption"], line
        assert line["alt"]


def test_captions_name_rows_that_ran_in_fewer_worlds(built):
    arguments = built["figures"]
    measures = pd.read_parquet(arguments["measures"])
    observed, truth = (
        {"floor": {**dict.fromkeys(("world", "seed"), np.arange(2)), **values}}
        for values in (
            {
                "site.corner_m": np.tile([[0.0, 0.0], [20.0, 20.0]], (2, 1, 1)),
                "site.access_point_m": np.ones((2, 3, 2)),
                "site.wall_m": np.full((2, 1, 2, 2), np.nan),
                "survey.position_m": np.ones((2, SAMPLES, 2)),
            },
            {"truth.field_dbm": np.full((2, SAMPLES, 3), -60.0)},
        )
    )
    results = StudyResults(
        study=STUDY,
        rows=tuple(arguments["rows"]),
        sweeps={},
        measures=measures[(measures["algorithm"] != "wknn") | (measures["world"] < 10)],
        error_files=tuple(arguments["errors"]),
        observed=observed,
        truth=truth,
        paper=read_yaml(arguments["paper"]),
    )
    assert figures.fewer_worlds(results, "floor") == {"wknn": "the first 10"}
    shown = (figures.few_worlds(results, ["floor"], rows) for rows in (["wknn", "knn"], ["knn"]))
    few = "On fewer worlds: wknn in the first 10, bar: central 82 % of single experiments."
    assert list(shown) == [f" {few}", ""]
    kept = measures[(measures["algorithm"] != "wknn") | (measures["world"] > 9)]
    later = dataclasses.replace(results, measures=kept)
    assert figures.fewer_worlds(later, "floor") == {"wknn": f"{WORLDS - 10} of them"}
    told = {item.name: item for item in draw(results)}
    assert f"in each of {WORLDS} worlds (wknn in the first 10)" in told["fig3"].caption
    assert f"{WORLDS} worlds. {few}" in told["table1"].caption
    assert f"{WORLDS} worlds. On fewer worlds: wknn in the first 10." in told["paired"].caption
    assert f"World 1 of {WORLDS}" in told["world"].caption
    assert "\N{MINUS SIGN}60 dBm" in told["world"].alt


def test_curves_of_a_distribution_differ_by_markers_and_show_where_they_are_one(built):
    arguments = built["figures"]
    rows = tuple(arguments["rows"])
    results = StudyResults(
        study="another",
        rows=rows,
        sweeps={},
        measures=pd.read_parquet(arguments["measures"]),
        error_files=tuple(arguments["errors"]),
        observed={},
        truth={},
    )
    axes = figures.new_figure(3).subplots()
    figures.distribution(axes, results, "floor", [row for row in rows if row != "svm"])
    lines = {line.get_label(): line for line in axes.get_lines()}
    assert {row: line.get_marker() for row, line in lines.items()} == {
        row: stroke(row).marker for row in lines
    }
    starts = [line.get_markevery()[0] for line in lines.values()]
    assert len(set(starts)) == len(starts)
    assert lines["rbf_resubstitution"].get_zorder() > lines["wknn"].get_zorder()


def test_real_recordings_have_a_panel_each(built, tmp_path):
    recordings = ("hall", "roof")
    paths = [
        errors_file(tmp_path, "wknn", 3.0, families=recordings),
        errors_file(tmp_path, "knn", 4.0, families=recordings, skipped={"roof": "no walls"}),
    ]
    rows = ("wknn", "knn")
    measured = [m.measure(read_row_errors([path])[0], row) for row, path in zip(rows, paths, strict=True)]
    results = StudyResults(
        study="fingerprint_real",
        rows=rows,
        sweeps={},
        measures=pd.concat(measured, ignore_index=True),
        error_files=tuple(paths),
        observed={name: {} for name in recordings},
        truth={},
    )
    drawn = {item.name: item for item in draw(results)}
    assert drawn.keys() == {"error_distribution", "mean_error"}
    for item in drawn.values():
        titles = [axes.get_title(loc="left") for axes in item.figure.axes]
        assert titles == [f"{name} (n = {SAMPLES})" for name in recordings]
    hall, roof = drawn["error_distribution"].figure.axes
    assert [len(axes.get_lines()) for axes in (hall, roof)] == [2, 1]


def test_sweep_draws_mean_over_worlds_and_printed_optimum(built):
    arguments = built["figures"]
    results = StudyResults(
        study=STUDY,
        rows=tuple(arguments["rows"]),
        sweeps={"knn_k": SWEEP},
        measures=pd.read_parquet(arguments["measures"]),
        error_files=tuple(arguments["errors"]),
        observed={"floor": {}},
        truth={},
        paper=built["paper"],
    )
    line = figures.curve(results, "knn_k")
    expected = results.curve("knn_k").to_numpy()
    assert line.best == 4.0
    np.testing.assert_allclose(line.mean_m, expected.mean(axis=1))
    assert np.all(line.low_m < line.mean_m)
    assert np.all(line.mean_m < line.high_m)
    with drawing():
        axes = figures.new_figure(3).subplots()
        figures.sweep_panel(axes, line, color="#000000", label="k", optimum="4")
    assert [text.get_text() for text in axes.texts] == ["printed optimum 4"]


def test_axis_is_cut_behind_competing_rows_and_says_what_lies_beyond():
    axes = figures.new_figure(3).subplots()
    axes.plot([1, 2, 50], [0, 1, 2], "o")
    figures.keep_in_reach(
        axes, {"a": 1.0, "b": 2.0, "control_centre": 50.0}, {"a": 1.5, "b": 2.5, "control_centre": 60}
    )
    assert 2.5 < axes.get_xlim()[1] < 50
    assert [text.get_text() for text in axes.texts] == ["50.00 m \N{RIGHTWARDS ARROW}"]


def test_figure_without_words_for_it_is_refused(tmp_path):
    line = {"name": "fig1", "title": "t", "caption": "c", "alt": " "}
    (tmp_path / "captions.json").write_text(json.dumps([line]))
    with pytest.raises(InputError, match="fig1"):
        pages.read_pictures(tmp_path, STUDY)


def test_known_rows_have_distinct_colours_that_can_be_seen():
    colors = [look.color for look in KNOWN.values()]
    assert len(set(colors)) == len(colors)
    assert all(contrast(color, "#ffffff") >= 3 for color in colors)
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    rows = {row for study in config["studies"].values() for row in study["algorithms"]}
    assert len({stroke(row).color for row in rows}) == len(rows)


def test_unknown_rows_have_a_stable_visible_colour():
    names = [f"algorithm_{letter}" for letter in "abcdefghijkl"]
    assert [stroke(name) for name in names] == [stroke(name) for name in names]
    assert len({stroke(name).color for name in names}) > 8
    assert all(contrast(stroke(name).color, "#ffffff") >= 3 for name in names)


def test_unknown_rows_of_one_figure_are_told_apart_and_known_ones_keep_their_stroke():
    rows = ["wknn", *(f"mine_{number}" for number in range(8)), "svm"]
    found = strokes(rows)
    assert found == strokes(rows)
    assert found["wknn"] == KNOWN["wknn"]
    assert found["svm"] == KNOWN["svm"]
    for first, second in itertools.combinations(rows, 2):
        assert difference(found[first].color, found[second].color) > 15
    assert len({found[row][1:] for row in rows}) > 6
    with drawing(rows):
        assert [stroke(row) for row in rows] == [found[row] for row in rows]
    assert stroke("mine_3") != found["mine_3"]


@pytest.mark.parametrize("study", ["riss_real", "access_points_real"])
def test_rows_of_real_studies_are_told_apart(study):
    rows = yaml.safe_load((ROOT / "config/config.yaml").read_text())["studies"][study]["algorithms"]
    assert set(rows) <= set(KNOWN)
    for first, second in itertools.combinations(rows, 2):
        assert difference(KNOWN[first].color, KNOWN[second].color) > 10, (first, second)
        assert (
            KNOWN[first][1:] != KNOWN[second][1:] or difference(KNOWN[first].color, KNOWN[second].color) > 25
        ), (first, second)


def test_metres_counts_and_run_times_have_readable_digits():
    assert [tables.metres(value) for value in (0.05, 0.1, 1.2345, float("nan"))] == [
        "0.050",
        "0.10",
        "1.23",
        tables.NOTHING,
    ]
    assert [pages._seconds(value) for value in (0.0012, 0.05, 0.25, 0.9, 2.345, 12.4, 130)] == [
        *("1.2 ms", "50 ms", "250 ms", "900 ms", "2.3 s", "12 s", "130 s")
    ]
    line = {"claim": "a", "printed": "31", "unit": "iterations", "worlds": 40}
    told = claim_line({**line, "rebuilt": 30.6, "low": 20.2, "high": 41.7}, {"a": "value"})
    assert (told["rebuilt"], told["span"]) == ("31", "20 to 42")


def test_rows_with_other_samples_are_named_in_captions():
    rows = ("a", "b", "c")
    lines = [("plaza", row, np.nan, 0, "n", float(n)) for row, n in zip(rows, (431, 531, 531), strict=True)]
    results = StudyResults(
        study="riss_real",
        rows=rows,
        sweeps={},
        measures=pd.DataFrame(lines, columns=m.MEASURES),
        error_files=(),
        observed={},
        truth={},
    )
    assert figures.sample_counts(results, "plaza", rows) == "n = 531 samples (431 of a)"
    assert "other samples" in figures.differ(results, ["plaza"])
    assert recorded._different(results, ["plaza"], rows).startswith(
        " plaza: n = 531 samples (431 of a). Rows"
    )
    assert (
        figures.differ(results, ["plaza"], ["b", "c"]) == recorded._different(results, ["plaza"], ["b"]) == ""
    )


def test_a_figure_of_single_recordings_speaks_of_no_interval(built):
    arguments = built["figures"]
    results = StudyResults(
        study="another",
        rows=tuple(arguments["rows"]),
        sweeps={},
        measures=pd.read_parquet(arguments["measures"]),
        error_files=tuple(arguments["errors"]),
        observed={"floor": {}},
        truth={},
    )
    assert "single experiments" in default_figures(results)[-1].caption
    one = dataclasses.replace(results, measures=results.measures[results.measures["world"] == 0])
    caption = default_figures(one)[-1].caption
    assert "single experiments" not in caption
    assert "world" not in caption


def test_what_calibration_means_is_said_once(built):
    told = Page(built[f"{STUDY}.html"]).text
    assert told.count("by construction and counts for nothing") == 1


def test_every_verdict_has_a_tone_of_enough_contrast_and_a_sentence():
    assert set(VERDICTS) == set(TONES) == set(pages.PREDICATES)
    assert all(contrast(text, box) >= 4.5 for tones in PALETTES.values() for text, box in tones.values())
    assert contrast("#000000", "#ffffff") == pytest.approx(21)


def test_drawing_leaves_the_users_settings_alone():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    with drawing():
        assert mpl.rcParams["svg.hashsalt"] == "reposition"
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize(
    ("value", "printed", "shown"),
    [
        (3.14159, "3.1", "3.14"),
        (3.0, "", "3.00"),
        (-0.004, "", "\N{MINUS SIGN}0.00"),
        (np.nan, "", tables.NOTHING),
    ],
)
def test_numbers_have_the_printed_decimals_and_two_at_least(value, printed, shown):
    assert tables.decimals(value, printed) == shown


def test_inline_drawing_has_names_of_its_own_and_no_outside_reference():
    svg = '<?xml version="1.0"?><svg xmlns:xlink="http://x" viewBox="0 0 1 1" version="1.1">'
    svg += "<metadata>http</metadata>"
    svg += '<path id="p"/><use xlink:href="#p" clip-path="url(#p)"/></svg>'
    found = inline_svg(svg, "fig9", 'say "so" & <go>')
    assert found.startswith(
        '<svg viewBox="0 0 1 1" role="img" aria-label="say &quot;so&quot; &amp; &lt;go&gt;">'
    )
    assert 'id="fig9-p"' in found
    assert 'href="#fig9-p" clip-path="url(#fig9-p)"' in found
    assert "http" not in found


@pytest.mark.parametrize(("worlds", "share"), [(1, 0), (4, 60), (38, 95), (39, 95), (1000, 95)])
def test_few_worlds_promise_less_than_95_percent(worlds, share):
    assert tables.central(worlds) == f"central {share} % of single experiments"


def test_rows_on_fewer_worlds_have_a_coverage_of_their_own():
    worlds = {"a": 40, "b": 20, "c": 38, "d": 20, "single": 1}
    assert tables.central_of(worlds) == "central 95 % of single experiments (b, d: central 90 %)"
    assert tables.central_of({"a": 40}) == tables.central(40)
    assert tables.central_of({}) == tables.central(1)
