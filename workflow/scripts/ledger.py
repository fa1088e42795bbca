"""Join the claims of all studies into one ledger."""

from collections.abc import Sequence

import pandas as pd

from positioning.files import replacing
from positioning.joblog import logging_to


def main(claims: Sequence[str], output: str) -> None:
    """Write the ledger, digits as printed and as computed."""
    ledger = pd.concat([pd.read_csv(path, dtype=str, keep_default_na=False) for path in claims])
    with replacing(output) as temporary:
        ledger.to_csv(temporary, index=False, lineterminator="\n")


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(snakemake.input.claims, snakemake.output[0])
