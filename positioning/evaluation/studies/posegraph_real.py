"""What published pose graphs allow to count where nobody knows the truth: one cost for all answers.

See Gu et al., eqs. 3 to 5 and 10.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from positioning.evaluation.tracks import Answer, Named, answers, lines, table
from positioning.files import Tree
from positioning.model import world
from positioning.posegraph.costs import NearCost
from positioning.posegraph.optimiser import cost
from positioning.tasks.pose_graph import graph_of

NEAR = NearCost.of_distance(1.0)
"""What a pair of near places costs, for all rows alike: squares of metres beyond 2 m, flat from 30 m on.

The standard deviation of one metre is assumed.
"""


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the study's own measures of every row and graph, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the graphs by path, ``.../<batch>/<side>.npz``.

    Returns
    -------
    DataFrame
        ``cost_start`` and ``cost``: sum of squares of all edges at the poses given and at those of the
        answer, with the cost `NEAR` and no robust loss, whatever the row itself minimises; ``cost_motion``
        and ``cost_near``: its parts; ``iterations``: steps of the search.
    """
    return table(lines(answer, _of_row(answer)) for answer in answers(estimates, worlds))


def _of_row(answer: Answer) -> Iterator[Named]:
    starts, parts = [], []
    for index in range(len(answer.world)):
        graph = graph_of(world(answer.observed, index))
        found = (np.asarray(answer.estimates[name])[index] for name in ("position_m", "heading_rad"))
        position_m, heading_rad = found
        pose = np.concatenate([position_m, heading_rad[:, None]], axis=-1)
        starts.append(sum(cost(graph, near=NEAR)))
        parts.append(cost(replace(graph, pose=pose), near=NEAR))
    motion, near = np.array(parts).T
    yield "cost_start", np.array(starts)
    yield "cost", motion + near
    yield "cost_motion", motion
    yield "cost_near", near
    if "extra_iterations" in answer.estimates:
        yield "iterations", np.asarray(answer.estimates["extra_iterations"], dtype=float)
