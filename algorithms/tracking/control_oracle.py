"""Control: the best that any tracker could do in a synthetic world, but for the number of particles."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.filters.plane import (
    MotionNoise,
    check_stack,
    filter_particles,
    headings_missing,
    track_one,
    with_leading_axis,
)
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth

_LAW = ("law_distance_m", "law_dbm", "offset_dbm", "grid_m", "deviation_db")
_MOTION = ("turn_noise_rad", "advance_noise_m", "drift_noise_rad_per_m")
# A likelihood of no width at all would leave no particle a weight.
_LEAST_DEVIATION_DB = 0.05


class ControlOracle:
    """A particle filter for somebody who knows the radio field, all noise and the start heading.

    See Raghavan et al., Table II, to which this row is added. Weights are the likelihood of the received
    strengths themselves under the true law of distance and the true offset at the particle, without
    trilateration. A beacon that was not heard says nothing.

    Parameters
    ----------
    truth
        The radio law, its deviation and the noise of the motion, of the recordings that are tracked: with
        a leading axis for `track_stack`, without one for `track`.
    particles
        Number of particles.
    """

    def __init__(self, *, truth: Truth | None = None, particles: int = 1000) -> None:
        self.truth = truth
        self.particles = particles

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why there is no such estimate for these data; empty where there is one.

        See Raghavan et al., Table II, to which this row is added.
        """
        if self.truth is None or any(getattr(self.truth, name) is None for name in (*_LAW, *_MOTION)):
            return "the true radio law is known of synthetic worlds only"
        if headings_missing(recording) or recording.turn_before_rad is None:
            return "the motion was not recorded"
        if recording.rss_dbm is None or site.access_point_m is None:
            return "there are no received strengths of beacons at known places"
        return ""

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        truth = None if self.truth is None else with_leading_axis(self.truth)
        return track_one(ControlOracle(truth=truth, particles=self.particles), recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings in lock-step.

        See Raghavan et al., Table II, to which this row is added.

        Parameters
        ----------
        recording
            Stack [r, n]; NaN in the times after the end of a recording.
        survey
            Not used.
        site
            Corners [r, 2, 2] and beacons [r, ap, 2].
        rngs
            One generator a recording.

        Returns
        -------
        Track
            With extra ``effective_sample_size`` [r, n].

        Raises
        ------
        InputError
            If the truth holds no law, or for input that cannot be used.
        """
        reason = self.skip(recording, survey, site)
        if reason:
            raise InputError("control_oracle", reason, "Use it with synthetic worlds only")
        check_stack(recording, site)
        values = {name: np.asarray(getattr(self.truth, name), dtype=np.float64) for name in (*_LAW, *_MOTION)}
        count, beacons = recording.time_s.shape[0], np.asarray(site.access_point_m).shape[1]
        if values["offset_dbm"].ndim != 4 or values["offset_dbm"].shape[::3] != (count, beacons):
            raise InputError(
                "truth.offset_dbm",
                f"its shape is {values['offset_dbm'].shape}, not ({count}, x, y, {beacons})",
                "Give the oracle the truth of the recordings and beacons that it tracks",
            )
        rss_dbm = np.asarray(recording.rss_dbm, dtype=np.float64)
        precision = np.maximum(values["deviation_db"], _LEAST_DEVIATION_DB) ** -2.0

        def log_likelihood(rows: NDArray[np.intp], epoch: int, position_m: Array) -> Array:
            total = np.zeros(position_m.shape[:-1])
            offset_dbm = bilinear(position_m, rows, values["offset_dbm"], site, values["grid_m"])
            for beacon, beacon_m in enumerate(np.moveaxis(np.asarray(site.access_point_m)[rows], 1, 0)):
                distance_m = np.hypot(
                    position_m[..., 0] - beacon_m[:, 0, None], position_m[..., 1] - beacon_m[:, 1, None]
                )
                expected_dbm = np.stack(
                    [
                        np.interp(distance, values["law_distance_m"][row], values["law_dbm"][row])
                        for row, distance in zip(rows, distance_m, strict=True)
                    ]
                )
                reading_dbm = rss_dbm[rows, epoch, beacon, None]
                residual_db = reading_dbm - expected_dbm - offset_dbm[beacon]
                total -= np.where(
                    np.isnan(reading_dbm), 0.0, 0.5 * precision[rows, None] * residual_db * residual_db
                )
            return total

        return filter_particles(
            recording,
            site,
            rngs,
            log_likelihood,
            particles=self.particles,
            noise=MotionNoise(*(values[name] for name in _MOTION)),
            heading_known=True,
            resample_below=0.5,
        )


def bilinear(
    position_m: Array, rows: NDArray[np.intp], offset_dbm: Array, site: Site, grid_m: Array
) -> list[Array]:
    """Return each beacon's offset field at places, [beacon][m, p], dB, bilinear between nodes.

    See Raghavan et al., Table II, for the row that needs it. Places outside the grid have the value of its
    edge.

    Parameters
    ----------
    position_m
        Places, [m, p, 2], metres.
    rows
        The recordings that these places belong to, [m].
    offset_dbm
        Values at the nodes, [r, x, y, beacon], dB; the first node is the lower left corner of the site.
    site
        Corners [r, 2, 2].
    grid_m
        Distance of the nodes, [r], metres.
    """
    lower_m = np.asarray(site.corner_m, dtype=np.float64)[rows, 0]
    cells, shares = [], []
    for axis in range(2):
        last = offset_dbm.shape[axis + 1] - 1
        node = np.clip((position_m[..., axis] - lower_m[:, axis, None]) / grid_m[rows, None], 0.0, last)
        cell = np.minimum(node.astype(np.intp), max(last - 1, 0))
        cells.append(cell)
        shares.append(node - cell)
    _, width, depth, beacons = offset_dbm.shape
    right, above = int(width > 1) * depth * beacons, int(depth > 1) * beacons
    first = ((rows[:, None] * width + cells[0]) * depth + cells[1]) * beacons
    flat, (across, up) = offset_dbm.reshape(-1), shares
    found = []
    for beacon in range(beacons):
        corner = first + beacon
        low = flat[corner] * (1 - across) + flat[corner + right] * across
        high = flat[corner + above] * (1 - across) + flat[corner + right + above] * across
        found.append(low * (1 - up) + high * up)
    return found
