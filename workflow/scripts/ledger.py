"""Join all claims into one ledger, and hold it to the accepted one: a changed verdict is an error."""

from collections.abc import Sequence

import pandas as pd

from positioning.errors import InputError
from positioning.files import replacing, write_text
from positioning.joblog import logging_to


def main(claims: Sequence[str], accepted: str | None, output: str, check: str) -> None:
    """Write the ledger, then compare it.

    Claims are compared where the accepted ledger was made from as many worlds; other builds, like
    the quick one, are no reason to change it.

    Raises
    ------
    InputError
        Where a verdict differs from the accepted one.
    """
    ledger = pd.concat([pd.read_csv(path, dtype={"printed": str}, keep_default_na=False) for path in claims])
    with replacing(output) as temporary:
        ledger.to_csv(temporary, index=False, lineterminator="\n")
    text = "No accepted ledger to compare with."
    if accepted:
        before = pd.read_csv(accepted, dtype={"printed": str}, keep_default_na=False)
        both = ledger.merge(before, on=["claim", "paper", "study", "worlds"], suffixes=("", "_accepted"))
        changed = both[both["verdict"] != both["verdict_accepted"]]
        if len(changed):
            lines = [f"{c.claim}: {c.verdict_accepted} -> {c.verdict}" for c in changed.itertuples()]
            raise InputError(
                "the ledger of claims",
                f"{len(changed)} verdict(s) differ from {accepted}: {'; '.join(lines)}",
                "Find out why; where the new verdicts are right, `make accept` takes them over",
            )
        text = f"{len(both)} of {len(ledger)} verdicts compared with {accepted}: none changed."
    write_text(check, text + "\n")
    print(text)


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.input.claims,
            (snakemake.input.get("accepted") or [None])[0]
            if not isinstance(snakemake.input.get("accepted"), str)
            else snakemake.input.accepted,
            snakemake.output.claims,
            snakemake.output.check,
        )
