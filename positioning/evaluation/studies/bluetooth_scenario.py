"""The point that each solver finds in the printed scenario.

See Raghavan et al., Figure 4.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from positioning.evaluation.measures import MEASURES
from positioning.files import Tree


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return ``x_m`` and ``y_m`` of each row, columns ``MEASURES``.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Not needed.
    """
    lines = []
    for path, tree in estimates.items():
        for branch, step in tree.items():
            if str(step["skipped"]):
                continue
            family, row, value = branch.rpartition("/")[0], Path(path).parent.name, float(step["value"])
            position_m = np.asarray(step["estimate.position_m"], dtype=float).reshape(len(step["world"]), -1)
            for metric, values in (("x_m", position_m[:, 0]), ("y_m", position_m[:, 1])):
                lines += [
                    (family, row, value, world, metric, x)
                    for world, x in zip(step["world"], values, strict=True)
                ]
    return pd.DataFrame(lines, columns=MEASURES)
