"""An algorithm for pose graphs to copy: headings and places from two linear problems, and no search.

Copy this file to ``algorithms/pose_graph/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and add ``<name>: {}`` to the algorithms of a study in
``config/config.yaml``.
"""

import numpy as np

from positioning.errors import InputError
from positioning.posegraph.graph import PoseGraph, Solved
from positioning.posegraph.rotations import rotations_first


class Template:
    """Poses between those given and those that turns, and then translations, tell.

    Say here where your algorithm is described.

    Parameters
    ----------
    share
        0: places as given, 1: as the motions tell.
    """

    # The constructor takes keywords only and stores them as they are; values are checked at use.
    def __init__(self, *, share: float = 1.0) -> None:
        self.share = share

    # An algorithm that cannot run on some graphs also has ``skip(graph) -> str``: the reason, or "".
    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return all poses, the fixed ones where they are.

        Parameters
        ----------
        graph
            One graph: poses to begin with, motions with their information, and pairs of near places.
        rng
            The only source of randomness; not used here.

        Raises
        ------
        InputError
            For a graph that cannot be used, or a share outside of 0 to 1.
        """
        if not 0 <= self.share <= 1:
            raise InputError(f"share={self.share}", "it must lie between 0 and 1", "Choose 1")
        # Refuses what nobody can use, with errors that name the cure.
        graph.check()
        pose = rotations_first(graph)
        pose = graph.pose + self.share * (pose - graph.pose)
        # Whatever stands in ``extra`` is kept with the estimates; studies may count it.
        return Solved(pose, {"iterations": np.array(1)})
