"""What algorithms that align walks share: a graph of all poses, WiFi edges, walks placed by matched scans."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError, check_number, check_whole
from positioning.geometry import rigid_fit, rotated
from positioning.model import Aligned, Array, Walks
from positioning.posegraph.graph import PoseGraph
from positioning.posegraph.residuals import MOTION_INFORMATION
from positioning.posegraph.similarity import near_pairs, rss_distance_db, window_threshold_db
from positioning.walks import check_walks, motion

Indices = NDArray[np.integer[Any]]

# Hypotheses that are refined, and how often: refinement by least squares settles within a few rounds.
_REFINED, _ROUNDS = 10, 10


@dataclass(frozen=True)
class Poses:
    """The poses of all walks, one walk after the other.

    Attributes
    ----------
    there
        Where they stand among the walks, [k, n].
    walk
        Number of the walk, [m].
    time_s
        Time from the start of the walk, [m], seconds.
    pose
        x, y and heading as dead reckoned, each walk in its own frame, [m, 3], metres and radians.
    rss_dbm
        [m, ap], dBm; NaN = not heard.
    """

    there: NDArray[np.bool_]
    walk: Indices
    time_s: Array
    pose: Array
    rss_dbm: Array

    @property
    def heard(self) -> NDArray[np.bool_]:
        """Whether a pose has a scan that hears an access point, [m]."""
        return np.asarray(np.isfinite(self.rss_dbm).any(axis=-1))

    @cached_property
    def scan_distance_db(self) -> Array:
        """Distance of all pairs of poses with such a scan by eq. 9, dB; computed once."""
        return rss_distance_db(self.rss_dbm[self.heard])

    @property
    def heard_by_walk(self) -> NDArray[np.bool_]:
        """Whether a walk has such a scan, [k]."""
        return np.bincount(self.walk, weights=self.heard, minlength=len(self.there)) > 0

    @property
    def reference(self) -> int:
        """The first pose of the first walk with a scan, or of the first walk where none has one."""
        return int(np.argmax(self.walk == np.argmax(self.heard_by_walk)))


class Placed(NamedTuple):
    """Where walks lie in the frame of others.

    Attributes
    ----------
    turn_rad, shift_m
        [k] and [k, 2]: a dead-reckoned place p is at ``rotated(p, turn_rad) + shift_m``.
    part
        Number of the walk whose frame that is, [k]; a walk that is joined to no other has its own.
    matches
        Matched scans that agreed when the walk was joined, [k]; 0 for one whose frame stays.
    reason
        Why a walk is not joined to the reference, in words, [k], empty for those that are; None = not told.
    """

    turn_rad: Array
    shift_m: Array
    part: Indices
    matches: Indices
    reason: NDArray[np.str_] | None = None


class Placing(Protocol):
    """What can be the part ``alignment`` of an algorithm: it says where walks lie, as `place_walks` does."""

    def placed(self, poses: Poses, rng: np.random.Generator) -> Placed:
        """Return where the walks lie; one that is joined to no other keeps its frame.

        Parameters
        ----------
        poses
            All walks.
        rng
            The only source of randomness.
        """


def placed_by(alignment: Placing, poses: Poses, rng: np.random.Generator) -> Placed:
    """Return where an algorithm places the walks.

    Parameters
    ----------
    alignment
        The algorithm.
    poses
        All walks.
    rng
        The only source of randomness.

    Raises
    ------
    InputError
        For what is no such algorithm, and for an answer that is no `Placed` or of the wrong shape.
    """
    if isinstance(alignment, type) or not callable(getattr(alignment, "placed", None)):
        raise InputError(
            f"alignment={alignment!r}",
            "it has no method placed(poses, rng)",
            "Give an algorithm that has one, RansacAlignment() for example",
        )
    placed = alignment.placed(poses, rng)
    thing, walks = f"the answer of {type(alignment).__name__}.placed", len(poses.there)
    if not isinstance(placed, Placed):
        limit = f"it is a {type(placed).__name__}, a Placed of positioning.walk_alignment is needed"
        raise InputError(thing, limit, "Correct the algorithm")
    for name, shape in (
        ("turn_rad", (walks,)),
        ("shift_m", (walks, 2)),
        ("part", (walks,)),
        ("matches", (walks,)),
    ):
        found = np.shape(getattr(placed, name))
        if found != shape:
            limit = f"the shape is {found}, {shape} is needed"
            raise InputError(f"{thing}, {name}", limit, "Correct the algorithm")
    return placed


def poses_of(walks: Walks) -> Poses:
    """Return the poses of all walks, one walk after the other.

    See Gu et al., section III-B: graphs of several walks are built as if they were one.

    Parameters
    ----------
    walks
        One world.

    Raises
    ------
    InputError
        For walks that cannot be used, see `positioning.walks.check_walks`.
    """
    there = check_walks(walks)
    position_m = np.asarray(walks.position_m, dtype=np.float64)[there]
    heading_rad = np.asarray(walks.heading_rad, dtype=np.float64)[there]
    return Poses(
        there=there,
        walk=np.nonzero(there)[0],
        time_s=np.asarray(walks.time_s, dtype=np.float64)[there],
        pose=np.concatenate([position_m, heading_rad[:, None]], axis=-1),
        rss_dbm=np.asarray(walks.rss_dbm, dtype=np.float64)[there],
    )


def motion_graph(poses: Poses, pose: Array | None = None) -> PoseGraph:
    """Return the graph of the motion alone: no edge leads from walk to walk.

    See Gu et al., eqs. 6 to 8. The reference is fixed.

    Parameters
    ----------
    poses
        The walks; the motion is that of their dead reckoning.
    pose
        Where to start, [m, 3], metres and radians; None = the dead reckoning itself.
    """
    start = np.flatnonzero(np.diff(poses.walk) == 0)
    step = motion(poses.pose[:, :2], poses.pose[:, 2])[start]
    return PoseGraph(
        pose=poses.pose if pose is None else pose,
        motion_from=start,
        motion_to=start + 1,
        motion=step,
        motion_information=np.broadcast_to(MOTION_INFORMATION, (len(start), 3, 3)),
        fixed=np.arange(len(poses.pose)) == poses.reference,
    )


def wifi_pairs(
    poses: Poses,
    *,
    window: int,
    exclude_s: float,
    exclude_m: float,
    threshold: Literal["median"] | float = "median",
    decides: Literal["later", "either", "both"] = "both",
) -> tuple[Indices, Indices]:
    """Return pairs of poses whose fingerprints are alike.

    See Gu et al., eq. 9 and section III-B, and `positioning.posegraph.similarity.near_pairs`.

    Parameters
    ----------
    poses
        All walks.
    window
        L, scans, of the adaptive threshold.
    exclude_s, exclude_m
        Poses of one walk that are less than this apart in time, or in dead-reckoned place, make no pair,
        seconds and metres.
    threshold
        "median" for the median within the window, or a number of decibels.
    decides
        Whose threshold the distance of two scans must be below: that of both, of either, or of the later one
        in the order of the walks.

    Returns
    -------
    near_from, near_to
        [f] each; empty where no walk has a scan.

    Raises
    ------
    InputError
        For settings outside their range.
    """
    for name, value in (("exclude_s", exclude_s), ("exclude_m", exclude_m)):
        check_number(name, value, least=0)
    _check_window(window)
    if threshold != "median":
        if isinstance(threshold, str):
            cure = "Give 'median' or decibels above zero"
            raise InputError(f"threshold={threshold!r}", "it is neither 'median' nor a number", cure)
        check_number("threshold", threshold, above=0)
    if decides not in ("later", "either", "both"):
        raise InputError(f"decides={decides!r}", "it is none of later, either and both", "Correct it")
    if not poses.heard.any():
        return np.zeros(0, dtype=np.intp), np.zeros(0, dtype=np.intp)
    return near_pairs(
        poses.walk,
        poses.time_s,
        poses.rss_dbm,
        window=window,
        exclude_s=exclude_s,
        threshold=threshold,
        position_m=poses.pose[:, :2],
        exclude_m=exclude_m,
        decides=decides,
        distance_db=poses.scan_distance_db,
    )


def place_walks(
    poses: Poses,
    rng: np.random.Generator,
    *,
    window: int,
    inlier_m: float,
    segment_s: float,
    hypotheses: int,
    least_matches: int,
    least_share: float,
) -> Placed:
    """Lay walks upon each other by scans that are alike.

    Not in the paper, whose start at (0, 0, psi) may leave walks where eq. 10 is flat. A scan is matched with
    that of another walk if each is the other's nearest by eq. 9, within the adaptive thresholds of both, and
    both hear an access point in common. Two matches give a rotation and a shift of one walk onto the other;
    drawn pairs of matches are hypotheses (Fischler & Bolles 1981, "Random sample consensus"), judged by the
    sum over all matches of the squared distance, cut off at ``inlier_m`` (Torr & Zisserman 2000, "MLESAC").
    As dead reckoning drifts, both matches of a pair lie within ``segment_s`` in either walk: a long walk that
    bends is then placed by the parts that agree best. The best hypotheses are refined by least squares.

    Walks are joined one by one, from the reference on: always the walk with the most matches that agree with
    one that is placed, as in a maximum spanning tree. Last, each walk in turn is laid on all others whose
    matches joined, over all matches that agree.

    Parameters
    ----------
    poses
        All walks.
    rng
        Draws the hypotheses.
    window
        L, scans, of the adaptive threshold.
    inlier_m
        Matched scans agree if they are this near, metres: an error of the match and of some drift.
    segment_s
        Longest time between the two matches of a hypothesis, seconds.
    hypotheses
        Number drawn for each pair of walks.
    least_matches, least_share
        Number and share of the matches that must agree for walks to be joined.

    Returns
    -------
    Placed
        A walk that cannot be joined keeps its frame.

    Raises
    ------
    InputError
        For settings outside their range.
    """
    _check_window(window)
    check_number("inlier_m", inlier_m, above=0)
    check_number("segment_s", segment_s, above=0)
    check_whole("hypotheses", hypotheses, least=1)
    check_whole("least_matches", least_matches, least=2)
    check_number("least_share", least_share)
    if not 0 <= least_share <= 1:
        raise InputError(f"least_share={least_share}", "it is not between 0 and 1", "Correct it")
    count = len(poses.there)
    matches = {}
    support = np.zeros((count, count), dtype=np.intp)
    relative: dict[tuple[int, int], tuple[float, Array]] = {}
    best: dict[int, tuple[int, str]] = {}
    for one, two, first, second in _matches(poses, window):
        matches[one, two], matches[two, one] = (first, second), (second, first)
        found = _consensus(poses, second, first, rng, inlier_m, segment_s, hypotheses)
        agreeing = 0 if found is None else found[2]
        needed = max(least_matches, math.ceil(least_share * len(first)))
        for own_walk, other_walk in ((one, two), (two, one)):
            if len(first) and agreeing > best.get(own_walk, (-1, ""))[0]:
                text = f"{agreeing} of {len(first)} matched scans agree with walk {other_walk}"
                best[own_walk] = agreeing, f"{text}, {needed} are needed"
        if found is None:
            continue
        turn_rad, shift_m, _ = found
        if agreeing >= needed:
            support[one, two] = support[two, one] = agreeing
            relative[one, two] = (turn_rad, shift_m)
            relative[two, one] = (-turn_rad, -rotated(shift_m, -turn_rad))

    turn, shift, part = np.zeros(count), np.zeros((count, 2)), np.full(count, -1)
    joined_by = np.zeros(count, dtype=np.intp)
    order = []
    roots = [int(poses.walk[poses.reference]), *range(count)]
    for root in roots:
        if part[root] >= 0:
            continue
        part[root] = root
        while True:
            open_support = np.where((part == root)[:, None] & (part < 0), support, 0)
            if not open_support.any():
                break
            to, walk = (int(i) for i in np.unravel_index(np.argmax(open_support), support.shape))
            turn_rad, shift_m = relative[to, walk]
            turn[walk] = turn[to] + turn_rad
            shift[walk] = rotated(shift_m, turn[to]) + shift[to]
            part[walk], joined_by[walk] = root, support[to, walk]
            order.append(walk)
    # Errors of the pairs add up along the tree; each walk on all others shares them out.
    for _ in range(_ROUNDS if len(order) > 1 else 0):
        for walk in order:
            others = np.flatnonzero(support[walk])
            own = np.concatenate([matches[walk, int(to)][0] for to in others])
            other = np.concatenate([matches[walk, int(to)][1] for to in others])
            on = poses.walk[other]
            target_m = rotated(poses.pose[other, :2], turn[on]) + shift[on]
            point_m = poses.pose[own, :2]
            placed_m = rotated(point_m, turn[walk]) + shift[walk]
            agree = np.linalg.norm(placed_m - target_m, axis=-1) < inlier_m
            if np.count_nonzero(agree) >= least_matches:
                angle, move = rigid_fit(point_m, target_m, agree)
                turn[walk], shift[walk] = float(angle), move
    reason = _reasons(poses, part, {walk: text for walk, (_, text) in best.items()})
    return Placed(turn_rad=turn, shift_m=shift, part=part, matches=joined_by, reason=reason)


def _reasons(poses: Poses, part: Indices, best: Mapping[int, str]) -> NDArray[np.str_]:
    """Return why walks are not joined to the reference, empty for those that are."""
    root = part[poses.walk[poses.reference]]
    reasons = []
    for walk, (own, heard) in enumerate(zip(part, poses.heard_by_walk, strict=True)):
        others = np.flatnonzero((part == own) & (np.arange(len(part)) != walk))
        if own == root:
            reasons.append("")
        elif not heard:
            reasons.append("no scan hears an access point")
        elif len(others):
            reasons.append(f"joined to walk {int(others[0])}, which is not joined to the reference")
        else:
            reasons.append(best.get(walk, "no scan matches one of another walk"))
    return np.array(reasons, dtype=np.str_)


def moved(poses: Poses, turn_rad: Array, shift_m: Array) -> Array:
    """Return the poses with each walk turned and shifted, [m, 3].

    Parameters
    ----------
    poses
        All walks.
    turn_rad, shift_m
        Of each walk, [k] and [k, 2], radians and metres.
    """
    turn, shift = np.asarray(turn_rad)[poses.walk], np.asarray(shift_m)[poses.walk]
    position_m = rotated(poses.pose[:, :2], turn) + shift
    return np.concatenate([position_m, (poses.pose[:, 2] + turn)[:, None]], axis=-1)


def in_reference_frame(poses: Poses, pose: Array, extra: dict[str, NDArray[np.generic]]) -> Aligned:
    """Return the answer in the frame in which the reference is at (0, 0) with heading zero.

    See Gu et al., section III-A: the first pose of one of the walks is the reference.

    Parameters
    ----------
    poses
        All walks.
    pose
        Their poses in some common frame, [m, 3], metres and radians.
    extra
        What else to keep.
    """
    origin = pose[poses.reference]
    position_m = np.full((*poses.there.shape, 2), np.nan)
    heading_rad = np.full(poses.there.shape, np.nan)
    position_m[poses.there] = rotated(pose[:, :2] - origin[:2], -origin[2])
    heading_rad[poses.there] = pose[:, 2] - origin[2]
    return Aligned(position_m=position_m, heading_rad=heading_rad, extra=extra)


def _check_window(window: int) -> None:
    check_whole("window", window, least=2)


def _matches(poses: Poses, window: int) -> Iterator[tuple[int, int, Indices, Indices]]:
    """Yield two walks, and poses of the first and of the second one that match."""
    scan = np.flatnonzero(poses.heard)
    if not len(scan):
        return
    walk = poses.walk[scan]
    distance_db = poses.scan_distance_db
    limit_db = window_threshold_db(distance_db, walk, window)
    heard = np.isfinite(poses.rss_dbm[scan])
    present = np.unique(walk)
    of_walk = {int(number): np.flatnonzero(walk == number) for number in present}
    for one, two in ((int(a), int(b)) for a in present for b in present if a < b):
        mine, other = of_walk[one], of_walk[two]
        block = distance_db[np.ix_(mine, other)]
        nearest = np.argmin(block, axis=1)
        mutual = np.argmin(block, axis=0)[nearest] == np.arange(len(mine))
        first, second = mine[mutual], other[nearest[mutual]]
        found_db = distance_db[first, second]
        good = (found_db < limit_db[first]) & (found_db < limit_db[second])
        good &= (heard[first] & heard[second]).any(axis=-1)
        yield one, two, scan[first[good]], scan[second[good]]


def _consensus(
    poses: Poses,
    own: Indices,
    other: Indices,
    rng: np.random.Generator,
    inlier_m: float,
    segment_s: float,
    hypotheses: int,
) -> tuple[float, Array, int] | None:
    """Return turn and shift of one walk onto another, and how many matches agree; None = no hypothesis."""
    number = len(own)
    if number < 2:
        return None
    order = np.argsort(poses.time_s[own])
    own, other = own[order], other[order]
    own_s, other_s = poses.time_s[own], poses.time_s[other]
    point_m, target_m = poses.pose[own, :2], poses.pose[other, :2]
    first = rng.integers(number, size=hypotheses)
    low = np.searchsorted(own_s, own_s[first] - segment_s, side="left")
    high = np.searchsorted(own_s, own_s[first] + segment_s, side="right")
    second = low + np.floor(rng.random(hypotheses) * (high - low)).astype(np.intp)
    length_m = np.linalg.norm(point_m[first] - point_m[second], axis=-1)
    target_length_m = np.linalg.norm(target_m[first] - target_m[second], axis=-1)
    # Matches that are close together say nothing of the rotation.
    keep = np.minimum(length_m, target_length_m) > 2 * inlier_m
    keep &= np.abs(length_m - target_length_m) < inlier_m
    keep &= np.abs(other_s[first] - other_s[second]) <= segment_s
    if not keep.any():
        return None
    pair = np.stack([first[keep], second[keep]], axis=-1)

    def residual_m(turn: Array, shift: Array) -> Array:
        placed_m = rotated(point_m, turn[:, None]) + shift[:, None]
        return np.asarray(np.linalg.norm(placed_m - target_m, axis=-1))

    turn_rad, shift_m = rigid_fit(point_m[pair], target_m[pair])
    away_m = residual_m(turn_rad, shift_m)
    cost = np.sum(np.minimum(away_m, inlier_m) ** 2, axis=-1)
    best = np.argsort(cost, kind="stable")[:_REFINED]
    turn_rad, shift_m, cost, agree = turn_rad[best], shift_m[best], cost[best], away_m[best] < inlier_m
    points, targets = (np.broadcast_to(m, (len(best), *m.shape)) for m in (point_m, target_m))
    for _ in range(_ROUNDS):
        new_turn, new_shift = rigid_fit(points, targets, agree)
        away_m = residual_m(new_turn, new_shift)
        new_cost = np.sum(np.minimum(away_m, inlier_m) ** 2, axis=-1)
        # A hypothesis that gets no better keeps two matches that agree or more.
        better = new_cost < cost
        if not better.any():  # nor will it in another round
            break
        turn_rad = np.where(better, new_turn, turn_rad)
        shift_m = np.where(better[:, None], new_shift, shift_m)
        cost = np.where(better, new_cost, cost)
        agree = np.where(better[:, None], away_m < inlier_m, agree)
    winner = int(np.argmin(cost))
    return float(turn_rad[winner]), shift_m[winner], int(np.count_nonzero(agree[winner]))
