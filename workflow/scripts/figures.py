"""Draw a study's figures, as SVG and PDF, with their captions."""

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from positioning.evaluation.results import StudyResults
from positioning.files import read_tree, read_yaml
from positioning.joblog import logging_to
from positioning.presentation import figures, study_figures


def main(
    study: str,
    rows: Sequence[str],
    sweeps: Mapping[str, Sequence[Any]],
    measures: str,
    errors: Sequence[str],
    worlds: Mapping[str, str],
    paper: str,
    output: str,
    estimates: Sequence[str] = (),
    settings: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write the folder ``output`` as a whole; ``worlds`` names the observed and the true side."""
    results = StudyResults(
        study=study,
        rows=tuple(rows),
        sweeps={name: (setting, tuple(values)) for name, (setting, values) in sweeps.items()},
        measures=pd.read_parquet(measures),
        error_files=tuple(errors),
        observed=read_tree(worlds["observed"]),
        truth=read_tree(worlds["truth"]),
        paper=read_yaml(paper),
        estimate_files=tuple(estimates),
        settings=settings or {},
    )
    target = Path(output)
    temporary = target.with_name(f".tmp-{os.getpid()}-{target.name}")
    temporary.mkdir(parents=True)
    try:
        figures.save(study_figures.draw(results), temporary)
        shutil.rmtree(target, ignore_errors=True)
        temporary.replace(target)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        observed, truth = snakemake.input.worlds
        main(
            snakemake.wildcards.study,
            snakemake.params.rows,
            snakemake.params.sweeps,
            snakemake.input.measures,
            sorted(map(str, Path(snakemake.input.errors).rglob("*.parquet"))),
            {"observed": observed, "truth": truth},
            snakemake.input.paper,
            snakemake.output[0],
            snakemake.input.estimates,
            snakemake.params.settings,
        )
