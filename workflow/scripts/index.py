"""Write the front page, the ledger of all claims for readers, and the summary that the README shows."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from positioning.files import read_yaml, write_text
from positioning.presentation import pages, tables


def main(studies: Mapping[str, Mapping[str, Any]], claims: str, output: Mapping[str, str]) -> None:
    """Write four files, ``html``, ``csv``, ``md`` and ``summary``.

    Parameters
    ----------
    studies
        By name, in the order of the page: ``title``, ``quick``, ``page`` (link to its page), ``table``,
        ``figures`` (the folder), ``paper``.
    claims
        The ledger of all studies.
    output
        The four files.
    """
    ledger = tables.read_table(claims)
    summaries = [
        pages.Summary(
            study=name,
            title=study["title"],
            page=study["page"],
            table=tables.read_table(study["table"]),
            paper=read_yaml(study["paper"]),
            pictures=pages.read_pictures(study["figures"], name),
            quick=study["quick"],
        )
        for name, study in studies.items()
    ]
    write_text(output["html"], pages.index_page(summaries, ledger))
    write_text(output["csv"], Path(claims).read_text(encoding="utf-8"))
    write_text(output["md"], tables.ledger_markdown(ledger))
    write_text(output["summary"], pages.summary_markdown(summaries, ledger))


if __name__ == "__main__":
    from snakemake.script import snakemake

    main(snakemake.params.studies, snakemake.input.claims, dict(snakemake.output.items()))
