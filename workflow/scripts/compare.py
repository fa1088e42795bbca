"""Put all algorithms of a study beside each other: table, paired differences, times, measures."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd

from positioning.evaluation import measures as m
from positioning.evaluation.results import read_row_errors, read_row_times, read_stacks
from positioning.files import read_yaml, replacing
from positioning.joblog import logging_to


def main(
    study: str,
    rows: Mapping[str, Mapping[str, Any]],
    table: Sequence[str],
    families: Sequence[str],
    files: Mapping[str, Sequence[str]],
    extra: bool,
    paper: str,
    output: Mapping[str, str],
) -> None:
    """Write the four files; ``files`` lists errors, estimates and worlds."""
    errors, skipped, parts, times = {}, {}, [], []
    for row in rows:
        own = [path for path in files["errors"] if Path(path).parent.name == row]
        errors[row], reasons = read_row_errors(own)
        skipped |= {(family, row): reason for family, reason in reasons.items()}
        parts.append(m.measure(errors[row], row))
        times.append(read_row_times([p for p in files["estimates"] if Path(p).parent.name == row], row))
    if extra:
        own_measures = import_module(f"positioning.evaluation.studies.{study}").measures
        parts.append(own_measures(read_stacks(files["estimates"]), read_stacks(files["worlds"]))[m.MEASURES])
    measures = pd.concat([part for part in parts if len(part)], ignore_index=True)
    claims = [claim for claim in read_yaml(paper)["claims"] if claim["study"] == study]
    table_measures = measures[measures["algorithm"].isin(table) & measures["value"].isna()]
    quantities = {row: import_module(f"positioning.tasks.{rows[row]['task']}").QUANTITY for row in table}
    frames = {
        "table": m.table(table_measures, table, families, skipped, m.published_numbers(claims, families[:1])),
        "paired": m.paired(errors, table, families, quantities),
        "times": pd.concat(times, ignore_index=True),
    }
    for name, frame in frames.items():
        with replacing(output[name]) as temporary:
            frame.to_csv(temporary, index=False, float_format="%.6g", lineterminator="\n")
    with replacing(output["measures"]) as temporary:
        measures.to_parquet(temporary, index=False)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.rows,
            snakemake.params.table,
            snakemake.params.families,
            {
                "errors": sorted(map(str, Path(snakemake.input.errors).rglob("*.parquet"))),
                "estimates": snakemake.input.estimates,
                "worlds": [p for p in snakemake.input.get("extra", []) if p.endswith(".npz")],
            },
            bool(snakemake.input.get("extra")),
            snakemake.input.paper,
            dict(snakemake.output.items()),
        )
