"""Particle filters over place and heading, whose samples come from a motion and partly from fixes.

Many filters run in lock-step; each has a generator of its own, and nothing depends on how many run side by
side. Samples are [filter, variable, sample] here, with x, y and heading as variables.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from positioning.errors import InputError
from positioning.filters.particle_filter import (
    normalise,
    standard_normal,
    uniform,
    weighted_covariance,
    weighted_mean,
)
from positioning.filters.plane import LEAST_VARIANCE_M2, check_settings
from positioning.filters.resampling import Index, effective_sample_size
from positioning.model import Array, Track

# Values of one state variable that are worked on at a time, so that a block stays in the cache.
_BLOCK = 1 << 14

# A normal deviation as wide as a turn is uniform on the circle to nine digits.
_ANY_HEADING_RAD = 2 * np.pi


class Start(NamedTuple):
    """Where the samples lie until the first motion.

    See Atia et al., section 5.6.1.

    Attributes
    ----------
    resting
        Epochs before the first motion, [r, n].
    position_m, sigma_m
        Mean and standard deviation of each coordinate there, [r, n, 2], metres.
    heading_rad
        [r], radians; NaN where nobody noted it: then any heading.
    heading_sigma_rad
        Standard deviation of the noted heading.
    """

    resting: NDArray[np.bool_]
    position_m: Array
    sigma_m: Array
    heading_rad: Array
    heading_sigma_rad: float


class Drive(NamedTuple):
    """What a filter is told of a stack of recordings.

    See Atia et al., section 5.6.

    Attributes
    ----------
    time_s
        Epochs, [r, n], seconds; NaN after the end.
    turn_rad, forward_m, left_m
        Motion since the epoch before in the frame of the heading there, [r, n], radians and metres.
    fix_m
        [r, n, 2], metres; NaN = none.
    start
        Until the first motion; fixes of these epochs make the start and are not taken a second time.
    """

    time_s: Array
    turn_rad: Array
    forward_m: Array
    left_m: Array
    fix_m: Array
    start: Start


class SystemNoise(NamedTuple):
    """Standard deviations of the Gaussian system noise.

    See Atia et al., section 5.6.2, where they are not printed.

    Attributes
    ----------
    turn_rad_per_sqrt_s
        Of the heading after a second; it grows with the root of time.
    distance
        Of a distance, as a share of it.
    """

    turn_rad_per_sqrt_s: float
    distance: float


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """How samples and their weights come about.

    See Atia et al., sections 5.2 to 5.5; without anything set, section 5.2.

    Attributes
    ----------
    from_wifi
        Samples drawn about the fix, as a share of the predicted ones.
    fix_sigma_m
        Their standard deviation in each coordinate, metres.
    weight_prediction, weight_wifi
        Factors A and B, scalars or [r, n].
    clusters
        Clusters of predicted samples that share one weight; None weighs every sample.
    """

    from_wifi: float = 0.0
    fix_sigma_m: float = 1.0
    weight_prediction: float | Array = 0.5
    weight_wifi: float | Array = 0.5
    clusters: int | None = None


def start_at_rest(
    time_s: Array,
    moving: NDArray[np.bool_],
    fix_m: Array,
    anywhere_m: Array,
    *,
    heading_rad: Array,
    sigma_m: float,
    heading_sigma_rad: float,
) -> Start:
    """Return a start about the mean of the fixes before the first motion.

    See Atia et al., section 5.6.1. At each epoch of the first rest it is the mean of the fixes so far. Before
    there is one, it is anywhere in the map: as wide as the surveyed places.

    Parameters
    ----------
    time_s
        [r, n], seconds; NaN after the end.
    moving
        Motion since the epoch before, [r, n]; that of the first epoch does not count.
    fix_m
        [r, n, 2], metres; NaN = none.
    anywhere_m
        Surveyed places, [r, p, 2], metres.
    heading_rad
        [r], radians; NaN = unknown.
    sigma_m
        Standard deviation of each coordinate about the mean of fixes.
    heading_sigma_rad
        Standard deviation of a heading that was noted.
    """
    driven = np.logical_or.accumulate(moving & (np.arange(time_s.shape[1]) > 0), axis=1)
    resting = ~driven & ~np.isnan(time_s)
    there = resting & np.isfinite(fix_m).all(axis=-1)
    # Running sums add one after the other, so that the mean does not depend on what comes later.
    count = np.cumsum(there, axis=1)[..., None]
    mean_m = np.cumsum(np.where(there[..., None], fix_m, 0.0), axis=1) / np.maximum(count, 1)
    centre_m = np.mean(anywhere_m, axis=1)[:, None]
    spread_m = np.maximum(np.std(anywhere_m, axis=1), sigma_m)[:, None]
    return Start(
        resting,
        np.where(count > 0, mean_m, centre_m),
        np.where(count > 0, sigma_m, spread_m),
        heading_rad,
        heading_sigma_rad,
    )


def exponential_weights(distance_m: ArrayLike, factor: ArrayLike = 1.0, scale_m: float = 1.0) -> Array:
    """Return factor * exp(-distance / scale), normalised, [..., p].

    See Atia et al., section 5.2: the Euclidean distance itself, not its square, in metres. The largest
    exponent is taken off all of them first; literally, all weights vanish from 745 metres on.

    Parameters
    ----------
    distance_m
        [..., p], metres.
    factor
        A or B of the paper, broadcast to [..., p], not negative.
    scale_m
        Metres in which a weight falls to 1/e; 1 is the literal formula.
    """
    with np.errstate(divide="ignore"):
        log_factor = np.log(np.asarray(factor, dtype=np.float64))
    return normalise(log_factor - np.asarray(distance_m, dtype=np.float64) / scale_m)


def motion_weights(
    time_s: Array,
    moving: NDArray[np.bool_],
    *,
    near: Sequence[float],
    far: Sequence[float],
    hold_s: float,
    ramp_s: float,
) -> tuple[Array, Array]:
    """Return the factors A and B over time, [..., n] each.

    See Atia et al., section 5.5 and figure 11: A above B at the start and shortly after each stop, then a
    gradual change to B above A in continuous motion.

    Parameters
    ----------
    time_s
        [..., n], seconds.
    moving
        Motion since the epoch before, [..., n].
    near, far
        A and B before and after the ramp.
    hold_s, ramp_s
        Seconds of motion until the ramp begins, and its length.

    Raises
    ------
    InputError
        For senseless settings.
    """
    for name, pair in (("near", near), ("far", far)):
        if np.shape(pair) != (2,):
            raise InputError(f"{name}={pair}", "it must be a pair", "Give the factors A and B")
    check_settings(
        near=(near, 0, 1e6), far=(far, 0, 1e6), hold_s=(hold_s, 0, 1e9), ramp_s=(ramp_s, 1e-6, 1e9)
    )
    standing = ~moving
    standing[..., 0] = True
    stood_s = np.maximum.accumulate(np.where(standing, time_s, -np.inf), axis=-1)
    share = np.clip((time_s - stood_s - hold_s) / ramp_s, 0.0, 1.0)
    first, second = (begin + share * (end - begin) for begin, end in zip(near, far, strict=True))
    return first, second


def draw(weight: Array, uniform_draws: Array) -> Index:
    """Draw any number of samples by weight, in linear time.

    See Atia et al., section 5.3, where more samples are weighted than are kept, and
    `positioning.filters.resampling.linear_time`, which this equals where as many are kept.

    Parameters
    ----------
    weight
        Weights that sum to one, [r, p].
    uniform_draws
        Draws from [0, 1), [r, m + 1] for m samples.

    Returns
    -------
    NDArray
        Index of the sample that each new one copies, [r, m], ascending.
    """
    running = np.cumsum(-np.log1p(-uniform_draws), axis=-1)
    cumulative = np.cumsum(weight, axis=-1)
    total = np.maximum(running[:, -1:], np.finfo(np.float64).tiny)
    position = running[:, :-1] / total * cumulative[:, -1:]
    index = np.empty(position.shape, dtype=np.intp)
    for row, (steps, places) in enumerate(zip(cumulative, position, strict=True)):
        index[row] = steps.searchsorted(places, side="right")
    # Rounding may put the last position at the total, behind all samples.
    last = weight.shape[-1] - 1 - np.argmax(weight[:, ::-1] > 0, axis=-1)
    return np.asarray(np.minimum(index, last[:, None]))


class Clusters(NamedTuple):
    """Samples in the order of their clusters.

    See Atia et al., section 5.4.

    Attributes
    ----------
    order
        Numbers of the samples, those of one cluster side by side, [..., p].
    first
        Where each cluster begins in that order, [k].
    """

    order: Index
    first: Index

    def sizes(self) -> Index:
        """Return the number of samples of each cluster, [k]."""
        return np.diff(self.first, append=self.order.shape[-1])


def median_cut(position_m: Array, clusters: int) -> Clusters:
    """Divide samples into boxes by cuts through the median of the longer side.

    See Atia et al., section 5.4, which names the method without its details. A box is cut by rank, so that
    all stacked sets are cut alike: one that will hold an even number of clusters in its middle, any other
    where the shares of samples and clusters agree. Clusters have equal numbers of samples, give or take one.
    Of equal coordinates, as copies have them at rest, the first one lies below: on every machine alike.

    Parameters
    ----------
    position_m
        [..., 2, p], metres.
    clusters
        Number of clusters, from 1 to p.

    Raises
    ------
    InputError
        For another number of clusters.
    """
    samples = position_m.shape[-1]
    check_settings(clusters=(clusters, 1, samples))
    place = np.reshape(position_m, (-1, 2, samples))
    first, levels = _cuts(samples, int(clusters))
    # Sorted once along each axis: a cut along one keeps the order along both. Sorts that are not stable
    # order copies as the processor has it.
    own = samples * np.arange(len(place))[:, None]
    by_x, by_y = (own + np.argsort(place[:, axis], axis=-1, kind="stable") for axis in range(2))
    x_m, y_m = (place[:, axis].ravel() for axis in range(2))
    below = np.empty(x_m.size, dtype=np.bool_)
    order = by_x
    for number, level in enumerate(levels, start=1):
        wide = _extent(x_m, by_x, level) >= _extent(y_m, by_y, level)
        along_x = np.repeat(wide, level.sizes, axis=-1)
        order = np.where(along_x, by_x, by_y)
        if number == len(levels):
            break
        # In its own order a box is cut where it is; in the other one, both parts keep theirs.
        other = np.where(along_x, by_y, by_x)
        below[order] = level.below
        lower = below[other].ravel()
        parted = np.empty_like(other)
        parted[:, level.under] = other.compress(lower).reshape(len(place), -1)
        parted[:, level.above] = other.compress(~lower).reshape(len(place), -1)
        by_x, by_y = np.where(along_x, order, parted), np.where(along_x, parted, order)
    return Clusters((order - own).reshape(*position_m.shape[:-2], samples), first)


class _Level(NamedTuple):
    """All boxes at a time, one behind the other: where they begin and end, and the samples of each, [boxes].

    ``below`` [p] tells what lies below a cut, ``under`` and ``above`` are the places that do and do not. A
    box that is one cluster is not cut any more: all of it is below.
    """

    begin: Index
    last: Index
    sizes: Index
    below: NDArray[np.bool_]
    under: Index
    above: Index


@lru_cache(maxsize=16)
def _cuts(samples: int, clusters: int) -> tuple[Index, list[_Level]]:
    first = np.arange(clusters + 1) * samples // clusters
    boxes, levels = [(0, clusters)], []
    while any(high - low > 1 for low, high in boxes):
        # Of a single cluster the lower half is empty, and its cut is its end.
        halves = [((low, (low + high) // 2), ((low + high) // 2, high)) for low, high in boxes]
        begin, end = (first[[box[side] for box in boxes]] for side in range(2))
        cut = np.array([first[low[1] if low[0] < low[1] else high[1]] for low, high in halves])
        below = np.arange(samples) < np.repeat(cut, end - begin)
        levels.append(
            _Level(begin, end - 1, end - begin, below, np.flatnonzero(below), np.flatnonzero(~below))
        )
        boxes = [part for both in halves for part in both if part[0] < part[1]]
    return first[:-1], levels


def _extent(values: Array, order: Index, level: _Level) -> Array:
    """Return the length of each box along the axis that its samples are sorted by, [r, boxes]."""
    return np.asarray(values[order[:, level.last]] - values[order[:, level.begin]])


def representative_distance(position_m: Array, target_m: Array, clusters: int | None) -> tuple[Array, int]:
    """Return the distance of samples to a target, or of the means of their clusters.

    See Atia et al., sections 5.2 and 5.4.

    Parameters
    ----------
    position_m
        [r, 2, p], metres.
    target_m
        [r, 2], metres.
    clusters
        Number of clusters whose members share the distance of their mean; None takes every sample's own.

    Returns
    -------
    tuple
        Distances [r, p], metres, and how many different ones were computed for each r.
    """
    samples = position_m.shape[-1]
    if clusters is None:
        return _distance(position_m, target_m), samples
    found = median_cut(position_m, clusters)
    sizes = found.sizes()
    ordered = np.take_along_axis(position_m, found.order[:, None], axis=-1)
    mean_m = np.add.reduceat(ordered, found.first, axis=-1) / sizes
    distance_m = np.empty((len(position_m), samples))
    each = np.repeat(_distance(mean_m, target_m), sizes, axis=-1)
    np.put_along_axis(distance_m, found.order, each, axis=-1)
    return distance_m, clusters


def _distance(position_m: Array, target_m: Array) -> Array:
    across, up = (position_m[:, axis] - target_m[:, axis, None] for axis in range(2))
    return np.asarray(np.sqrt(across * across + up * up))


def predict(
    sample: Array,
    turn_rad: Array,
    forward_m: Array,
    left_m: Array,
    turn_sigma_rad: Array,
    distance_sigma: float,
    draws: Array,
) -> None:
    """Move samples, in place, by a motion with noise.

    See Atia et al., section 5.6.2. An error of the turn grows evenly, so that the way leads in the direction
    half way between.

    Parameters
    ----------
    sample
        x, y, heading, [r, 3, p], metres and radians; changed.
    turn_rad, forward_m, left_m
        Motion in the frame of the heading before it, [r].
    turn_sigma_rad
        Standard deviation of the turn, [r].
    distance_sigma
        Standard deviation of a distance, as a share of it.
    draws
        Standard normals of turn and distance, [r, 2, p].
    """
    error_rad = turn_sigma_rad[:, None] * draws[:, 0]
    stretch = 1.0 + distance_sigma * draws[:, 1]
    way_rad = sample[:, 2] + 0.5 * error_rad
    cosine, sine = np.cos(way_rad), np.sin(way_rad)
    sample[:, 0] += stretch * (forward_m[:, None] * cosine - left_m[:, None] * sine)
    sample[:, 1] += stretch * (forward_m[:, None] * sine + left_m[:, None] * cosine)
    sample[:, 2] += turn_rad[:, None] + error_rad


def filter_drive(
    drive: Drive,
    rngs: Sequence[np.random.Generator],
    *,
    particles: int,
    scale_m: float,
    noise: SystemNoise,
    mixture: Mixture,
) -> Track:
    """Run a particle filter on every recording of a stack.

    See Atia et al., sections 5.2 to 5.6. An estimate is the weighted mean after the update and before
    resampling; an epoch without a fix is a prediction only.

    Parameters
    ----------
    drive
        The stack.
    rngs
        One generator a recording.
    particles
        Number of samples that are kept.
    scale_m
        See `exponential_weights`.
    noise
        Of the motion.
    mixture
        Of predicted samples and samples from the fix.

    Returns
    -------
    Track
        With extra ``effective_sample_size`` [r, n] before resampling, ``weight_evaluations`` [r, n], how many
        weights were computed, and ``weight_prediction`` and ``weight_wifi`` [r, n], the factors A and B.

    Raises
    ------
    InputError
        For senseless settings.
    """
    check_settings(
        particles=(particles, 1, 1e9),
        scale_m=(scale_m, 1e-6, 1e6),
        turn_noise_rad_per_sqrt_s=(noise.turn_rad_per_sqrt_s, 0, 1e6),
        distance_noise=(noise.distance, 0, 1e6),
        from_wifi=(mixture.from_wifi, 0, 100),
        fix_sigma_m=(mixture.fix_sigma_m, 0, 1e6),
    )
    if mixture.clusters is not None:
        check_settings(clusters=(mixture.clusters, 1, particles))
    count, epochs = drive.time_s.shape
    if len(rngs) != count:
        raise InputError("rngs", f"{len(rngs)} for {count} recordings", "Give every recording its own")
    turn_sigma_rad = noise.turn_rad_per_sqrt_s * np.sqrt(np.diff(drive.time_s, axis=1, prepend=np.nan))
    heard = np.isfinite(drive.fix_m).all(axis=-1) & ~drive.start.resting
    ended = np.isnan(drive.time_s)
    length = np.count_nonzero(~ended, axis=1)
    factors = _Factors(
        np.where(ended, np.nan, mixture.weight_prediction), np.where(ended, np.nan, mixture.weight_wifi)
    )
    for name, factor in zip(("weight_prediction", "weight_wifi"), factors, strict=True):
        check_settings(**{f"least {name}": (np.min(factor[~ended]), 0, np.inf)})
    if (factors.prediction + factors.wifi == 0).any():
        raise InputError(
            "weight_prediction and weight_wifi",
            "both are zero, so that no sample has a weight",
            "Give one of them more than zero",
        )
    added = round(mixture.from_wifi * particles)
    position_m = np.full((count, epochs, 2), np.nan)
    covariance_m2 = np.full((count, epochs, 2, 2), np.nan)
    effective, evaluations = np.full((2, count, epochs), np.nan)
    alike = np.full((1, particles), 1.0 / particles)
    # The longest first: those that still run are always the first ones of a block.
    order = np.argsort(-length, kind="stable")
    step = max(1, _BLOCK // (particles + added))
    for begin in range(0, count, step):
        rows = order[begin : begin + step]
        own = [rngs[row] for row in rows]
        draws = standard_normal(own, (3, particles))
        sample = np.empty((len(rows), 3, particles + added))
        for epoch in range(int(length[rows[0]])):
            running = rows[length[rows] > epoch]
            predicted = sample[: len(running), :, :particles]
            if epoch:
                place = running, epoch
                predict(
                    predicted,
                    drive.turn_rad[place],
                    drive.forward_m[place],
                    drive.left_m[place],
                    turn_sigma_rad[place],
                    noise.distance,
                    standard_normal(own[: len(running)], (2, particles)),
                )
            waiting = np.flatnonzero(drive.start.resting[running, epoch])
            if len(waiting):
                predicted[waiting] = _start_samples(drive.start, running[waiting], epoch, draws[waiting])
            for told in (True, False):
                some = np.flatnonzero(heard[running, epoch] == told)
                if not len(some):
                    continue
                # All of them, mostly: then a view, not a copy.
                which = slice(0, len(running)) if len(some) == len(running) else some
                place, cloud = (running[which], epoch), sample[which]
                if told:
                    generators = [own[number] for number in some]
                    weight, evaluations[place] = _weigh(
                        cloud,
                        drive.fix_m[place],
                        _Factors(*(factor[place] for factor in factors)),
                        mixture,
                        scale_m,
                        particles,
                        generators,
                    )
                    effective[place] = effective_sample_size(weight)
                else:
                    cloud, weight = cloud[..., :particles], alike
                    effective[place], evaluations[place] = particles, 0
                spots = np.swapaxes(cloud[:, :2], -1, -2)
                position_m[place] = weighted_mean(spots, weight)
                covariance = weighted_covariance(spots, weight)
                covariance_m2[place] = covariance + LEAST_VARIANCE_M2 * np.eye(2)
                if told:
                    index = draw(weight, uniform(generators, (particles + 1,)))
                    predicted[which] = np.take_along_axis(cloud, index[:, None], axis=-1)
    return Track(
        time_s=drive.time_s,
        position_m=position_m,
        covariance_m2=covariance_m2,
        extra={
            "effective_sample_size": effective,
            "weight_evaluations": evaluations,
            "weight_prediction": factors.prediction,
            "weight_wifi": factors.wifi,
        },
    )


class _Factors(NamedTuple):
    prediction: Array
    wifi: Array


def _start_samples(start: Start, rows: Index, epoch: int, draws: Array) -> Array:
    samples = np.empty_like(draws)
    centre_m, sigma_m = start.position_m[rows, epoch, :, None], start.sigma_m[rows, epoch, :, None]
    samples[:, :2] = centre_m + sigma_m * draws[:, :2]
    unknown = np.isnan(start.heading_rad[rows])[:, None]
    sigma_rad = np.where(unknown, _ANY_HEADING_RAD, start.heading_sigma_rad)
    samples[:, 2] = np.where(unknown, 0.0, start.heading_rad[rows, None]) + sigma_rad * draws[:, 2]
    return samples


def _weigh(
    cloud: Array,
    fix_m: Array,
    factors: _Factors,
    mixture: Mixture,
    scale_m: float,
    particles: int,
    rngs: Sequence[np.random.Generator],
) -> tuple[Array, int]:
    """Fill up the cloud [r, 3, p] behind the predicted samples; return all weights and their number."""
    predicted, added = cloud[..., :particles], cloud.shape[-1] - particles
    distance_m = np.empty((len(cloud), particles + added))
    distance_m[:, :particles], evaluations = representative_distance(
        predicted[:, :2], fix_m, mixture.clusters
    )
    factor = np.empty_like(distance_m)
    factor[:, :particles] = factors.prediction[:, None]
    if added:
        # Resampled copies lie side by side: headings at equal steps are those of all samples alike.
        cloud[:, 2, particles:] = predicted[:, 2, np.arange(added) * particles // added]
        about = mixture.fix_sigma_m * standard_normal(rngs, (2, added))
        cloud[:, :2, particles:] = fix_m[..., None] + about
        mean_m = np.mean(predicted[:, :2], axis=-1)
        distance_m[:, particles:] = _distance(cloud[:, :2, particles:], mean_m)
        factor[:, particles:] = factors.wifi[:, None]
    return exponential_weights(distance_m, factor, scale_m), evaluations + added
