"""Control: a tracker that does not look at the recording."""

from collections.abc import Sequence

import numpy as np

from positioning.filters.plane import centre_and_variance, check_stack, track_one
from positioning.model import Calibration, Recording, Site, Survey, Track


class ControlCentre:
    """The centre of the site at all times, whatever was heard: a row that is worse than this is no help.

    See Raghavan et al., Table II, to which this row is added. The covariance is that of a uniform place.
    """

    needs_order = False

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Return the centre at every epoch [n]; see `track_stack`."""
        return track_one(self, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Return the centre at every epoch of a stack of recordings.

        See Raghavan et al., Table II, to which this row is added.

        Parameters
        ----------
        recording
            Stack [r, n]; only the times are used.
        survey, rngs
            Not used.
        site
            Corners [r, 2, 2].

        Raises
        ------
        InputError
            For an empty recording, or a site without area.
        """
        length = check_stack(recording, site, beacons=False, ordered=False)
        asked = np.arange(recording.time_s.shape[1]) < length[:, None]
        centre_m, covariance_m2 = centre_and_variance(site)
        return Track(
            time_s=recording.time_s,
            position_m=np.where(asked[..., None], centre_m[:, None], np.nan),
            covariance_m2=np.where(asked[..., None, None], covariance_m2[:, None], np.nan),
        )
