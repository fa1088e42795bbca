"""Settings of the inertial filter of a foot: what counts, how it is taken in, and all variances.

See Frank et al., section 3. What the paper leaves open (start, variances, the extent of the magnetometer's
use) is a setting.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from positioning.errors import InputError
from positioning.inertial.error_state import STATES
from positioning.inertial.rest import DETECTORS


@dataclass(frozen=True, kw_only=True)
class FootFilter:
    """Settings of the inertial filter.

    Attributes
    ----------
    states
        9, or 15 with the biases of accelerometer and gyroscope. See Frank et al., section 3.1.
    detector
        A name in `rest.DETECTORS`; the paper's is ``acceleration_magnitude``.
    detector_settings
        Its settings.
    zero_velocity
        Whether the filter uses the rests; without, it is plain strapdown navigation.
    magnetometer
        Whether it uses the magnetometer, where there is one and magnetic north is known.
    force_noise_m_per_s2_per_rt_hz
        Density of the noise of the force; 0.02 is what OpenShoe uses (0.5 m/s^2 at 820 Hz; Nilsson et al.
        2012): ten times that of the data sheets, as it stands for scale errors in the swing too.
    rate_noise_rad_per_s_per_rt_hz
        Density of the noise of the rate: 0.1 degrees a second, the figure of the data sheet of the class,
        which the simulated units have too.
    heading_noise_rad_per_rt_s
        Density of a random walk of the heading beside that of the rate's noise, for biases that 9 states do
        not have. None, as in the paper, where nothing tells the place but the filter itself.
    zero_velocity_noise_m_per_s
        Of each axis at rest; as OpenShoe.
    magnetic_heading_noise_rad
        Of the direction of the horizontal field indoors; assumed, some eleven degrees:
        steel bends a horizontal field of 20 microtesla by some 4.
    magnetic_interval_s
        The field counts in the first sample of a rest, and as often in a long one; assumed. Its errors come
        from the place: a foot at rest learns nothing new from more.
    magnetic_gate
        The field does not count where its magnitude is off that of the first rest by this share; assumed.
    force_bias_m_per_s2, rate_bias_rad_per_s
        Of the biases, for 15 states: 0.02 m/s^2, that of the data sheet, as levelling cannot tell it from a
        tilt; 0.02 degrees a second, by which that of a gyroscope wanders in a run. To the latter comes the
        standard error of the mean over the alignment, which follows from the noise and the duration.
    rate_turn_on_bias_rad_per_s
        The same where the alignment is too short to tell that of the gyroscope: half a degree a second, what
        it has when it is turned on.
    force_bias_walk_m_per_s2_per_rt_s, rate_bias_walk_rad_per_s_per_rt_s
        Growth of the biases, for 15 states: by 0.002 m/s^2 and 0.02 degrees a second, the in-run figures, in
        a hundred seconds, their correlation time.
    tilt_error_rad
        Of roll and pitch after levelling: 0.05 m/s^2 of bias over gravity.
    heading_error_rad
        Of the heading at the start where no magnetometer gives it: nearly none, as this heading is then
        what the frame of the navigation hangs on.
    alignment_s
        The first rest that lasts at least as long is that of the alignment; assumed.
    bias_rest_s
        The bias of the gyroscope is taken from the alignment where it lasts at least as long; assumed. In a
        second the noise leaves a tenth of a degree a second of the mean; in less, a foot that only pauses
        would tell as bias what is a movement.
    gravity_m_per_s2
        Magnitude of gravity; None for what the accelerometer reads in the alignment, so that its error along
        the vertical does no harm.
    heading_offset_rad
        Added to all headings: an alignment that is off by so much.
    """

    states: int = 9
    detector: str = "acceleration_magnitude"
    detector_settings: Mapping[str, Any] = field(default_factory=dict)
    zero_velocity: bool = True
    magnetometer: bool = True
    force_noise_m_per_s2_per_rt_hz: float = 0.02
    rate_noise_rad_per_s_per_rt_hz: float = 0.0017
    heading_noise_rad_per_rt_s: float = 0.0
    zero_velocity_noise_m_per_s: float = 0.01
    magnetic_heading_noise_rad: float = 0.2
    magnetic_interval_s: float = 1.0
    magnetic_gate: float = 0.1
    force_bias_m_per_s2: float = 0.02
    rate_bias_rad_per_s: float = 0.00035
    rate_turn_on_bias_rad_per_s: float = 0.009
    force_bias_walk_m_per_s2_per_rt_s: float = 2e-4
    rate_bias_walk_rad_per_s_per_rt_s: float = 3.5e-5
    tilt_error_rad: float = 0.005
    heading_error_rad: float = 0.001
    alignment_s: float = 1.0
    bias_rest_s: float = 1.0
    gravity_m_per_s2: float | None = None
    heading_offset_rad: float = 0.0

    def check(self) -> None:
        """Refuse settings without sense.

        Raises
        ------
        InputError
            For a number of states other than 9 or 15, an unknown detector, or a negative number where only
            others make sense.
        """
        if self.states not in STATES:
            raise InputError(f"states={self.states}", "the filter has 9 or 15", "Take one of them")
        if self.detector not in DETECTORS:
            raise InputError(
                f"detector {self.detector!r}", "there is no such detector", f"Take one of {list(DETECTORS)}"
            )
        for name in _ABOVE_ZERO:
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}", "it is not above zero", "Correct it")
        for name in _NOT_NEGATIVE:
            if not 0 <= getattr(self, name) < np.inf:
                raise InputError(f"{name}={getattr(self, name)}", "it is below zero", "Correct it")
        if self.gravity_m_per_s2 is not None and not 9.7 < self.gravity_m_per_s2 < 9.9:
            raise InputError(
                f"gravity_m_per_s2={self.gravity_m_per_s2}",
                "on earth it is between 9.7 and 9.9",
                "Correct it, or leave it out",
            )
        if not abs(self.heading_offset_rad) <= 2 * np.pi:
            raise InputError(
                f"heading_offset_rad={self.heading_offset_rad}",
                "it is not a finite number, or more than a whole turn: it looks like degrees",
                "Give radians",
            )


_ABOVE_ZERO = (
    "zero_velocity_noise_m_per_s",
    "magnetic_heading_noise_rad",
    "magnetic_interval_s",
    "magnetic_gate",
    "alignment_s",
    "bias_rest_s",
)
_NOT_NEGATIVE = (
    "force_noise_m_per_s2_per_rt_hz",
    "rate_noise_rad_per_s_per_rt_hz",
    "heading_noise_rad_per_rt_s",
    "force_bias_m_per_s2",
    "rate_bias_rad_per_s",
    "rate_turn_on_bias_rad_per_s",
    "force_bias_walk_m_per_s2_per_rt_s",
    "rate_bias_walk_rad_per_s_per_rt_s",
    "tilt_error_rad",
    "heading_error_rad",
)
