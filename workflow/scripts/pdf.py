"""Write the whole report as one PDF, and the ledger of claims as a LaTeX table."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from positioning.files import read_json, replacing, write_text
from positioning.joblog import logging_to
from positioning.presentation import pdf, tables
from positioning.presentation.papers import kinds_of, read_papers


def main(
    plan: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, Sequence[str]],
    claims: str,
    manifest: str,
    comparison: str,
    output: Mapping[str, str],
) -> None:
    """Write two files, ``pdf`` and ``latex``.

    Parameters
    ----------
    plan
        By study, in the order of the chapters, as on the study's page; with ``paper``, the paper's key.
    files
        ``tables`` and ``figures`` (the folders), one a study in the order of ``plan``; ``papers``, all;
        ``calibration``, one a study that calibrates, called like it.
    claims
        The ledger of all studies.
    manifest
        What the numbers came from.
    comparison
        The folder of the figures of all algorithms.
    output
        The two files.
    """
    ledger = tables.read_table(claims)
    papers = read_papers(files["papers"])
    calibrations = {Path(path).stem: read_json(path) for path in files["calibration"]}
    chapters = [
        pdf.Chapter(
            study=study,
            plan=values,
            table=tables.read_table(table),
            claims=ledger[ledger["study"] == study],
            paper=papers[values["paper"]],
            figures=Path(figures),
            calibration=calibrations.get(study, []),
        )
        for (study, values), table, figures in zip(
            plan.items(), files["tables"], files["figures"], strict=True
        )
    ]
    write_text(output["latex"], pdf.ledger_latex(ledger, kinds_of(papers.values())))
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", pdf.EPOCH))
    whole = pdf.report_pdf(chapters, read_json(manifest), seconds, Path(comparison))
    with replacing(output["pdf"]) as temporary:
        temporary.write_bytes(whole)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.plan,
            {
                name: list(snakemake.input.get(name, []))
                for name in ("tables", "figures", "papers", "calibration")
            },
            snakemake.input.claims,
            snakemake.input.manifest,
            snakemake.input.comparison,
            dict(snakemake.output.items()),
        )
