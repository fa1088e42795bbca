"""Steps of a foot-mounted inertial unit and WLAN fixes in the paper's main filter."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.fingerprinting.expected_deviation import ExpectedDeviation
from algorithms.tracking.foot_inertial import late_start, steps_of, steps_so_far
from positioning.errors import InputError
from positioning.filters import kalman
from positioning.filters.plane import (
    check_settings,
    check_stack,
    headings_missing,
    track_one,
    with_leading_axis,
)
from positioning.fingerprint_fixes import (
    best_of_three,
    cannot_fix,
    fingerprint_fixes,
    fix_covariance_m2,
    map_centre_and_variance,
)
from positioning.inertial.foot import FootNavigation
from positioning.inertial.foot_checks import imu_missing
from positioning.inertial.foot_steps import Steps
from positioning.model import Array, Calibration, Recording, Site, Survey, Track

_PLACE = np.eye(2, 3)


class Fixes(NamedTuple):
    """WLAN fixes of a stack, and what is known before the first of them.

    Attributes
    ----------
    fix_m
        [r, n, 2], metres; NaN at an epoch without one.
    covariance_m2
        Of each fix of a recording, [r, 2, 2].
    centre_m, spread_m2
        Mean and covariance of a place drawn from the survey, [r, 2] and [r, 2, 2].
    """

    fix_m: Array
    covariance_m2: Array
    centre_m: Array
    spread_m2: Array


class Round(NamedTuple):
    """The next step of each recording that has one before the coming epoch, each [m]."""

    recording: NDArray[np.intp]
    forward_m: Array
    left_m: Array
    turn_rad: Array


class FootCascadedFilter:
    """The paper's system: an inertial filter makes steps, and a second filter joins them with WLAN.

    See Frank et al., section 4, eqs. 6 to 23: an extended Kalman filter over x, y and heading that a step
    moves on when its foot has come to rest, and a WLAN fix corrects at the time of its scan. A step that ends
    with a scan goes first.

    It starts with the first fix, as uncertain as a fix is, and the noted heading, to which the turns of the
    steps before have been added. Until then its answer is the centre of the survey. Start and variances are
    not printed; the values here are round ones, written down before the first run. Errors of fixes close to
    each other are alike, which the filter does not know: its covariance is too small for them.

    Parameters
    ----------
    inertial
        The inertial filter and its step sensor; None takes `FootInertial` with its own settings.
    fingerprinting
        From scans to fixes; None takes the expected deviation of eq. 1.
    best_of_three
        Take the place that at least two of the last three fixes have, else the latest; section 2.
    sigma_step_m
        Standard deviation of a step in each coordinate; not printed. A zero-velocity filter is off by about
        a hundredth of the way, which is less than 0.1, but the body is not always as far from the foot.
    sigma_heading_rad
        Standard deviation of the turn of a step; not printed. Assumed, about one degree.
    sigma_wlan_m
        Standard deviation of a fix in each coordinate; not printed. Assumed, about the distance of two
        calibration points; None takes the errors with which each half of the survey locates the other.
    start_heading_sigma_rad
        Standard deviation of the noted heading; not printed. Assumed, wide: nearly 30 degrees.
    start_heading_error_rad
        Added to the noted heading, to see what a wrong one does.
    """

    takes_steps = True
    """A row of it may build on the steps of another row, with the key ``steps``."""

    def __init__(
        self,
        *,
        inertial: Any = None,
        fingerprinting: Any = None,
        best_of_three: bool = True,
        sigma_step_m: float = 0.1,
        sigma_heading_rad: float = 0.02,
        sigma_wlan_m: float | None = 3.0,
        start_heading_sigma_rad: float = 0.5,
        start_heading_error_rad: float = 0.0,
    ) -> None:
        self.inertial = inertial
        self.fingerprinting = fingerprinting
        self.best_of_three = best_of_three
        self.sigma_step_m = sigma_step_m
        self.sigma_heading_rad = sigma_heading_rad
        self.sigma_wlan_m = sigma_wlan_m
        self.start_heading_sigma_rad = start_heading_sigma_rad
        self.start_heading_error_rad = start_heading_error_rad

    def skip(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked; empty where they can.

        See Frank et al., section 4.
        """
        return self.cannot_fuse(recording, survey, site) or late_start(recording, self.inertial)

    def cannot_fuse(self, recording: Recording, survey: Survey | Calibration | None, site: Site) -> str:
        """Say why these data cannot be tracked, whoever finds the steps; empty where they can.

        See Frank et al., section 4.
        """
        return cannot_fuse(self._fingerprinting(), recording, survey, site)

    def track(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rng: np.random.Generator,
    ) -> Track:
        """Track one recording; see `track_stack`, of which every leading axis is missing here."""
        return track_one(self, recording, survey, site, rng)

    def track_stack(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        rngs: Sequence[np.random.Generator],
    ) -> Track:
        """Track a stack of recordings in lock-step.

        See Frank et al., eqs. 8 to 23.

        Parameters
        ----------
        recording
            Stack: epochs [r, n] with scans [r, n, ap], and readings of the inertial unit [r, i, 3].
        survey
            Fingerprints [r, p, ap] at places [r, p, 2].
        site
            Corners [r, 2, 2].
        rngs
            Not used.

        Returns
        -------
        Track
            With extra ``heading_rad`` [r, n], not wrapped, and ``steps`` [r, n], their number so far.

        Raises
        ------
        InputError
            For senseless settings, or input that cannot be used.
        """
        return self.fuse(recording, survey, site)

    def fuse(
        self,
        recording: Recording,
        survey: Survey | Calibration | None,
        site: Site,
        navigation: FootNavigation | None = None,
    ) -> Track:
        """Track a stack as `track_stack` does, where the inertial navigation may have been made already.

        See Frank et al., eqs. 8 to 23. Parameters, result and errors as in `track_stack`.

        Parameters
        ----------
        recording, survey, site
            As in `track_stack`.
        navigation
            Of the stack; None makes it.
        """
        check_settings(
            sigma_step_m=(self.sigma_step_m, 0, 1e6),
            sigma_heading_rad=(self.sigma_heading_rad, 0, 1e3),
            start_heading_sigma_rad=(self.start_heading_sigma_rad, 0, 1e3),
            start_heading_error_rad=(self.start_heading_error_rad, -1e3, 1e3),
        )
        check_fusible(self._fingerprinting(), recording, survey, site)
        length = check_stack(recording, site, beacons=False)
        fixes = wlan_fixes(
            self._fingerprinting(), recording, survey, vote=self.best_of_three, sigma_m=self.sigma_wlan_m
        )
        heading_rad = start_headings_rad(recording, self.start_heading_error_rad)
        steps = steps_of(recording, site, self.inertial, navigation)
        return self._filter(recording.time_s, length, steps, fixes, heading_rad)

    def _filter(
        self, time_s: Array, length: NDArray[np.intp], steps: Steps, fixes: Fixes, heading_rad: Array
    ) -> Track:
        count, epochs = time_s.shape
        heard = np.isfinite(fixes.fix_m[..., 0])
        started = np.zeros(count, dtype=bool)
        mean = np.column_stack([fixes.centre_m, heading_rad])
        covariance = np.zeros((count, 3, 3))
        covariance[:, :2, :2] = fixes.spread_m2
        covariance[:, 2, 2] = self.start_heading_sigma_rad**2
        noise = np.diag([self.sigma_step_m**2, self.sigma_step_m**2, self.sigma_heading_rad**2])
        means, covariance_m2 = np.empty((count, epochs, 3)), np.empty((count, epochs, 2, 2))
        for epoch, rounds in enumerate(rounds_until(steps, time_s)):
            for step in rounds:
                rows = step.recording
                moved, jacobian = predicted(mean[rows], step, started[rows])
                # Where nothing is known of the place yet, a step leaves it so.
                own_noise = noise * np.where(started[rows, None, None], 1.0, np.diag([0.0, 0.0, 1.0]))
                covariance[rows] = kalman.predict(
                    mean[rows], covariance[rows], jacobian, own_noise
                ).covariance
                mean[rows] = moved
            first = heard[:, epoch] & ~started
            mean[first, :2] = fixes.fix_m[first, epoch]
            covariance[first, :2, :2] = fixes.covariance_m2[first]
            rows = np.flatnonzero(heard[:, epoch] & started)
            if len(rows):
                innovation_m = fixes.fix_m[rows, epoch] - mean[rows, :2]
                update = kalman.update(
                    mean[rows], covariance[rows], innovation_m, _PLACE, fixes.covariance_m2[rows]
                )
                mean[rows], covariance[rows] = update.mean, update.covariance
            started |= first
            means[:, epoch], covariance_m2[:, epoch] = mean, covariance[:, :2, :2]
        ended = np.arange(epochs) >= length[:, None]
        means[ended], covariance_m2[ended] = np.nan, np.nan
        return Track(
            time_s=time_s,
            position_m=means[..., :2].copy(),
            covariance_m2=covariance_m2,
            extra={"heading_rad": means[..., 2].copy(), "steps": steps_so_far(steps, time_s)},
        )

    def _fingerprinting(self) -> Any:
        return ExpectedDeviation() if self.fingerprinting is None else self.fingerprinting


