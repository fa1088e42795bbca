"""A tracking algorithm to copy: the moving average of the fixes of trilateration.

Copy this file to ``algorithms/tracking/<name>.py``, call the class like the file in CamelCase
(``my_method.py`` holds ``MyMethod``), and add ``<name>: {}`` to the algorithms of a study in
``config/config.yaml``.
"""

from typing import Any

import numpy as np

from algorithms.ranging.curve_crossings import CurveCrossings
from algorithms.trilateration.pseudo_inverse import PseudoInverse
from positioning.filters.plane import (
    cannot_locate,
    centre_and_variance,
    check_locatable,
    check_settings,
    check_stack,
    with_leading_axis,
)
from positioning.fixes import locate
from positioning.model import Calibration, Recording, Site, Survey, Track


class Template:
    """The average of all fixes so far, with weights that fade with age.

    See Brown (1956), "Exponential Smoothing for Predicting Demand"; say here where your algorithm is
    described.

    Parameters
    ----------
    memory_epochs
        Age, in epochs, at which a fix counts 1/e of the newest.
    ranging
        From strengths to distances; None takes every crossing of the calibration curve.
    trilateration
        From distances to fixes; None takes the pseudo-inverse.
    """

    # The constructor takes keywords only and stores them as they are. A parameter may be an algorithm
    # itself: in the configuration, `ranging: {use: path_loss}`.
    def __init__(self, *, memory_epochs: float = 3.0, ranging: Any = None, trilateration: Any = None) -> None:
        self.memory_epochs = memory_epochs
        self.ranging = ranging
        self.trilateration = trilateration

    # Optional: a reason why the algorithm cannot run on these data; the table shows it. Empty: it can.
    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Raghavan et al., section III.
        """
        return cannot_locate(recording, survey, site)

    # One recording: times [n], strengths [n, ap], and so on. To track all recordings of all worlds at once,
    # write `track_stack` as well, where every array has one axis more in front and `rngs` is a list; see
    # particle_filter.py. Both must give the same. All randomness comes from `rng`.
    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording.

        See Brown (1956).

        Parameters
        ----------
        recording
            Times [n] and strengths or distances [n, ap].
        survey
            Calibration run [m].
        site
            Corners [2, 2] and beacons [ap, 2].
        rng
            The recording's generator; not used.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        check_settings(memory_epochs=(self.memory_epochs, 1e-3, 1e6))
        # The helpers work on stacks of recordings: this is a stack of one.
        stack, place = with_leading_axis(recording), with_leading_axis(site)
        learnt = with_leading_axis(survey) if isinstance(survey, Calibration) else None
        check_stack(stack, place)
        check_locatable(stack, learnt, place)
        # All fixes of all epochs, [1, n, k, 2], of which one an epoch is taken; NaN where there is none.
        fixes = locate(
            self.ranging or CurveCrossings(), self.trilateration or PseudoInverse(), learnt, stack, place
        )
        fix_m = fixes.least_residual()[0]

        # Until there is a fix: anywhere in the site, all places equally likely.
        centre_m, uniform_m2 = centre_and_variance(place)
        position_m = np.tile(centre_m[0], (len(fix_m), 1))
        covariance_m2 = np.tile(uniform_m2[0], (len(fix_m), 1, 1))
        fade = np.exp(-1.0 / self.memory_epochs)
        weight, total, squares = 0.0, np.zeros(2), np.zeros((2, 2))
        for epoch, fix in enumerate(fix_m):
            weight, total, squares = fade * weight, fade * total, fade * squares
            if not np.isnan(fix).any():
                weight, total, squares = weight + 1, total + fix, squares + np.outer(fix, fix)
            if weight > 0:
                position_m[epoch] = total / weight
                scatter = squares / weight - np.outer(position_m[epoch], position_m[epoch])
                # How sure it is: the scatter of the fixes that were averaged, and a decimetre, so that it
                # is never quite sure. The matrix must be symmetric and positive semi-definite.
                covariance_m2[epoch] = scatter + 0.01 * np.eye(2)
        # Whatever else is worth keeping stands in `extra`, one value an epoch.
        return Track(
            time_s=recording.time_s,
            position_m=position_m,
            covariance_m2=covariance_m2,
            extra={"fixes": fixes.count[0].astype(np.float64)},
        )
