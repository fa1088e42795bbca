"""Put all algorithms of a task beside each other over all data sets: one table a task, figures, one page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from positioning.evaluation.comparison import compare
from positioning.evaluation.comparison_lines import StudyTables
from positioning.evaluation.entries import read_shipped
from positioning.files import read_json, replacing, write_text
from positioning.joblog import logging_to
from positioning.presentation import comparison_figures, figures, tables
from positioning.presentation.comparison import page


def read_study(study: str, plan: Mapping[str, Any], files: Mapping[str, str]) -> StudyTables:
    """Read what a comparison needs of a study: ``table``, ``paired``, ``times`` and ``measures``."""
    worlds = pq.read_table(
        files["measures"],
        columns=["family", "algorithm", "value", "world", "x"],
        filters=[("metric", "=", "mean_m")],
    ).to_pandas()
    times = tables.read_table(files["times"])
    return StudyTables(
        study=study,
        title=plan["title"],
        kind="recorded" if plan["recordings"] else "synthetic",
        reference=plan["reference"],
        entries=plan["entries"],
        table=tables.read_table(files["table"]),
        paired=tables.read_table(files["paired"]),
        times=times[times["value"].isna()],
        worlds=worlds[worlds["value"].isna()].rename(columns={"x": "mean_m"}),
        sources={name: options["source"] for name, options in plan["recordings"].items()},
    )


def main(
    plan: Mapping[str, Mapping[str, Any]],
    files: Mapping[str, Sequence[str]],
    accepted: str,
    manifest: str,
    output: Mapping[str, str],
) -> None:
    """Write the page ``html`` and the folder ``folder``: a CSV a task, figures as SVG and PDF.

    Parameters
    ----------
    plan
        By study, in the order of the page: as the rule ``page`` gets it.
    files
        ``table``, ``paired``, ``times`` and ``measures``, one a study in the order of ``plan``.
    accepted
        Rows that are not new: a CSV with the columns ``task`` and ``algorithm``.
    manifest
        What the numbers came from.
    output
        The page and the folder.
    """
    studies = [
        read_study(study, values, {name: paths[number] for name, paths in files.items()})
        for number, (study, values) in enumerate(plan.items())
    ]
    compared = compare(studies, read_shipped(accepted))
    folder = Path(output["folder"])
    folder.mkdir(parents=True, exist_ok=True)
    for task in compared:
        with replacing(folder / f"{task.task}.csv") as temporary:
            task.lines.to_csv(temporary, index=False, float_format="%.6g", lineterminator="\n")
    figures.save(comparison_figures.draw(compared), folder)
    quick = any(values["quick"] for values in plan.values())
    write_text(output["html"], page(compared, folder, read_json(manifest), quick=quick))


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.plan,
            {name: snakemake.input[name] for name in ("table", "paired", "times", "measures")},
            snakemake.input.accepted,
            snakemake.input.manifest,
            dict(snakemake.output.items()),
        )
