"""The graph as it is given: no search at all."""

import numpy as np

from positioning.model import Array
from positioning.posegraph.graph import PoseGraph, Solved, checked


class DeadReckoning:
    """Every pose where the search of the others begins.

    See Gu et al., eq. 6: motions one after the other from the first pose, as the files hold them.
    """

    def solve(self, graph: PoseGraph, rng: np.random.Generator) -> Solved:
        """Return the poses as they are given.

        Parameters
        ----------
        graph
            One graph.
        rng
            Not used.

        Raises
        ------
        InputError
            For a graph that cannot be used.
        """
        pose: Array = np.array(checked(graph).pose, dtype=np.float64)
        return Solved(pose, {"iterations": np.array(0)})
