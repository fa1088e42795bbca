"""Read real recordings into the same two files as synthetic worlds: observed and truth."""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from positioning.errors import InputError
from positioning.files import write_tree
from positioning.joblog import logging_to
from positioning.recordings.register import check_files


def main(members: Mapping[str, Mapping[str, Any]], realdata: str, observed: str, truth: str) -> None:
    """Check each source's files against the register, then let its adapter read them.

    A recording is a family of one world. Its number is 0 and its seed too: nothing in it is drawn.
    """
    sides: dict[str, dict[str, Any]] = {"observed": {}, "truth": {}}
    for family, options in members.items():
        folder = Path(realdata) / options["source"]
        adapter = import_module(f"positioning.recordings.{options['adapter']}")
        given = {k: v for k, v in options.items() if k not in ("adapter", "source")}
        try:
            check_files(folder, options["source"])
            worlds = adapter.load(folder, **given)
        except InputError as error:
            raise InputError(
                f"recording {family} in {folder}, {error.thing}", error.limit, error.cure
            ) from error
        index = {"world": np.zeros(1, dtype=int), "seed": np.zeros(1, dtype=int)}
        sides["observed"][family] = {**index, **worlds.observed}
        sides["truth"][family] = {**index, **worlds.truth}
    write_tree(observed, sides["observed"])
    write_tree(truth, sides["truth"])


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.params.members,
            snakemake.params.realdata,
            snakemake.output.observed,
            snakemake.output.truth,
        )
