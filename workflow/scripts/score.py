"""Join estimates with the truth: raw errors, one row a sample, nothing averaged."""

from importlib import import_module

import numpy as np

from positioning.files import read_tree, write_errors
from positioning.joblog import logging_to


def main(task: str, estimates: str, truth: str, output: str) -> None:
    """Write ``family, value, world, sample, error_m`` and components."""
    score = import_module(f"positioning.tasks.{task}").score
    truths = read_tree(truth)
    columns: dict[str, list[np.ndarray]] = {}
    skipped = {}
    for branch, step in read_tree(estimates).items():
        family = branch.rpartition("/")[0]
        if str(step["skipped"]):
            skipped[family] = str(step["skipped"])
            continue
        count = len(step["world"])
        found = {
            name.removeprefix("estimate."): v for name, v in step.items() if name.startswith("estimate.")
        }
        errors = score(found, {name: values[:count] for name, values in truths[family].items()})
        shape = errors["error_m"].shape
        asked = ~np.isnan(errors["error_m"])
        labels = {
            "family": np.full(shape, family),
            "value": np.full(shape, step["value"]),
            "world": np.broadcast_to(step["world"][:, None], shape).astype(np.int32),
            "sample": np.broadcast_to(np.arange(shape[1], dtype=np.int32), shape),
        }
        for name, values in {**labels, **errors}.items():
            columns.setdefault(name, []).append(values[asked])
    empty = {"family": "U1", "value": float, "world": np.int32, "sample": np.int32, "error_m": float}
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    write_errors(output, joined or {name: np.empty(0, dtype) for name, dtype in empty.items()}, skipped)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.task,
            snakemake.input.estimates,
            snakemake.input.truth,
            snakemake.output[0],
        )
