"""Front page, claims page, method page and PDF: counts, drawings and links."""

import math
import re
from collections import Counter
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from conftest import ROOT
from hypothesis import given
from hypothesis import strategies as st

from positioning.evaluation.claims import CONDITIONS, VERDICTS
from positioning.files import read_yaml, write_json
from positioning.presentation import front, ledger, method, pages, pdf, tables
from positioning.presentation.claim_lines import WIDTH, drawn, figure_of
from positioning.presentation.tones import GROUPS, TONES

PAPERS = {
    key: {"key": key, "short": key.title(), "authors": "A & B", "title": f"On {key}", "claims": []}
    for key in ("first", "second")
}


def ledger_of(verdicts: dict[str, list[str]]) -> pd.DataFrame:
    """A ledger of two papers with a study each; verdicts by paper."""
    lines = [
        {
            "claim": f"fig{number}.{paper}",
            "paper": paper,
            "study": f"{paper}_study",
            "where": f"Fig. {number}",
            "what": "mean error <b>",
            "unit": "m",
            "printed": "3.0",
            "rebuilt": 2.5,
            "low": 2.0,
            "high": 4.0,
            "worlds": 40,
            "verdict": verdict,
            "reason": f"because of {number}",
        }
        for paper, found in verdicts.items()
        for number, verdict in enumerate(found)
    ]
    return pd.DataFrame(lines)


FOUND = {"first": ["reproduced"] * 9 + ["fails", "calibrated"], "second": ["depends", "holds", "holds"]}


def summaries() -> list[front.Summary]:
    table = pd.DataFrame(
        {"algorithm": ["wknn"], "family": ["floor"], "worlds": [40], "n": [10], "note": [""]}
    )
    for metric in (
        "mean",
        "se",
        "sd_worlds",
        "rmse",
        "p50",
        "p75",
        "p90",
        "p95",
        "max",
        "mean_low",
        "mean_high",
    ):
        table[f"{metric}_m"] = 2.5
    return [
        front.Summary(
            study=f"{paper}_study",
            title=f"Study of {paper}",
            paper=paper,
            page=f"{paper}_study.html",
            recorded=False,
            worlds="on 40 synthetic worlds",
            table=table,
            claims=[],
            entries={"wknn": {"use": "wknn", "options": {}}},
            reference="wknn",
            picture=None,
        )
        for paper in PAPERS
    ]


def test_every_verdict_has_one_group_one_tone_and_one_meaning() -> None:
    grouped = Counter(verdict for verdicts in GROUPS.values() for verdict in verdicts)
    assert grouped == Counter(VERDICTS) == Counter(TONES.keys()) == Counter(method.MEANINGS.keys())


def test_the_sentence_counts_every_claim_once() -> None:
    told = front.in_short(ledger_of(FOUND))
    assert told == "Of 14 claims, 11 agree, 1 depends on the world, 1 differs and 1 is not judged."
    assert sum(map(int, re.findall(r"\d+", told))) == 2 * 14
    assert front.in_short(ledger_of(FOUND).iloc[:0]) == "The papers claim nothing here."
    few = front.in_short(ledger_of({"first": ["depends", "undecided", "undecided"]}))
    assert few == "Of 3 claims, 1 depends on the world and 2 are undecided."


def test_main_claims_tell_their_verdict_and_their_numbers() -> None:
    ledger = ledger_of({"first": ["not reproduced", "depends", "not testable", "none given", "holds"]})
    ledger["printed"], ledger["unit"] = ["2.6", "", "", "", ""], ["m", "", "", "degrees", ""]
    ledger["rebuilt"], ledger["worlds"] = [3.979, 0.275, float("nan"), 5.97971, 1.0], [40, 40, 0, 40, 40]
    ids = list(ledger["claim"])
    claims = [{"id": name, "main": True} for name in ids[:4]] + [{"id": ids[4]}]
    told = front.main_claims(claims, ledger)
    assert [line["verdict"] for line in told] == ["not reproduced", "depends", "not testable", "none given"]
    assert [line["told"] for line in told] == [
        "printed 2.6 m, rebuilt 3.98 m",
        "true in 11 of 40 worlds",
        "",
        "rebuilt 5.98 degrees",
    ]


def test_each_paper_names_its_main_claims() -> None:
    for path in sorted((ROOT / "data/papers").glob("*.yaml")):
        chosen = [claim for claim in read_yaml(path)["claims"] if claim.get("main")]
        assert 3 <= len(chosen) <= 6, path.name
        assert all(claim["kind"] != "words" for claim in chosen), path.name


