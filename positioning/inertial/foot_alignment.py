"""When a foot rests, and what its first long rest tells: tilt, heading, bias, gravity, the magnetic field.

See Frank et al., sections 3.1 and 3.2.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError
from positioning.inertial.foot_checks import FORCE_AT_REST_M_PER_S2, refuse, sample_rate_hz
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.rest import Flags, detect, spans
from positioning.inertial.strapdown import attitude_of, levelled
from positioning.model import Array, Recording, Site

# The end of a rest, where the heel may already lift, does not count for the bias of the gyroscope.
_COUNTED_SHARE_OF_REST = 0.8


class Alignment(NamedTuple):
    """What the first long rest of each recording tells, each [r, ...].

    Attributes
    ----------
    end
        Number of the reading behind it.
    roll_rad, pitch_rad, heading_rad
        Of the sensor.
    heading_error_rad
        Standard deviation of the heading.
    rate_bias_rad_per_s, rate_bias_error_rad_per_s
        Of the gyroscope, [r, 3], and its standard deviation, [r].
    gravity_m_per_s2
        What the filter takes for gravity.
    magnetic_field_ut
        Magnitude of the mean field; NaN without one.
    """

    end: NDArray[np.intp]
    roll_rad: Array
    pitch_rad: Array
    heading_rad: Array
    heading_error_rad: Array
    rate_bias_rad_per_s: Array
    rate_bias_error_rad_per_s: Array
    gravity_m_per_s2: Array
    magnetic_field_ut: Array


def rests(recording: Recording, settings: FootFilter) -> Flags:
    """Return when each foot of a stack rests, [r, i], as the detector of the settings has it.

    See Frank et al., section 3.2.

    Parameters
    ----------
    recording
        Stack that `foot_checks.check_imu` does not refuse.
    settings
        Names the detector.

    Raises
    ------
    InputError
        For what the detector refuses.
    """
    time_s, rate_hz = np.asarray(recording.imu_time_s), sample_rate_hz(recording)
    force, rate = recording.specific_force_m_per_s2, recording.angular_rate_rad_per_s
    assert force is not None
    assert rate is not None
    flags = np.zeros(time_s.shape, dtype=np.bool_)
    for row, count in enumerate(np.count_nonzero(~np.isnan(time_s), axis=1)):
        flags[row, :count] = detect(
            settings.detector,
            settings.detector_settings,
            force[row, :count],
            rate[row, :count],
            float(rate_hz[row]),
        )
    return flags


def align(recording: Recording, flags: Flags, settings: FootFilter, north_rad: Array | None) -> Alignment:
    """Return what the first rest tells that is long enough for the alignment.

    See Frank et al., section 3.1, which leaves the alignment open.

    Parameters
    ----------
    recording
        Stack that `foot_checks.check_imu` does not refuse.
    flags
        When each foot rests, [r, i].
    settings
        Of the filter.
    north_rad
        Direction to magnetic north, [r], NaN where it is not known; None where the magnetometer is not used.

    Raises
    ------
    InputError
        For a recording without such a rest, or a mean force in it that is not that of gravity.
    """
    count = len(flags)
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    rate_hz = sample_rate_hz(recording)
    end = np.zeros(count, dtype=np.intp)
    force, bias = np.empty((count, 3)), np.zeros((count, 3))
    bias_error = np.full(count, settings.rate_turn_on_bias_rad_per_s)
    field_ut = np.full((count, 3), np.nan)
    assert recording.specific_force_m_per_s2 is not None
    assert recording.angular_rate_rad_per_s is not None
    for row, span in enumerate(spans(flags)):
        long = _long_enough(span, rate_hz[row], settings)
        if not long.any():
            most = np.max(span[:, 1] - span[:, 0], initial=0) / rate_hz[row]
            raise InputError(
                f"recording[{row}]",
                f"no rest of {settings.alignment_s} s for the alignment; the longest is {most:.2f} s",
                "Stand still at the start, lower alignment_s, or try another detector",
            )
        begin, end[row] = span[np.argmax(long)]
        counted = slice(begin, begin + max(1, round(_COUNTED_SHARE_OF_REST * (end[row] - begin))))
        force[row] = np.mean(recording.specific_force_m_per_s2[row, counted], axis=0, dtype=np.float64)
        if time_s[row, end[row] - 1] - time_s[row, begin] + 1 / rate_hz[row] >= settings.bias_rest_s:
            rates = np.asarray(recording.angular_rate_rad_per_s[row, counted], dtype=np.float64)
            bias[row] = rates.mean(axis=0)
            of_mean = settings.rate_noise_rad_per_s_per_rt_hz / np.sqrt(len(rates) / rate_hz[row])
            bias_error[row] = np.hypot(of_mean, settings.rate_bias_rad_per_s)
        if north_rad is not None and recording.magnetic_field_ut is not None:
            seen = np.asarray(recording.magnetic_field_ut[row, counted], dtype=np.float64)
            seen = seen[np.isfinite(seen).all(axis=-1)]
            field_ut[row] = seen.mean(axis=0) if len(seen) else np.nan
    low, high = FORCE_AT_REST_M_PER_S2
    magnitude = np.linalg.norm(force, axis=-1)
    refuse(
        "specific_force_m_per_s2",
        (magnitude < low) | (magnitude > high),
        f"its mean at rest is not between {low} and {high} m/s^2",
        "Calibrate the accelerometer, or try another detector",
    )
    roll, pitch = levelled(force)
    heading = np.full(count, settings.heading_offset_rad)
    error = np.full(count, settings.heading_error_rad)
    if north_rad is not None:
        level = (attitude_of(roll, pitch, np.zeros(count)) @ field_ut[..., None])[..., 0]
        found = north_rad - np.arctan2(level[:, 1], level[:, 0])
        heading = np.where(np.isfinite(found), found, heading)
        error = np.where(np.isfinite(found), settings.magnetic_heading_noise_rad, error)
    gravity = magnitude if settings.gravity_m_per_s2 is None else np.full(count, settings.gravity_m_per_s2)
    field = np.linalg.norm(field_ut, axis=-1)
    return Alignment(end, roll, pitch, heading, error, bias, bias_error, gravity, field)


def late_alignment(recording: Recording, settings: FootFilter) -> str:
    """Say which recording of a stack stands still for most of it; empty where none does.

    Until the end of the alignment nothing moves. Where this comes after half of a recording, what is left
    of a walk is no track of it, although the covariance of the filter knows nothing of that.

    Parameters
    ----------
    recording
        Stack that `foot_checks.check_imu` does not refuse.
    settings
        Name the detector, and the duration of the alignment.

    Raises
    ------
    InputError
        For what the detector refuses.
    """
    time_s = np.asarray(recording.imu_time_s, dtype=np.float64)
    rate_hz = sample_rate_hz(recording)
    for row, span in enumerate(spans(rests(recording, settings))):
        long = _long_enough(span, rate_hz[row], settings)
        if not long.any():
            continue
        begin, end = span[np.argmax(long)]
        own_s = time_s[row, ~np.isnan(time_s[row])] - time_s[row, 0]
        if own_s[end - 1] > 0.5 * own_s[-1]:
            return (
                f"recording[{row}]: the first rest of {settings.alignment_s:g} s begins at"
                f" {own_s[begin]:.1f} s of {own_s[-1]:.1f} s and ends at {own_s[end - 1]:.1f} s, until when"
                " nothing moves; cut the recording, lower alignment_s, or take another detector"
            )
    return ""


def magnetic_north_rad(recording: Recording, site: Site, settings: FootFilter) -> Array | None:
    """Return the direction to magnetic north [r], radians, or None where it is not used.

    Raises
    ------
    InputError
        For a direction that does not fit the recordings, or looks like degrees.
    """
    if not settings.magnetometer or recording.magnetic_field_ut is None or site.magnetic_north_rad is None:
        return None
    north = np.asarray(site.magnetic_north_rad, dtype=np.float64)
    assert recording.imu_time_s is not None
    if north.shape != (len(recording.imu_time_s),):
        raise InputError(
            "site.magnetic_north_rad",
            f"its shape is {north.shape}, not {(len(recording.imu_time_s),)}",
            "Give one a recording",
        )
    # NaN stands for a direction that is not known.
    if np.isinf(north).any() or (np.abs(north) > 2 * np.pi).any():
        raise InputError(
            "site.magnetic_north_rad",
            f"{np.nanmax(np.abs(north)):g} is more than a whole turn: it looks like degrees",
            "Give radians",
        )
    return north + settings.heading_offset_rad


def _long_enough(span: NDArray[np.intp], rate_hz: float, settings: FootFilter) -> NDArray[np.bool_]:
    """Return which rests may be that of the alignment."""
    # Whole samples: half of one of tolerance for times that are not quite even.
    return np.asarray((span[:, 1] - span[:, 0] + 0.5) / rate_hz >= settings.alignment_s)
