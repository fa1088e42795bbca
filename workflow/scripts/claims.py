"""Judge a study's claims: printed numbers beside rebuilt ones, with an interval and a verdict."""

import pandas as pd

from positioning.evaluation.claims import judge
from positioning.files import read_json, read_yaml, replacing
from positioning.joblog import logging_to


def main(
    study: str,
    paper: str,
    family: str,
    measures: str,
    times: str,
    calibration: str | None,
    papers: str,
    output: str,
) -> None:
    """Write the study's part of the ledger; run time counts as one more measure of each world."""
    seconds = pd.read_csv(times).rename(columns={"seconds": "x"}).assign(metric="seconds")
    known = pd.concat([pd.read_parquet(measures), seconds], ignore_index=True)
    calibrated = {
        step["claim"]: f"set {step['setting']} = {step['value']:g} on {step['worlds']} other worlds"
        for step in (read_json(calibration) if calibration else [])
    }
    claims = [claim for claim in read_yaml(papers)["claims"] if claim["study"] == study]
    ledger = judge(claims, known, paper=paper, study=study, family=family, calibrated=calibrated)
    with replacing(output) as temporary:
        ledger.to_csv(temporary, index=False, float_format="%.6g", lineterminator="\n")


if __name__ == "__main__":
    with logging_to(snakemake.log[0]):
        main(
            snakemake.wildcards.study,
            snakemake.params.paper,
            snakemake.params.family,
            snakemake.input.measures,
            snakemake.input.times,
            snakemake.input.get("calibration"),
            snakemake.input.paper,
            snakemake.output[0],
        )