def cannot_fuse(
    fingerprinting: Any, recording: Recording, survey: Survey | Calibration | None, site: Site
) -> str:
    """Say why steps and fixes cannot be joined: a reason to skip these data, empty where there is none.

    See Frank et al., section 4.

    Parameters
    ----------
    fingerprinting
        From scans to fixes.
    recording, survey, site
        Of one recording, or stacks.
    """
    if reason := imu_missing(recording):
        return reason
    if headings_missing(recording):
        return "the start heading was not recorded"
    if isinstance(survey, Survey) and not np.isfinite(survey.position_m).any():
        return "the survey has no points"
    if survey is not None and np.ndim(recording.time_s) == 1:
        survey, site = with_leading_axis(survey), with_leading_axis(site)
    return cannot_fix(fingerprinting, survey, recording, site)


def check_fusible(
    fingerprinting: Any, recording: Recording, survey: Survey | Calibration | None, site: Site
) -> None:
    """Refuse what `cannot_fuse` has a reason for.

    Raises
    ------
    InputError
        With this reason.
    """
    if reason := cannot_fuse(fingerprinting, recording, survey, site):
        raise InputError(
            "recording and survey", reason, "Give an inertial unit, the start heading, scans and a survey"
        )


def wlan_fixes(
    fingerprinting: Any,
    recording: Recording,
    survey: Survey | Calibration | None,
    *,
    vote: bool,
    sigma_m: float | None,
) -> Fixes:
    """Locate the scans of a stack of recordings, and tell how sure that is.

    See Frank et al., section 2 and eqs. 12 and 22.

    Parameters
    ----------
    fingerprinting
        From scans to fixes.
    recording, survey
        Stacks [r, n, ap] and [r, p, ap].
    vote
        Take the best of three.
    sigma_m
        Standard deviation of a fix in each coordinate, metres; None asks the survey.

    Raises
    ------
    InputError
        For a deviation that is not positive, or input that cannot be used.
    """
    if sigma_m is not None:
        check_settings(sigma_wlan_m=(sigma_m, 1e-6, 1e6))
    fix_m = fingerprint_fixes(fingerprinting, survey, recording)
    if not isinstance(survey, Survey):
        raise InputError("survey", "there is no survey of fingerprints", "Give fingerprints at known places")
    centre_m, spread_m2 = map_centre_and_variance(survey)
    covariance_m2 = (
        fix_covariance_m2(fingerprinting, survey)
        if sigma_m is None
        else np.tile(sigma_m**2 * np.eye(2), (len(fix_m), 1, 1))
    )
    return Fixes(best_of_three(fix_m) if vote else fix_m, covariance_m2, centre_m, spread_m2)


