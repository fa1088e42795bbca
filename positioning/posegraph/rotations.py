"""A first guess of all poses from headings alone, then from places: two linear problems.

See Carlone et al. (2015), "Initialization techniques for 3D SLAM: a survey on rotation estimation and its use
in pose graph optimization", section III, chordal relaxation; here in the plane, with complex numbers.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

from positioning.model import Array
from positioning.posegraph.graph import PoseGraph

_NONE = np.zeros(0, dtype=np.intp)
# A heading whose mean of all edges is nothing has no direction.
_NO_LENGTH = 1e-9
# Of the largest curvature: motions may have no information in a direction, and what nothing holds stays.
_RIDGE = 1e-12


def rotations_first(graph: PoseGraph) -> Array:
    """Return poses that agree with the turns of all motion edges, and then with their translations.

    First the complex numbers of modulus one that stand for headings are freed from their modulus, which makes
    the sum of weighted squares over all turns linear, and are scaled back to one. With these headings the
    translations of eq. 6 of Gu et al. are linear in the places. Each is one sparse solution, which knows no
    local minimum and does not depend on where the graph begins. Proximity edges tell nothing of headings and
    are left out, and so are robust losses.

    Parameters
    ----------
    graph
        Fixed poses keep their value; in a part that motion edges do not tie to one, its first pose does.

    Returns
    -------
    Array
        [n, 3], metres and radians; headings within half a turn of those of the graph.
    """
    tied = replace(graph, near_from=_NONE, near_to=_NONE, near_weight=None).tied()
    start, pose = np.asarray(graph.pose, dtype=np.float64), np.array(graph.pose, dtype=np.float64)
    free = np.flatnonzero(~tied.fixed)
    if not len(free):
        return pose
    information = np.asarray(graph.motion_information, dtype=np.float64)
    ends = graph.motion_from, graph.motion_to
    turn = np.exp(1j * np.asarray(graph.motion)[:, 2])
    direction = _solved(
        ends,
        [-turn[:, None, None], np.ones((len(turn), 1, 1))],
        information[:, 2:, 2:],
        np.zeros((len(turn), 1)),
        np.exp(1j * start[:, 2:]),
        free,
    )[:, 0]
    known = np.abs(direction) > _NO_LENGTH
    difference = np.angle(np.where(known, direction, 1.0) * np.exp(-1j * start[:, 2]))
    pose[free, 2] += np.where(known, difference, 0.0)[free]

    cos, sin = np.cos(pose[graph.motion_from, 2]), np.sin(pose[graph.motion_from, 2])
    into_first = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], -2)
    pose[:, :2] = _solved(
        ends,
        [-into_first, into_first],
        information[:, :2, :2],
        np.asarray(graph.motion)[:, :2],
        start[:, :2],
        free,
    )
    return pose


def _solved(
    ends: tuple[np.ndarray, np.ndarray],
    factors: list[np.ndarray],
    information: Array,
    measured: Array,
    value: np.ndarray,
    free: np.ndarray,
) -> np.ndarray:
    """Return the values [n, d] of least weighted squares of what each edge measures of its two ends.

    Rows of ``free`` are unknown. An edge has the residual ``factor_from x + factor_to y - measured``, [e, d].
    """
    count, size = value.shape
    edges = len(measured)
    row = np.arange(edges * size).reshape(edges, size)
    places = [size * end[:, None] + np.arange(size) for end in ends]
    shape = (edges, size, size)
    rows = np.concatenate([np.broadcast_to(row[:, :, None], shape).ravel()] * 2)
    columns = np.concatenate([np.broadcast_to(place[:, None, :], shape).ravel() for place in places])
    entries = np.concatenate([factor.ravel() for factor in factors])
    design = coo_array((entries, (rows, columns)), shape=(edges * size, count * size)).tocsc()
    weight = coo_array(
        (
            information.ravel(),
            (
                np.broadcast_to(row[:, :, None], shape).ravel(),
                np.broadcast_to(row[:, None, :], shape).ravel(),
            ),
        ),
        shape=(edges * size, edges * size),
    ).tocsc()
    unknown = (size * free[:, None] + np.arange(size)).ravel()
    found = value.astype(entries.dtype).ravel()
    residual = measured.ravel() - design @ found
    chosen = design[:, unknown]
    matrix = chosen.conj().T @ weight @ chosen
    diagonal = np.arange(len(unknown))
    ridge = np.full(len(unknown), _RIDGE * np.abs(matrix.diagonal()).max(initial=0.0) or 1.0)
    matrix = (matrix + coo_array((ridge, (diagonal, diagonal)), shape=matrix.shape)).tocsc()
    options = {"SymmetricMode": True}
    factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
    found[unknown] += factor.solve(chosen.conj().T @ (weight @ residual))
    return np.asarray(found.reshape(count, size))
