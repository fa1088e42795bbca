"""Trilateration without a filter: the fix of each epoch whose distances fit best."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from algorithms.ranging.curve_crossings import CurveCrossings
from algorithms.trilateration.iterative_fractional_printed import IterativeFractionalPrinted
from positioning.filters.plane import (
    cannot_locate,
    centre_and_variance,
    check_locatable,
    check_stack,
    track_one,
)
from positioning.fixes import locate
from positioning.model import Calibration, Recording, Site, Survey, Track

# Measured distances are no better than this, even where three of them happen to fit each other.
_LEAST_DEVIATION_M = 0.1


class TrilaterationAlone:
    """The fix with the least residual of each epoch.

    See Raghavan et al., section V.B and Fig. 5, the error without the particle filter; how one of the fixes
    is chosen is not printed. An epoch without a fix (fewer than three beacons heard, or strengths off the
    curve) keeps the last one; before the first, and at places without an order in time, it is the centre of
    the site.

    The covariance is the spread of all fixes of the epoch about the chosen one, each weighted by the inverse
    of its squared residual, plus the square of the chosen one's residual in both coordinates; 0.1 m is added
    to all residuals, as squares. Without a fix so far it is that of a uniform place.

    Parameters
    ----------
    ranging
        From strengths to distances; None takes every crossing of the calibration curve.
    trilateration
        From distances to fixes; None takes the printed fractional iteration.
    """

    needs_order = False

    def __init__(self, *, ranging: Any = None, trilateration: Any = None) -> None:
        self.ranging = ranging
        self.trilateration = trilateration

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be located; empty where they can.

        See Raghavan et al., section III.
        """
        return cannot_locate(recording, survey, site)

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Locate one recording; see `track_stack`, of which every leading axis is missing here."""
        return track_one(self, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Locate every epoch of a stack of recordings.

        See Raghavan et al., section V.B.

        Parameters
        ----------
        recording
            Stack [r, n]; NaN in the times after the end of a recording. All times equal: static places.
        survey
            Calibration runs [r, m]; not used where the recording holds distances.
        site
            Corners [r, 2, 2] and beacons [r, ap, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``fixes`` [r, n], the number of fixes of each epoch.

        Raises
        ------
        InputError
            For input that cannot be used.
        """
        length = check_stack(recording, site, ordered=False)
        check_locatable(recording, survey, site)
        found = locate(
            self.ranging or CurveCrossings(),
            self.trilateration or IterativeFractionalPrinted(),
            cast(Calibration | None, survey),
            recording,
            site,
        )
        chosen_m = found.least_residual()
        offset_m = np.nan_to_num(found.position_m - chosen_m[:, :, None, :])
        misfit_m2 = (
            np.where(np.isnan(found.residual_m), np.inf, found.residual_m) ** 2 + _LEAST_DEVIATION_M**2
        )
        # Fixes are added one after the other, so that what fills up leaves no trace.
        weight = 1.0 / misfit_m2
        total = np.cumsum(weight, axis=-1)[..., -1]
        fitted = total > 0
        weight /= np.where(fitted, total, 1.0)[..., None]
        covariance_m2 = np.zeros((*total.shape, 2, 2))
        for slot in range(weight.shape[2]):
            own_m = offset_m[:, :, slot]
            covariance_m2 += weight[:, :, slot, None, None] * (own_m[..., :, None] * own_m[..., None, :])
        least_m2 = np.where(fitted, np.min(misfit_m2, axis=-1), 0.0)
        covariance_m2 += least_m2[..., None, None] * np.eye(2)

        # The last epoch that had a fix; -1 before the first.
        epoch = np.arange(recording.time_s.shape[1])
        held = np.maximum.accumulate(np.where(fitted, epoch, -1), axis=1)
        static = np.all(np.isnan(recording.time_s) | (recording.time_s == recording.time_s[:, :1]), axis=1)
        held = np.where(static[:, None] & ~fitted, -1, held)
        rows = np.arange(len(held))[:, None]
        centre_m, uniform_m2 = centre_and_variance(site)
        unknown = held < 0
        position_m = np.where(unknown[..., None], centre_m[:, None], chosen_m[rows, held])
        covariance_m2 = np.where(unknown[..., None, None], uniform_m2[:, None], covariance_m2[rows, held])
        ended = epoch >= length[:, None]
        position_m[ended], covariance_m2[ended] = np.nan, np.nan
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"fixes": np.where(ended, np.nan, found.count)},
        )
