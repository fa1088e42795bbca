"""Write the page of a study, and its table as Markdown and LaTeX."""

from collections.abc import Mapping
from typing import Any

from positioning.evaluation.entries import new_rows, read_shipped
from positioning.files import read_json, read_yaml, write_text
from positioning.joblog import logging_to
from positioning.presentation import pages, tables


def main(
    study: str, inputs: Mapping[str, str | None], plan: Mapping[str, Any], output: Mapping[str, str]
) -> None:
    """Write three files, ``html``, ``markdown`` and ``latex``.

    Parameters
    ----------
    study
        Its name.
    inputs
        ``table``, ``paired``, ``times``, ``claims``, ``figures`` (the folder), ``paper``, ``manifest``,
        ``accepted`` (rows that are not new); and ``calibration`` and ``sources``, or None.
    plan
        As in `positioning.presentation.pages.Report`.
    output
        The three files.
    """
    table, paired, times, claims = (
        tables.read_table(str(inputs[name])) for name in ("table", "paired", "times", "claims")
    )
    calibration, sources = inputs.get("calibration"), inputs.get("sources")
    paper = read_yaml(str(inputs["paper"]))
    report = pages.Report(
        study=study,
        plan=plan,
        table=table,
        paired=paired,
        times=times,
        claims=claims,
        pictures=pages.read_pictures(str(inputs["figures"]), study),
        paper=paper,
        calibration=read_json(calibration) if calibration else [],
        manifest=read_json(str(inputs["manifest"])),
        sources=tables.read_table(sources) if sources else None,
        new=new_rows(plan["entries"], read_shipped(str(inputs["accepted"]))),
    )
    write_text(output["html"], pages.study_page(report))
    write_text(output["markdown"], tables.study_markdown(plan["title"], table, claims, paper))
    write_text(output["latex"], tables.study_latex(study, plan["title"], table, claims, paper))


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        optional = {name: snakemake.input.get(name) or None for name in ("calibration", "sources")}
        if snakemake.params.plan["recordings"]:
            optional["sources"] = optional["sources"] or "data/sources.csv"
        main(
            snakemake.wildcards.study,
            {**dict(snakemake.input.items()), **optional},
            snakemake.params.plan,
            dict(snakemake.output.items()),
        )
