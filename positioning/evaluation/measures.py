"""From raw errors to one value a world, and from these to the rows of a table."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.metrics import METRICS, figures_of_merit
from positioning.evaluation.statistics import paired_difference, single_experiment_interval
from positioning.tasks import NOT_ASKED

MEASURES = ["family", "algorithm", "value", "world", "metric", "x"]
TABLE = ["algorithm", "family", "worlds", "n", "mean_m", "se_m", "sd_worlds_m", "rmse_m"]
TABLE += ["p50_m", "p75_m", "p90_m", "p95_m", "max_m", "mean_low_m", "mean_high_m"]
NO_ANSWER = "it has no solution for any sample"
NO_TRUTH = "nobody knows the true places here; its other measures stand in the figures"
PAIRED = ["family", "algorithm", "against", "difference_m", "low_m", "high_m", "share_smaller", "n", "unit"]


def measure(errors: pd.DataFrame, algorithm: str) -> pd.DataFrame:
    """Return every metric of every world of one algorithm, as rows ``MEASURES``.

    Parameters
    ----------
    errors
        Raw errors: ``family, value, world, sample, error_m``; ``value`` is NaN outside sweeps.
    algorithm
        The row's name.
    """
    parts: list[tuple[object, ...]] = []
    # Families keep their order: the first one is what a claim speaks of unless it names another.
    for family in errors["family"].unique():
        own = errors[errors["family"] == family].sort_values("sample", kind="stable")
        for (value, world), group in own.groupby(["value", "world"], dropna=False):
            merits = figures_of_merit(group["error_m"].to_numpy(dtype=float))
            parts.extend((family, algorithm, value, world, name, float(x)) for name, x in merits.items())
    return pd.DataFrame(parts, columns=MEASURES)


def table(
    measures: pd.DataFrame,
    rows: Sequence[str],
    families: Sequence[str],
    skipped: Mapping[tuple[str, str], str],
    published: Mapping[tuple[str, str], Mapping[str, str]],
) -> pd.DataFrame:
    """Return one row an algorithm and family: means over worlds, spread, published numbers, note.

    Parameters
    ----------
    measures
        As `measure` returns them, of all algorithms.
    rows
        Algorithms in the order of the table.
    families
        Families of worlds, or recordings, in their order.
    skipped
        Reason by (family, algorithm), for algorithms that could not run there.
    published
        Printed digits by (family, algorithm) and metric.
    """
    metrics = sorted({metric for numbers in published.values() for metric in numbers} & METRICS.keys())
    lines = []
    keys = ["family", "algorithm", "world"]
    wide = measures.pivot_table(index=keys, columns="metric", values="x").reset_index()
    if "n" not in wide:
        wide["n"] = np.nan
    for family in families:
        for algorithm in rows:
            if skipped.get((family, algorithm)) == NOT_ASKED:
                continue
            line: dict[str, Any] = {"algorithm": algorithm, "family": family}
            line |= {
                f"published_{metric}": published.get((family, algorithm), {}).get(metric, "")
                for metric in metrics
            }
            worlds = wide[(wide["family"] == family) & (wide["algorithm"] == algorithm)]
            measured, worlds = not worlds.empty, worlds[worlds["n"].notna()]
            # Where no row of a family has an error, it is the truth that is missing.
            unknown = measured and wide.loc[wide["family"] == family, "n"].isna().all()
            reason = NO_TRUTH if unknown else NO_ANSWER
            line["note"] = skipped.get((family, algorithm), reason if worlds.empty else "")
            if not line["note"]:
                interval = single_experiment_interval(worlds["mean_m"].to_numpy(dtype=float))
                line |= {name: worlds[name].mean() for name in METRICS}
                line |= {
                    "worlds": len(worlds),
                    "n": round(worlds["n"].mean()),
                    "sd_worlds_m": worlds["mean_m"].std(ddof=1),
                    "mean_low_m": interval.low if len(worlds) > 1 else np.nan,
                    "mean_high_m": interval.high if len(worlds) > 1 else np.nan,
                }
            lines.append(line)
    columns = [*TABLE, *(f"published_{metric}" for metric in metrics), "note"]
    return pd.DataFrame(lines, columns=columns).astype({"worlds": "Int64", "n": "Int64"})


def paired(
    errors: Mapping[str, pd.DataFrame],
    rows: Sequence[str],
    families: Sequence[str],
    quantities: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Return paired differences of mean errors between the rows of a table, on the same worlds.

    Only rows whose errors are of the same quantity are compared, at the samples at which both have one.
    Where a family is a single recording, the samples of that recording are the pairs; that is said in the
    column ``unit``, because samples of one place are not independent of each other.

    Parameters
    ----------
    errors
        Raw errors by row.
    rows, families
        As in `table`.
    quantities
        What the errors of each row are errors of; None where all are of one quantity.
    """
    lines = []
    for family in families:
        present = [row for row in rows if (errors[row]["family"] == family).any()]
        if not present:
            continue
        own = {row: errors[row][errors[row]["family"] == family] for row in present}
        wide = pd.concat({row: f.set_index(["world", "sample"])["error_m"] for row, f in own.items()}, axis=1)
        world = wide.index.get_level_values("world")
        unit = "world" if world.nunique() > 1 else "sample"
        group = world.factorize(sort=True)[0] if unit == "world" else np.arange(len(wide))
        values = {row: wide[row].to_numpy(dtype=float) for row in present}
        for algorithm in present:
            for against in present:
                if algorithm != against and (
                    quantities is None or quantities[algorithm] == quantities[against]
                ):
                    means = _common_means(values[algorithm], values[against], group)
                    lines.append((family, algorithm, against, *paired_difference(*means), unit))
    return pd.DataFrame(lines, columns=PAIRED)


def _common_means(
    first: NDArray[np.float64], second: NDArray[np.float64], group: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean of both in each group, over the samples at which both have an error."""
    common = ~np.isnan(first + second)
    count = np.bincount(group[common], minlength=group.max(initial=-1) + 1)
    sums = [np.bincount(group[common], values[common], len(count)) for values in (first, second)]
    return sums[0][count > 0] / count[count > 0], sums[1][count > 0] / count[count > 0]


def published_numbers(
    claims: Iterable[Mapping[str, Any]], families: Sequence[str]
) -> dict[tuple[str, str], dict[str, str]]:
    """Return the printed digits that belong to rows of the table, by (family, algorithm) and metric.

    A printed number that no verdict judges may stand beside the rebuilt one as well.
    """
    found: dict[tuple[str, str], dict[str, str]] = {}
    for claim in claims:
        quantity = claim.get("quantity", {})
        told = claim["kind"] == "value" or (claim["kind"] == "words" and "printed" in claim and quantity)
        if told and quantity.keys() <= {"algorithm", "metric", "family"}:
            for family in [quantity["family"]] if "family" in quantity else families:
                found.setdefault((family, quantity["algorithm"]), {})[quantity["metric"]] = claim["printed"]
    return found
