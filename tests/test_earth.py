"""The earth against its own ellipse, published values, and a potential of its own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from positioning.inertial.earth import (
    EARTH_RATE_RAD_PER_S,
    FLATTENING,
    SEMI_MAJOR_AXIS_M,
    earth_rate_rad_per_s,
    gravity_m_per_s2,
    meridian_radius_m,
    normal_radius_m,
)

SEMI_MINOR_AXIS_M = SEMI_MAJOR_AXIS_M * (1 - FLATTENING)
LATITUDES = st.floats(-1.5, 1.5)


def test_axes_and_radii_have_their_published_values() -> None:
    assert pytest.approx(6_356_752.3142, abs=1e-4) == SEMI_MINOR_AXIS_M
    polar_m = 6_399_593.6258
    np.testing.assert_allclose(meridian_radius_m([0.0, np.pi / 2]), [6_335_439.3273, polar_m], atol=1e-3)
    np.testing.assert_allclose(normal_radius_m([0.0, -np.pi / 2]), [SEMI_MAJOR_AXIS_M, polar_m], atol=1e-3)


def test_a_quarter_of_the_meridian_has_its_published_length() -> None:
    length_m, _ = quad(lambda latitude: float(meridian_radius_m(latitude)), 0, np.pi / 2)
    assert length_m == pytest.approx(10_001_965.7293, abs=1e-3)


@given(LATITUDES)
def test_radii_are_those_of_the_ellipse(latitude_rad: float) -> None:
    # On the ellipse itself: the reduced latitude has b / a times the slope of the geodetic one.
    reduced = np.arctan(SEMI_MINOR_AXIS_M / SEMI_MAJOR_AXIS_M * np.tan(latitude_rad))
    from_axis_m = SEMI_MAJOR_AXIS_M * np.cos(reduced)
    assert normal_radius_m(latitude_rad) * np.cos(latitude_rad) == pytest.approx(from_axis_m, rel=1e-12)
    # Radius of curvature of an ellipse by its parameter.
    speed = np.hypot(SEMI_MAJOR_AXIS_M * np.sin(reduced), SEMI_MINOR_AXIS_M * np.cos(reduced))
    curvature_radius_m = speed**3 / (SEMI_MAJOR_AXIS_M * SEMI_MINOR_AXIS_M)
    assert meridian_radius_m(latitude_rad) == pytest.approx(curvature_radius_m, rel=1e-12)


def test_the_earth_turns_up_at_the_poles_and_north_at_the_equator() -> None:
    found = earth_rate_rad_per_s(np.array([[0.0, np.pi / 2], [-np.pi / 2, 0.7]]))
    assert found.shape == (2, 2, 3)
    np.testing.assert_allclose(found[0], np.array([[0, 1, 0], [0, 0, 1]]) * EARTH_RATE_RAD_PER_S, atol=1e-20)
    np.testing.assert_allclose(found[1, 0], np.array([0, 0, -EARTH_RATE_RAD_PER_S]), atol=1e-20)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), EARTH_RATE_RAD_PER_S)
    # 15.04 degrees an hour, of which the vertical part at Kingston is 10.49.
    per_hour_deg = np.rad2deg(earth_rate_rad_per_s(np.deg2rad(44.23))) * 3600
    assert per_hour_deg[2] == pytest.approx(10.49, abs=0.01)


def test_gravity_has_its_published_values() -> None:
    np.testing.assert_allclose(
        gravity_m_per_s2(np.deg2rad([0.0, 45.0, 90.0])), [9.7803253359, 9.8061977693, 9.8321849379], atol=1e-9
    )


@given(LATITUDES, st.floats(0.0, 5_000.0))
def test_gravity_is_the_slope_of_the_potential(latitude_rad: float, height_m: float) -> None:
    # Mass, two terms of the oblateness, and rotation.
    def potential(axis_m: float, pole_m: float) -> float:
        radius_m = np.hypot(axis_m, pole_m)
        ratio, sine = (SEMI_MAJOR_AXIS_M / radius_m) ** 2, (pole_m / radius_m) ** 2
        oblate = 1.082629821e-3 * ratio * (3 * sine - 1) / 2
        oblate -= 2.37091222e-6 * ratio**2 * (35 * sine**2 - 30 * sine + 3) / 8
        spin = 0.5 * EARTH_RATE_RAD_PER_S**2 * axis_m**2
        return float(3.986004418e14 / radius_m * (1 - oblate) + spin)

    axis_m = float(normal_radius_m(latitude_rad) + height_m) * np.cos(latitude_rad)
    shrink = (1 - FLATTENING) ** 2
    pole_m = float(normal_radius_m(latitude_rad) * shrink + height_m) * np.sin(latitude_rad)
    step_m = 50.0
    slope = [
        (potential(axis_m + step_m, pole_m) - potential(axis_m - step_m, pole_m)) / (2 * step_m),
        (potential(axis_m, pole_m + step_m) - potential(axis_m, pole_m - step_m)) / (2 * step_m),
    ]
    assert gravity_m_per_s2(latitude_rad, height_m) == pytest.approx(np.hypot(*slope), abs=3e-6)
