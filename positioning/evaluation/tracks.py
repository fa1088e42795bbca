"""What studies of moving receivers count beside errors where they are asked for: smoothness and drift."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from positioning.evaluation.measures import MEASURES
from positioning.evaluation.statistics import mean_where
from positioning.files import Tree

Values = NDArray[np.float64]
Named = tuple[str, Values]
Arrays = Mapping[str, NDArray[np.generic]]


class Answer(NamedTuple):
    """What one row answered in one family of worlds, with the worlds that it was asked about.

    Attributes
    ----------
    row, family
        Their names.
    value
        Of the setting that a sweep varies, NaN for rows of a table.
    world
        Numbers of the worlds, [w].
    estimates, observed, truth
        Arrays of these worlds, [w, ...]; names of estimates without their prefix.
    batch
        Name of the batch.
    """

    row: str
    family: str
    value: float
    world: NDArray[np.generic]
    estimates: Arrays
    observed: Arrays
    truth: Arrays
    batch: str


def answers(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> Iterator[Answer]:
    """Yield every answer of every row, without what was skipped.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the worlds by path, ``.../<batch>/<side>.npz``.
    """
    sides = {(Path(p).parent.name, Path(p).stem): tree for p, tree in worlds.items()}
    for path, tree in estimates.items():
        row, batch = Path(path).parent.name, Path(path).stem
        for branch, step in tree.items():
            if str(step["skipped"]):
                continue
            family, count = branch.rpartition("/")[0], len(step["world"])
            prefix = "estimate."
            yield Answer(
                row=row,
                family=family,
                value=float(step["value"]),
                world=step["world"],
                estimates={
                    name.removeprefix(prefix): v for name, v in step.items() if name.startswith(prefix)
                },
                observed={
                    name: v[:count] for name, v in sides.get((batch, "observed"), {}).get(family, {}).items()
                },
                truth={name: v[:count] for name, v in sides[batch, "truth"][family].items()},
                batch=batch,
            )


def lines(answer: Answer, named: Iterable[Named]) -> pd.DataFrame:
    """Return what was counted of an answer, columns ``MEASURES``; worlds without a value are left out."""
    parts = [
        pd.DataFrame(
            {
                "family": answer.family,
                "algorithm": answer.row,
                "value": answer.value,
                "world": answer.world[kept],
                "metric": metric,
                "x": values[kept],
            }
        )
        for metric, values in named
        if (kept := ~np.isnan(values)).any()
    ]
    return table(parts)


def table(parts: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Return all parts as one, columns ``MEASURES``, also where there is none."""
    filled = [part for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True)[MEASURES] if filled else pd.DataFrame(columns=MEASURES)


def of_track(estimate_m: Values, asked_m: Values, path_m: Values) -> Iterator[Named]:
    """Yield what is counted of tracks, one value a world.

    ``final_m``: error at the last epoch at which one is asked for. ``path_mean_m``: mean error at all
    epochs. ``first_quarter_m``, ``last_quarter_m``, ``first_half_m`` and ``second_half_m``: the same in these
    parts of them. ``jump_m``: root mean square of how far a step of the track differs from the true one.

    Parameters
    ----------
    estimate_m
        Estimated places, [w, n, 2], metres; NaN after the end.
    asked_m
        True places where an error is asked for, [w, n, 2], else NaN.
    path_m
        True places at all epochs, [w, n, 2].
    """
    error_m = np.linalg.norm(estimate_m - asked_m, axis=-1)
    asked = ~np.isnan(error_m)
    last = asked.shape[1] - 1 - np.argmax(asked[:, ::-1], axis=1)
    yield "final_m", np.take_along_axis(error_m, last[:, None], axis=1)[:, 0]
    everywhere_m = np.linalg.norm(estimate_m - path_m, axis=-1)
    known = ~np.isnan(everywhere_m)
    yield "path_mean_m", mean_where(everywhere_m, known)
    part = np.arange(known.shape[1]) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    for name, chosen in (
        ("first_quarter", part < 0.25),
        ("last_quarter", part >= 0.75),
        ("first_half", part < 0.5),
        ("second_half", part >= 0.5),
    ):
        yield f"{name}_m", mean_where(everywhere_m, known & chosen)
    jump_m = np.linalg.norm(np.diff(estimate_m - path_m, axis=1), axis=-1)
    yield "jump_m", np.sqrt(mean_where(np.square(jump_m), ~np.isnan(jump_m)))


def share(holds: NDArray[np.bool_], asked: NDArray[np.bool_]) -> Values:
    """Return the share of what was asked that holds, [w]; NaN where nothing was asked."""
    return mean_where(holds.astype(float), asked)
