"""Fingerprinting without a filter: the fix of each scan."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from algorithms.fingerprinting.knn_softmax import KnnSoftmax
from algorithms.fingerprinting.reduced import Reduced
from positioning.filters.plane import check_stack, track_one
from positioning.fingerprint_fixes import (
    best_of_three,
    cannot_fix,
    fingerprint_fixes,
    fix_covariance_m2,
    map_centre_and_variance,
)
from positioning.model import Calibration, Recording, Site, Survey, Track


class FingerprintAlone:
    """The place where the last scan was located.

    See Atia et al., sections 3 and 6.4 and Table 2, WiFi without motion. Between scans the last fix is held,
    never interpolated, since a later scan is not known yet. Before the first it is the centre of the survey:
    the mean of its places.

    The covariance is constant: the mean square error with which each half of the survey is located by the
    other, see `positioning.fingerprint_fixes.fix_covariance_m2`; it does not grow while a fix is held.
    Before the first fix it is that of the places of the survey.

    Parameters
    ----------
    fingerprinting
        From scans to fixes; None takes the k nearest neighbours of eq. 6 on the four access points of fast
        orthogonal search.
    best_of_three
        Take the place that at least two of the last three fixes have, else the latest; see Frank et al.,
        section 2.
    """

    def __init__(self, *, fingerprinting: Any = None, best_of_three: bool = False) -> None:
        self.fingerprinting = fingerprinting
        self.best_of_three = best_of_three

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be located; empty where they can.

        See Atia et al., section 3.
        """
        return cannot_fix(self._algorithm(), survey, recording, site)

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
        """Locate every scan of a stack of recordings.

        See Atia et al., section 6.4.

        Parameters
        ----------
        recording
            Stack [r, n] with scans [r, n, ap]; NaN in the times after the end of a recording.
        survey
            Fingerprints [r, p, ap] at places [r, p, 2].
        site
            Corners [r, 2, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``fix_m`` [r, n, 2], metres, the fix of each epoch, NaN where it has none.

        Raises
        ------
        InputError
            For input that cannot be used.
        """
        length = check_stack(recording, site, beacons=False)
        algorithm = self._algorithm()
        fix_m = fingerprint_fixes(algorithm, survey, recording)
        if self.best_of_three:
            fix_m = best_of_three(fix_m)
        centre_m, spread_m2 = map_centre_and_variance(cast(Survey, survey))
        error_m2 = fix_covariance_m2(algorithm, survey)

        # The last epoch that had a fix; -1 before the first.
        epoch = np.arange(fix_m.shape[1])
        held = np.maximum.accumulate(np.where(np.isnan(fix_m[..., 0]), -1, epoch), axis=1)
        rows = np.arange(len(held))[:, None]
        unknown = held < 0
        position_m = np.where(unknown[..., None], centre_m[:, None], fix_m[rows, held])
        covariance_m2 = np.where(unknown[..., None, None], spread_m2[:, None], error_m2[:, None])
        ended = epoch >= length[:, None]
        position_m[ended], covariance_m2[ended] = np.nan, np.nan
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"fix_m": fix_m},
        )

    def _algorithm(self) -> Any:
        if self.fingerprinting is not None:
            return self.fingerprinting
        return Reduced(access_points=FastOrthogonalSearch(columns=4), regressor=KnnSoftmax(k=4))
