"""Write the pages over all studies: front page, claims, method; and the ledger for readers."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from positioning.files import read_json, write_text
from positioning.joblog import logging_to
from positioning.presentation import front, ledger, method, pages, tables
from positioning.presentation.papers import kinds_of, read_papers


def main(
    plan: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, Sequence[str]],
    claims: str,
    manifest: str,
    output: Mapping[str, str],
) -> None:
    """Write five files, ``html``, ``claims``, ``method``, ``csv`` and ``markdown``.

    Parameters
    ----------
    plan
        By study, in the order of the page, as its page has it, and ``quick``.
    files
        ``tables`` and ``figures`` (the folders), one a study in the order of ``plan``; ``papers``, all.
    claims
        The ledger of all studies.
    manifest
        What the numbers came from.
    output
        The five files; the pages of the studies stand beside the first.
    """
    joined, build = tables.read_table(claims), read_json(manifest)
    papers = read_papers(files["papers"])
    quick = any(values["quick"] for values in plan.values())
    worlds = {study: pages.worlds_in_words(values) for study, values in plan.items()}
    figures, summaries = {}, []
    for (study, values), table, folder in zip(plan.items(), files["tables"], files["figures"], strict=True):
        figures[study] = [str(line["name"]) for line in read_json(Path(folder) / "captions.json")]
        synthetic, shown = not values["recordings"], values["figure"] or figures[study][0]
        pictures = pages.read_pictures(folder, study, only=shown) if synthetic else []
        summaries.append(
            front.Summary(
                study=study,
                title=values["title"],
                paper=values["paper"],
                page=f"{study}.html",
                recorded=not synthetic,
                worlds=worlds[study],
                table=tables.read_table(table),
                claims=[claim for claim in papers[values["paper"]]["claims"] if claim["study"] == study],
                entries=values["entries"],
                reference=values["reference"],
                picture=pictures[0] if pictures else None,
            )
        )
    kinds = kinds_of(papers.values())
    write_text(output["html"], front.front_page(summaries, papers, joined, build, quick=quick))
    write_text(output["claims"], ledger.claims_page(joined, kinds, papers, figures, build, quick=quick))
    write_text(output["method"], method.method_page(worlds, build, quick=quick))
    write_text(output["csv"], Path(claims).read_text(encoding="utf-8"))
    write_text(output["markdown"], tables.ledger_markdown(joined))


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.plan,
            {name: snakemake.input[name] for name in ("tables", "figures", "papers")},
            snakemake.input.claims,
            snakemake.input.manifest,
            dict(snakemake.output.items()),
        )