def test_areas_at_a_glance_are_as_the_counts() -> None:
    lines = front.glance(list(PAPERS), ledger_of(FOUND))
    assert [line["total"] for line in lines] == [11, 3]
    largest = next(c for c in lines[0]["cells"] if c["verdict"] == "reproduced")
    for line in lines:
        for cell in line["cells"]:
            assert cell["side_rem"] ** 2 / largest["side_rem"] ** 2 == pytest.approx(
                cell["count"] / 9, abs=1e-3
            )


def test_the_front_page_links_counts_to_their_claims() -> None:
    page = front.front_page(summaries(), PAPERS, ledger_of(FOUND), {"commit": "0abc"})
    assert 'href="claims.html?paper=first&amp;verdict=fails"' in page
    assert "0abc" in page
    for paper in PAPERS:
        assert f'href="{paper}_study.html"' in page


MEANS = {"wknn": (1.0, 2.0, 3.0), "svm": (2.0, 1.0, 2.0), "control_oracle": (0.1, 0.1, 0.1)}


def rows_at_places(
    means: dict[str, tuple[float, ...]],
) -> tuple[list[tables.Row], dict[str, dict[str, Any]]]:
    """Rows of nine samples at a few places, and their entries."""
    rows = [
        tables.Row(row, f"place {number}", 1, 9, {"mean_m": tables.Cell(mean)})
        for row, found in means.items()
        for number, mean in enumerate(found)
    ]
    return rows, {row: {"use": row, "options": {}} for row in means}


def test_the_best_row_is_named_by_recording_and_is_no_control() -> None:
    rows, entries = rows_at_places(MEANS)
    assert (
        front.best_rows(rows, entries, "wknn") == "The smallest mean error is that of svm on 2 and wknn on 1."
    )
    assert front.best_rows(rows[::3], entries, "wknn") == "The smallest mean error is that of wknn."
    assert front.best_rows(*rows_at_places({**MEANS, "control_centre": (0.5, 1.0, 9.0)}), "wknn").endswith(
        "svm on 2 and wknn on 1. On 2 no row beats control_centre, which hears nothing."
    )


def test_the_best_rows_of_each_task_are_told_apart() -> None:
    found = [
        *(("fix", "trilateration", 2.0), ("other", "trilateration", 2.5), ("alone", "ranging", 1.0)),
        *(("filter", "tracking", 3.0), ("still", "tracking", 1.0)),
    ]
    rows = [tables.Row(row, "walk", 1, 9, {"mean_m": tables.Cell(mean)}) for row, _, mean in found]
    entries = {row: {"use": row, "task": task, "options": {}} for row, task, _ in found}
    assert front.best_rows(rows, entries, "filter") == (
        "Tracking: the smallest mean error is that of still. Trilateration: the smallest mean error is that"
        " of fix."
    )


def test_where_one_row_alone_answers_nothing_is_the_best() -> None:
    rows, entries = rows_at_places(MEANS)
    silent = [
        replace(row, samples=0, cells={}) if (row.algorithm, row.family) == ("svm", "place 1") else row
        for row in rows
    ]
    assert front.best_rows(silent, entries, "wknn") == (
        "The smallest mean error is that of wknn on 1 and svm on 1; on 1 there is nothing to compare."
    )


def test_simulated_recordings_are_not_called_real() -> None:
    plan: dict[str, Any] = {"recordings": {"intel": {}, "m3500_simulated": {}}, "families": {}}
    assert pages.worlds_in_words(plan) == "on 2 recordings, 1 of them simulated"
    plan["recordings"].pop("m3500_simulated")
    assert pages.worlds_in_words(plan) == "on 1 real recording"


def test_rows_that_answer_easy_samples_alone_are_not_the_best() -> None:
    rows, entries = rows_at_places(MEANS)
    few = [
        replace(row, samples=5) if (row.algorithm, row.family) == ("svm", "place 1") else row for row in rows
    ]
    assert front.best_rows(few, entries, "wknn") == (
        "The smallest mean error of rows that answer at least 98 % of the samples is that of wknn on 1 and"
        " svm on 1; on 1 there is nothing to compare."
    )


def claims_html(figures: dict[str, list[str]]) -> str:
    frame = ledger_of(FOUND)
    kinds = dict.fromkeys(frame["claim"], "value")
    return ledger.claims_page(frame, kinds, PAPERS, figures, {})


def test_claims_page_has_each_claim_once_with_its_link() -> None:
    page = claims_html({"first_study": ["fig1"], "second_study": []})
    for claim in ledger_of(FOUND)["claim"]:
        assert page.count(f'<tr id="{claim}"') == 1
    assert 'href="first_study.html#figure-fig1"' in page
    assert 'href="first_study.html#claim-fig2.first"' in page
    assert "mean error &lt;b&gt;" in page
    assert page.count('<svg class="scale" viewBox="0 0 130') == 14


