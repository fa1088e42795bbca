"""Write the front page, the ledger of all claims for readers, and the summary that the README shows."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from positioning.files import read_yaml, write_text
from positioning.joblog import logging_to
from positioning.presentation import pages, tables


def main(
    plan: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, Sequence[str]],
    claims: str,
    output: Mapping[str, str],
) -> None:
    """Write four files, ``html``, ``claims``, ``markdown`` and ``summary``.

    Parameters
    ----------
    plan
        By study, in the order of the page: ``title``, ``quick``.
    files
        ``tables`` and ``figures`` (the folders), one a study in the order of ``plan``; ``papers``, all.
    claims
        The ledger of all studies.
    output
        The four files; the pages of the studies stand beside the first.
    """
    ledger = tables.read_table(claims)
    printed = [claim for paper in files["papers"] for claim in read_yaml(paper)["claims"]]
    summaries = [
        pages.Summary(
            study=study,
            title=values["title"],
            page=f"{study}.html",
            table=tables.read_table(table),
            paper={"claims": [claim for claim in printed if claim["study"] == study]},
            pictures=pages.read_pictures(figures, study),
            quick=values["quick"],
        )
        for (study, values), table, figures in zip(
            plan.items(), files["tables"], files["figures"], strict=True
        )
    ]
    write_text(output["html"], pages.index_page(summaries, ledger))
    write_text(output["claims"], Path(claims).read_text(encoding="utf-8"))
    write_text(output["markdown"], tables.ledger_markdown(ledger))
    write_text(output["summary"], pages.summary_markdown(summaries, ledger))


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.plan,
            {
                "tables": snakemake.input.tables,
                "figures": snakemake.input.figures,
                "papers": snakemake.input.get("papers")
                or sorted(map(str, Path("data/papers").glob("*.yaml"))),
            },
            snakemake.input.claims,
            dict(snakemake.output.items()),
        )
