"""Readings that are taken together: the same answer as one after the other, alone and in a stack."""

from typing import Any

import numpy as np
import pytest

from algorithms.tracking import foot_inertial
from algorithms.tracking.foot_inertial import FootInertial
from positioning.inertial.error_state import ErrorStateFilter, ProcessNoise, increments
from positioning.inertial.foot import FootNavigation, Start, foot_navigation
from positioning.inertial.foot_alignment import rests
from positioning.inertial.foot_plan import Fixes
from positioning.inertial.foot_settings import FootFilter
from positioning.inertial.foot_steps import misalignment_rad, steps
from positioning.inertial.merged import Merged, merge
from positioning.inertial.strapdown import rotation
from positioning.model import Recording
from tests.test_foot import SITE, many, shortened, stack, walk

NOISE = ProcessNoise(0.3, 0.2, heading_rad_per_rt_s=0.4)
ANSWERS = ("position_m", "heading_rad", "position_covariance_m2", "heading_variance_rad2")


def engines(seed: int, worlds: int) -> list[ErrorStateFilter]:
    """Return two equal filters."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(worlds, 9, 9))
    start: dict[str, Any] = {
        "position_m": rng.normal(size=(worlds, 3)),
        "velocity_m_per_s": rng.normal(size=(worlds, 3)),
        "attitude": rotation(rng.normal(size=(worlds, 3))),
        "covariance": root @ root.swapaxes(1, 2),
    }
    return [ErrorStateFilter(**start, noise=NOISE) for _ in range(2)]


def test_merged_samples_predict_what_one_after_the_other_does() -> None:
    rng, count = np.random.default_rng(3), np.array([40, 7, 2])
    worlds, longest = len(count) + 1, int(count[0])
    force, rate = rng.normal(0, 20, (longest, worlds, 3)), rng.normal(0, 5, (longest, worlds, 3))
    duration = rng.uniform(0.005, 0.02, (longest, worlds))
    # The last world has one sample only, and is not merged.
    duration[np.arange(longest)[:, None] >= [*count, 1]] = 0.0
    plain, joined = engines(4, worlds)
    each = increments(force, rate, duration)
    for sample in range(longest):
        plain.predict(each.turn_and_advance[sample], each.duration_s[sample])

    inside, run = np.nonzero(np.arange(longest)[:, None] < count)
    sums = merge(force[inside, run], rate[inside, run], duration[inside, run], count)
    both, lasts = each.turn_and_advance[0].copy(), each.duration_s[0].copy()
    both[:, :3, :3], both[:, 3, :3] = np.moveaxis(sums.rotation, 0, -1), sums.advance_m_per_s.T
    lasts[:3] = sums.duration_s
    joined.predict(both, lasts, None, Merged(np.arange(3), sums.way_m.T, sums.moments))
    for name in ("position_m", "velocity_m_per_s", "attitude", "covariance"):
        np.testing.assert_allclose(getattr(joined, name), getattr(plain, name), rtol=1e-10, atol=1e-11)


def test_moments_of_a_run_do_not_hang_on_the_others() -> None:
    rng, count = np.random.default_rng(5), np.array([70, 64, 33])
    _, run = np.nonzero(np.arange(70)[:, None] < count)
    force, rate = rng.normal(0, 20, (len(run), 3)), rng.normal(0, 5, (len(run), 3))
    duration = rng.uniform(0.005, 0.02, len(run))
    together = merge(force, rate, duration, count)
    for one, length in enumerate(count):
        own = run == one
        alone = merge(force[own], rate[own], duration[own], np.array([length]))
        for part, whole in zip(alone, together, strict=True):
            np.testing.assert_array_equal(part[0], whole[one])


def told_by(found: FootNavigation, row: int, at_s: Any) -> list[Any]:
    """Return the answers of one recording at readings, by their times."""
    place = np.searchsorted(found.time_s[row], at_s)
    np.testing.assert_array_equal(found.time_s[row, place], at_s)
    return [getattr(found, name)[row, place] for name in (*ANSWERS, "rest")]


def three_walks() -> tuple[list[Recording], Recording, Fixes]:
    """Return walks of different lengths, alone and as a stack, and fixes of the stack."""
    each = [walk(turn_rad=0.05 * n, noise=0.1, seed=n)[0] for n in range(3)]
    each[1] = shortened(each[1], 1500)
    joined = stack(*each)
    fix_m = np.full((*joined.time_s.shape, 2), np.nan)
    fix_m[:, 2::5] = 1.0
    return each, joined, Fixes(fix_m, np.tile(4 * np.eye(2), (*joined.time_s.shape, 1, 1)))


@pytest.mark.parametrize(
    "choice",
    [
        {},
        {"detector": "shoe", "magnetometer": False, "heading_noise_rad_per_rt_s": 0.05},
        {"zero_velocity": False},
        {"states": 15},
    ],
)
def test_fewer_readings_give_the_answer_of_all(choice: dict[str, Any]) -> None:
    _, joined, fixes = three_walks()
    options, start = FootFilter(**choice), Start(covariance_m2=np.tile(9 * np.eye(2), (3, 1, 1)))
    full, few = (
        foot_navigation(joined, many(SITE, 3), options, fixes=fixes, start=start, every_reading=every)
        for every in (True, False)
    )
    if options.states == 9:
        assert few.time_s.shape[1] < 0.7 * full.time_s.shape[1]
    for row in range(3):
        known_s = few.time_s[row, ~np.isnan(few.time_s[row])]
        for one, two in zip(told_by(few, row, known_s), told_by(full, row, known_s), strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-7, atol=1e-9)
    for one, two in zip(steps(few), steps(full), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-7, atol=1e-9)
    for one, two in zip(few.at(joined.time_s), full.at(joined.time_s), strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-7, atol=1e-9)


def test_fewer_readings_of_a_stack_give_what_one_gives() -> None:
    each, joined, fixes = three_walks()
    found = foot_navigation(joined, many(SITE, 3), FootFilter(), fixes=fixes, every_reading=False)
    for row, recording in enumerate(each):
        own = Fixes(fixes.position_m[row : row + 1], fixes.covariance_m2[row : row + 1])
        alone = foot_navigation(recording, SITE, FootFilter(), fixes=own, every_reading=False)
        count = alone.time_s.shape[1]
        for name in (*ANSWERS, "time_s", "rest"):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(found, name)[row, :count])
        assert np.isnan(found.time_s[row, count:]).all()


def test_long_ways_without_a_measurement_are_merged_in_parts() -> None:
    recording, *_ = walk(noise=0.05)
    seldom = Recording(**vars(recording) | {"time_s": recording.time_s[:, :1]})
    options = FootFilter(zero_velocity=False, magnetometer=False)
    # Behind the alignment, told here to be the only rest, lie more readings than are merged at most.
    rest = np.arange(seldom.imu_time_s.shape[1])[None] < 300  # type: ignore[union-attr]
    full, few = (
        foot_navigation(seldom, SITE, options, rest=rest, every_reading=every) for every in (True, False)
    )
    assert few.time_s.shape[1] < 20
    for name in ANSWERS:
        np.testing.assert_allclose(
            getattr(few, name)[0, -1], getattr(full, name)[0, -1], rtol=1e-9, atol=1e-9
        )


def test_the_first_readings_alone_are_those_of_all() -> None:
    _, joined, fixes = three_walks()
    full = foot_navigation(joined, many(SITE, 3), FootFilter(), fixes=fixes, every_reading=False)
    part = foot_navigation(
        joined, many(SITE, 3), FootFilter(), fixes=fixes, every_reading=False, readings=900
    )
    for row in range(3):
        known_s = part.time_s[row, ~np.isnan(part.time_s[row])]
        assert known_s[-1] == joined.imu_time_s[row, 899]  # type: ignore[index]
        for one, two in zip(told_by(part, row, known_s[:-1]), told_by(full, row, known_s[:-1]), strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("first", [200, 700, 10_000])
def test_the_beginning_tells_the_misalignment(first: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foot_inertial, "_BEGINNING", first)
    recording, *_ = walk(mount_rad=0.2, noise=0.05)
    inertial = FootInertial(straight_steps=3, misalignment_offset_rad=0.1)
    whole = misalignment_rad(steps(foot_navigation(recording, SITE, FootFilter())), count=3) + 0.1
    assert whole[0] == pytest.approx(0.3, abs=0.02)
    found = inertial.beginning_rad(recording, SITE, rests(recording, FootFilter()))
    np.testing.assert_allclose(found, whole, atol=1e-9)