def rounds_until(steps: Steps, time_s: Array) -> Iterator[list[Round]]:
    """Yield, epoch after epoch, the steps that have ended since the one before, in their order.

    A round has at most one step of each recording; a step that ends at an epoch is before it.

    Parameters
    ----------
    steps
        Stack [r, s].
    time_s
        Epochs, [r, n], seconds; NaN after the end.
    """
    due = np.nan_to_num(steps_so_far(steps, time_s)).astype(np.intp)
    done = np.zeros(len(due), dtype=np.intp)
    for epoch in range(due.shape[1]):
        rounds = []
        while len(rows := np.flatnonzero(done < due[:, epoch])):
            place = rows, done[rows]
            rounds.append(Round(rows, steps.forward_m[place], steps.left_m[place], steps.turn_rad[place]))
            done[rows] += 1
        yield rounds


def predicted(mean: Array, step: Round, started: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return states [m, 3] after a step, and the derivative by those before, [m, 3, 3].

    See Frank et al., eqs. 9, 10 and 13 to 17.

    Parameters
    ----------
    mean
        x, y, heading, [m, 3], metres and radians.
    step
        Of each.
    started
        Which of them have a place, [m]; a step only turns the others.
    """
    sine, cosine = np.sin(mean[:, 2]), np.cos(mean[:, 2])
    advance_m = np.column_stack(
        [cosine * step.forward_m - sine * step.left_m, sine * step.forward_m + cosine * step.left_m]
    )
    advance_m[~started] = 0.0
    moved = mean.copy()
    moved[:, :2] += advance_m
    moved[:, 2] += step.turn_rad
    jacobian = np.tile(np.eye(3), (len(mean), 1, 1))
    # The derivative of a rotation is the rotation of what stands a quarter turn to the left.
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -advance_m[:, 1], advance_m[:, 0]
    return moved, jacobian


def start_headings_rad(recording: Recording, error_rad: float) -> Array:
    """Return the start headings that a filter believes, [r], radians: those noted, with an error added."""
    return np.asarray(recording.start_heading_rad, dtype=np.float64) + error_rad
