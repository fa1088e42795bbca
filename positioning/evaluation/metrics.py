"""From raw errors to the figures of merit of one experiment."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

Errors = NDArray[np.float64]

METRICS: Mapping[str, Callable[[Errors], NDArray[np.float64]]] = {
    "n": lambda e: np.full(e.shape[:-1], e.shape[-1], dtype=float),
    "mean_m": lambda e: e.mean(axis=-1),
    "se_m": lambda e: (
        e.std(axis=-1, ddof=1) / np.sqrt(e.shape[-1]) if e.shape[-1] > 1 else np.zeros(e.shape[:-1])
    ),
    "rmse_m": lambda e: np.sqrt(np.square(e).mean(axis=-1)),
    "p50_m": lambda e: np.percentile(e, 50, axis=-1),
    "p75_m": lambda e: np.percentile(e, 75, axis=-1),
    "p90_m": lambda e: np.percentile(e, 90, axis=-1),
    "p95_m": lambda e: np.percentile(e, 95, axis=-1),
    "max_m": lambda e: e.max(axis=-1),
}
"""Name to function of errors [..., sample]; percentiles interpolate linearly between order statistics.

``se_m`` is the standard error of the mean within one experiment, as papers print behind a plus-minus.
"""


def figures_of_merit(error_m: Errors) -> dict[str, NDArray[np.float64]]:
    """Return every metric of errors [..., sample], in metres; NaN errors are no samples.

    Raises
    ------
    ValueError
        Where not every leading index has the same number of samples; give these one by one.
    """
    present = ~np.isnan(error_m)
    counts = present.sum(axis=-1)
    if counts.size and counts.min() != counts.max():
        raise ValueError("experiments of one stack must have the same number of samples")
    if not present.all():
        error_m = error_m[present].reshape(*error_m.shape[:-1], int(counts.flat[0]))
    return {name: metric(error_m) for name, metric in METRICS.items()}