def places(drawing: str) -> dict[str, float]:
    """Where the marks of a drawing stand, pixels."""
    found = {"rebuilt": float(re.search(r'class="rebuilt" cx="([\d.]+)"', drawing)[1])}
    if span := re.search(r'class="span" d="M([\d.]+) [\d.]+H([\d.]+)"', drawing):
        found |= {"low": float(span[1]), "high": float(span[2])}
    if printed := re.search(r'class="printed" d="M([\d.]+) ', drawing):
        found["printed"] = float(printed[1])
    return found


@given(
    values=st.lists(st.floats(-50, 1e4).filter(lambda x: x == 0 or abs(x) > 1e-3), min_size=4, max_size=4),
    kind=st.sampled_from(["value", "exact", "none"]),
)
def test_drawings_are_to_scale(values: list[float], kind: str) -> None:
    low, rebuilt, high = sorted(values[:3])
    printed = f"{Decimal(repr(values[3])):f}"
    line = {"rebuilt": rebuilt, "low": low, "high": high, "printed": printed}
    found = places(drawn(line, kind))
    numbers = {**line, "printed": float(printed)}
    least, most = min(0.0, *numbers.values()), max(0.0, *numbers.values())
    for name, place in found.items():
        share = (numbers[name] - least) / ((most - least) or 1.0)
        assert place == pytest.approx(7 + share * (WIDTH - 14), abs=0.06)
    assert found.keys() == {"rebuilt", "low", "high", "printed"}


@pytest.mark.parametrize("kind", CONDITIONS)
def test_shares_stand_on_a_scale_of_their_own_without_what_is_printed(kind: str) -> None:
    found = places(drawn({"rebuilt": 0.5, "low": 0.25, "high": 0.75, "printed": "7"}, kind))
    assert found == {"rebuilt": 65.0, "low": 36.0, "high": 94.0}


def test_nothing_is_drawn_where_nothing_was_measured() -> None:
    nothing = {"rebuilt": math.nan, "low": math.nan, "high": math.nan, "printed": "3.0"}
    assert drawn(nothing, "words") == ""


def test_a_claim_belongs_to_the_figure_that_its_name_begins_with() -> None:
    assert figure_of("fig7.mean", ["fig1", "fig7"]) == "fig7"
    assert figure_of("fig70.mean", ["fig7"]) == ""


def test_method_page_tells_every_verdict_and_study() -> None:
    page = method.method_page({"one": "on 3 real recordings"}, {})
    for meaning in method.MEANINGS.values():
        assert meaning.replace("'", "&#39;") in page
    assert "on 3 real recordings" in page


def chapter(folder: Path) -> pdf.Chapter:
    from matplotlib.figure import Figure

    folder.mkdir(parents=True, exist_ok=True)
    picture = Figure(figsize=(3, 2))
    picture.subplots().plot([0, 1])
    picture.savefig(folder / "fig1.pdf", metadata={"CreationDate": None})
    line = {"name": "fig1", "title": "A line", "caption": "Of *two* #points, $x_1$", "alt": "a line"}
    write_json(folder / "captions.json", [line])
    frame = ledger_of({"first": FOUND["first"]})
    plan = {
        "title": "Odd #title [x]",
        "worlds": 40,
        "families": {"floor": {}},
        "recordings": {},
        "entries": {},
    }
    plan["entries"] = {"wknn": {"use": "wknn", "options": {}}}
    paper = {**PAPERS["first"], "claims": [{"id": c, "kind": "value"} for c in frame["claim"]]}
    return pdf.Chapter("first_study", plan, summaries()[0].table, frame, paper, folder)


def test_the_pdf_is_one_and_the_same_and_takes_no_text_for_markup(tmp_path: Path) -> None:
    one = chapter(tmp_path / "figures" / "first_study")
    made = pdf.report_pdf([one], {"commit": "0abc"})
    assert made.startswith(b"%PDF-")
    assert made == pdf.report_pdf([one], {"commit": "0abc"})
    assert made != pdf.report_pdf([one], {"commit": "1abc"})


def test_a_figure_without_pdf_is_named(tmp_path: Path) -> None:
    one = chapter(tmp_path / "figures" / "first_study")
    (one.figures / "fig1.pdf").unlink()
    with pytest.raises(ValueError, match=r"fig1\.pdf"):
        pdf.report_pdf([one], {})


def test_the_latex_ledger_has_every_claim_and_as_many_cells_as_columns() -> None:
    frame = ledger_of(FOUND)
    text = pdf.ledger_latex(frame, {})
    lines = [line for line in text.splitlines() if line.startswith("\\texttt{")]
    assert len(lines) == len(frame)
    assert {line.replace("\\&", "").count("&") for line in lines} == {6}
    assert "Of an ordering" in text
