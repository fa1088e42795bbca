"""Run one algorithm, with one or several settings, on a batch of worlds."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from positioning.files import read_tree, write_tree
from positioning.fixes import of_outputs
from positioning.joblog import logging_to
from positioning.registry import changed, factory
from positioning.seeds import stream
from positioning.steps import of_extra
from positioning.tasks import NOT_ASKED, Outcome


def main(
    study: str,
    row: Mapping[str, Any],
    observed: str,
    truth: str | None,
    built_on: Mapping[str, str],
    output: str,
) -> None:
    """Write ``<family>/<step>/<name>`` for every family of worlds and every step of a sweep.

    ``built_on`` are the estimates of rows that this one builds on: ``fixes`` those of a trilateration row,
    ``steps`` those of a tracking row.

    Raises
    ------
    RuntimeError
        Where the algorithm raises: names the study, the worlds and the settings.
    """
    run = import_module(f"positioning.tasks.{row['task']}").run
    setting, steps = row["over"] or (None, [None])
    stacks = read_tree(observed)
    truths = read_tree(truth) if truth else {}
    found = {what: read_tree(path) for what, path in built_on.items()}
    tree: dict[str, dict[str, Any]] = {}
    for family, arrays in stacks.items():
        count = np.count_nonzero(arrays["world"] < (row["worlds"] or np.inf))
        arrays = {name: values[:count] for name, values in arrays.items()}
        seen = {name: values[:count] for name, values in truths[family].items()} if truth else None
        without = ""
        for what, below in found.items():
            outputs = {
                k.removeprefix("estimate."): v[:count] for k, v in below[f"{family}/0"].items() if v.ndim
            }
            # Where a row of fixes was skipped, the algorithm meets the same data and gives its own reason.
            # One that lacks steps would make some of its own, with settings that nobody asked for.
            if what == "steps":
                arrays |= of_extra(outputs)
                if reason := str(below[f"{family}/0"]["skipped"]):
                    without = f"row {row['options']['steps']}, whose steps it takes, was skipped: {reason}"
            elif "output_m" in outputs:
                arrays |= of_outputs(outputs, arrays["recording.time_s"])
        seeds = [int(seed) for seed in arrays["seed"]]
        for number, step in enumerate(steps):
            if row["families"] and family not in row["families"]:
                tree[f"{family}/{number}"] = _step(arrays, step, Outcome(skipped=NOT_ASKED))
                continue
            if without:
                tree[f"{family}/{number}"] = _step(arrays, step, Outcome(skipped=without))
                continue
            parameters = row["parameters"] if setting is None else changed(row["parameters"], setting, step)
            try:
                # The stream hangs on the algorithm's own name, so that variants of it draw alike.
                outcome = run(
                    factory(row["use"], row["task"], parameters),
                    arrays,
                    seen,
                    row["options"],
                    [stream(seed, study, row["use"]) for seed in seeds],
                )
            except Exception as error:
                raise RuntimeError(
                    f"study {study}, row {row['name']} ({row['use']} with {parameters or 'its defaults'}),"
                    f" {family} worlds {arrays['world'].tolist()} (seeds {seeds}):"
                    f" {type(error).__name__}: {error}"
                ) from error
            tree[f"{family}/{number}"] = _step(arrays, step, outcome)
    write_tree(output, tree)


def _step(arrays: Mapping[str, Any], step: float | None, outcome: Outcome) -> dict[str, Any]:
    return {
        "world": arrays["world"],
        "value": np.asarray(np.nan if step is None else step, dtype=float),
        "seconds": outcome.seconds,
        "skipped": np.asarray(outcome.skipped),
        **{f"estimate.{name}": values for name, values in outcome.estimates.items()},
    }


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.row,
            snakemake.input.observed,
            snakemake.input.get("truth"),
            {what: snakemake.input[what] for what in ("fixes", "steps") if snakemake.input.get(what)},
            snakemake.output[0],
        )
