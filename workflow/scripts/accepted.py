"""Hold the ledger to the accepted one: a verdict that changed is an error, and told."""

from collections.abc import Sequence

import pandas as pd

from positioning.errors import InputError
from positioning.files import write_text
from positioning.joblog import logging_to


def main(ledger: str, accepted: Sequence[str], output: str) -> None:
    """Compare claims that were judged from as many worlds; builds of other sizes change nothing.

    Raises
    ------
    InputError
        Where a verdict differs from the accepted one.
    """
    now = pd.read_csv(ledger, dtype=str, keep_default_na=False)
    text = "There is no accepted ledger to compare with."
    for path in accepted:
        before = pd.read_csv(path, dtype=str, keep_default_na=False)
        gone = sorted(set(before["claim"]) - set(now["claim"]))
        if gone:
            raise InputError(
                "the ledger of claims",
                f"{len(gone)} claim(s) of {path} are gone: {_few(gone)}",
                "Put them back, or take the new ledger over with `make accept`",
            )
        both = now.merge(before, on=["claim", "paper", "study", "worlds"], suffixes=("", "_accepted"))
        changed = both[both["verdict"] != both["verdict_accepted"]]
        if len(changed):
            lines = [f"{c.claim}: {c.verdict_accepted} -> {c.verdict}" for c in changed.itertuples()]
            raise InputError(
                "the ledger of claims",
                f"{len(changed)} verdict(s) differ from {path}: {_few(lines)}",
                "Find out why; where the new verdicts are right, `make accept` takes them over",
            )
        text = f"{len(both)} of {len(now)} verdicts compared with {path}: none changed."
        if len(both) < len(now):
            text += " The others are new, or were judged from another number of worlds."
    write_text(output, text + "\n")


def _few(names: list[str], most: int = 10) -> str:
    """Return the first names of a list; a whole ledger would fill the screen."""
    return "; ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(snakemake.input.ledger, snakemake.input.accepted, snakemake.output[0])
