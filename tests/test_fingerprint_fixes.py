"""Fixes of scans in a map, and the tracker that is nothing but these."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin

from algorithms.access_points.fast_orthogonal_search import FastOrthogonalSearch
from algorithms.fingerprinting.control_centre import ControlCentre
from algorithms.fingerprinting.knn import Knn
from algorithms.fingerprinting.knn_softmax import KnnSoftmax
from algorithms.fingerprinting.reduced import Reduced
from algorithms.tracking.fingerprint_alone import FingerprintAlone
from positioning.errors import InputError
from positioning.fingerprint_fixes import (
    LEAST_DEVIATION_M,
    cannot_fix,
    fingerprint_fixes,
    fix_covariance_m2,
    map_centre_and_variance,
)
from positioning.model import Array, Calibration, Recording, Site, Survey

RUNS, EPOCHS, PLACES, COLUMNS = 5, 20, 30, 10
LENGTHS = (20, 13, 20, 1, 17)
ALGORITHM = Reduced(access_points=FastOrthogonalSearch(columns=6), regressor=KnnSoftmax(scale_db=10.0))


def make_stack(seed: int = 4) -> tuple[Recording, Survey, Site, Array]:
    """Return drives through radio worlds: the first two recordings share one, scans are every third epoch."""
    rng = np.random.default_rng(seed)
    place_m = rng.uniform(0, 20, (RUNS, PLACES, 2))
    radio_m = rng.uniform(-5, 25, (RUNS, COLUMNS, 2))
    place_m[1], radio_m[1] = place_m[0], radio_m[0]
    start_m, stop_m = rng.uniform(2, 18, (2, RUNS, 1, 2))
    true_m = start_m + (stop_m - start_m) * np.linspace(0, 1, EPOCHS)[:, None]

    def strength_dbm(position_m: Array) -> Array:
        distance_m = np.linalg.norm(position_m[:, :, None] - radio_m[:, None], axis=-1)
        return np.asarray(-35 - 30 * np.log10(np.maximum(distance_m, 1)))

    survey_dbm = np.round(strength_dbm(place_m) + rng.normal(0, 1, (RUNS, PLACES, COLUMNS)))
    survey_dbm[1] = survey_dbm[0]
    survey_dbm = np.where(survey_dbm < -75, np.nan, survey_dbm)
    survey_dbm[:, :, 3] = np.nan
    scan_dbm = np.round(strength_dbm(true_m) + rng.normal(0, 1, (RUNS, EPOCHS, COLUMNS)))
    scan_dbm = np.where(scan_dbm < -75, np.nan, scan_dbm)
    scan_dbm[:, np.arange(EPOCHS) % 3 != 1] = np.nan
    scan_dbm[3, 0] = -60.0
    time_s = np.tile(0.5 * np.arange(EPOCHS), (RUNS, 1))
    ended = np.arange(EPOCHS) >= np.array(LENGTHS)[:, None]
    for values in (time_s, scan_dbm, true_m):
        values[ended] = np.nan
    site = Site(corner_m=np.tile([[0.0, 0.0], [20.0, 20.0]], (RUNS, 1, 1)))
    return (
        Recording(time_s=time_s, rss_dbm=scan_dbm),
        Survey(rss_dbm=survey_dbm, position_m=place_m),
        site,
        true_m,
    )


RECORDING, SURVEY, SITE, TRUE_M = make_stack()
assert RECORDING.rss_dbm is not None
SCAN_DBM: Array = RECORDING.rss_dbm
ENDED = np.isnan(RECORDING.time_s)
SCANNED = ~np.isnan(SCAN_DBM).all(axis=-1)


class Counting(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """A regressor that counts its fits and keeps what it is asked."""

    fits = 0
    asked: tuple[Array, ...] = ()

    def fit(self, rss_dbm: Array, position_m: Array) -> "Counting":
        """Count."""
        Counting.fits += 1
        self.answer_ = position_m.mean(axis=0)
        return self

    def predict(self, rss_dbm: Array) -> Array:
        """Answer with the centre."""
        Counting.asked = (*Counting.asked, rss_dbm)
        return np.tile(self.answer_, (len(rss_dbm), 1))


class Wrong(Counting):
    """A regressor that answers with NaN."""

    def predict(self, rss_dbm: Array) -> Array:
        """Answer with NaN."""
        return np.full((len(rss_dbm), 2), np.nan)


def scans(where: Any, value: Any) -> Recording:
    """Return the recording with some readings changed."""
    values = SCAN_DBM.copy()
    values[where] = value
    return replace(RECORDING, rss_dbm=values)


def rngs(count: int = RUNS) -> list[np.random.Generator]:
    """Return generators that must not be drawn from."""
    return [np.random.default_rng([8, n]) for n in range(count)]


# Fixes


def test_fixes_are_what_the_regressor_says_of_each_scan() -> None:
    fix_m = fingerprint_fixes(Knn(k=3), SURVEY, RECORDING)
    np.testing.assert_array_equal(np.isnan(fix_m).any(axis=-1), ~SCANNED)
    for run in range(RUNS):
        fitted = Knn(k=3).fit(SURVEY.rss_dbm[run], SURVEY.position_m[run])
        seen = np.where(np.arange(COLUMNS) == 3, np.nan, SCAN_DBM[run, SCANNED[run]])
        np.testing.assert_array_equal(fix_m[run, SCANNED[run]], fitted.predict(seen))


def test_a_survey_scanned_again_is_located_exactly() -> None:
    again = Recording(time_s=np.tile(np.arange(float(PLACES)), (RUNS, 1)), rss_dbm=SURVEY.rss_dbm)
    heard = ~np.isnan(SURVEY.rss_dbm).all(axis=-1)
    fix_m = fingerprint_fixes(KnnSoftmax(k=1), SURVEY, again)
    np.testing.assert_array_equal(fix_m[heard], SURVEY.position_m[heard])


def test_access_points_that_the_map_never_heard_are_ignored() -> None:
    expected = fingerprint_fixes(ALGORITHM, SURVEY, RECORDING)
    loud = scans(np.s_[:, :, 3], -20.0)
    np.testing.assert_array_equal(fingerprint_fixes(ALGORITHM, SURVEY, loud), expected)
    # The same without that column.
    left = np.arange(COLUMNS) != 3
    smaller = fingerprint_fixes(
        ALGORITHM,
        replace(SURVEY, rss_dbm=SURVEY.rss_dbm[..., left]),
        replace(RECORDING, rss_dbm=SCAN_DBM[..., left]),
    )
    np.testing.assert_allclose(smaller, expected, atol=1e-12)


def test_a_scan_that_hears_nothing_of_the_map_has_no_fix() -> None:
    epoch = int(np.flatnonzero(SCANNED[0])[2])
    alone = scans((0, epoch), np.where(np.arange(COLUMNS) == 3, -40.0, np.nan))
    fix_m = fingerprint_fixes(ALGORITHM, SURVEY, alone)
    assert np.isnan(fix_m[0, epoch]).all()
    other = np.arange(EPOCHS) != epoch
    expected = fingerprint_fixes(ALGORITHM, SURVEY, RECORDING)
    np.testing.assert_array_equal(fix_m[0, other], expected[0, other])


def test_readings_after_the_end_have_no_fix() -> None:
    fix_m = fingerprint_fixes(ALGORITHM, SURVEY, scans(np.s_[1, 15], -50.0))
    assert np.isnan(fix_m[ENDED]).all()


def test_a_map_that_heard_nothing_gives_no_fix() -> None:
    silent = replace(SURVEY, rss_dbm=np.full_like(SURVEY.rss_dbm, np.nan))
    assert np.isnan(fingerprint_fixes(ALGORITHM, silent, RECORDING)).all()


def test_equal_surveys_are_fitted_once_and_the_algorithm_is_not_changed() -> None:
    Counting.fits, Counting.asked = 0, ()
    algorithm = Counting()
    fingerprint_fixes(algorithm, SURVEY, RECORDING)
    assert Counting.fits == 4
    assert sorted(len(rss) for rss in Counting.asked) == sorted(SCANNED.sum(axis=1))
    assert not hasattr(algorithm, "answer_")
    fingerprint_fixes(ALGORITHM, SURVEY, RECORDING)
    assert not hasattr(ALGORITHM, "regressor_")
    # A map that differs in one reading is another map.
    Counting.fits = 0
    changed = SURVEY.rss_dbm.copy()
    changed[1, 0, 0] = -33.0
    fingerprint_fixes(algorithm, replace(SURVEY, rss_dbm=changed), RECORDING)
    assert Counting.fits == 5


def test_a_survey_that_is_shifted_shifts_the_fixes() -> None:
    expected = fingerprint_fixes(ALGORITHM, SURVEY, RECORDING)
    moved = fingerprint_fixes(ALGORITHM, replace(SURVEY, position_m=SURVEY.position_m + 64.0), RECORDING)
    np.testing.assert_allclose(moved, expected + 64.0, atol=1e-9)


def test_one_map_point() -> None:
    one = Survey(rss_dbm=SURVEY.rss_dbm[:, :1], position_m=SURVEY.position_m[:, :1])
    fix_m = fingerprint_fixes(KnnSoftmax(k=1), one, RECORDING)
    heard = ~np.isnan(fix_m[..., 0])
    assert heard.any()
    np.testing.assert_array_equal(fix_m[heard], np.broadcast_to(one.position_m, fix_m.shape)[heard])
    with pytest.raises(InputError, match="k=4: it must lie between 1 and the number of training"):
        fingerprint_fixes(KnnSoftmax(k=4), one, RECORDING)
    least = np.tile(LEAST_DEVIATION_M**2 * np.eye(2), (RUNS, 1, 1))
    np.testing.assert_allclose(fix_covariance_m2(KnnSoftmax(k=1), one), least)


@pytest.mark.parametrize(
    ("survey", "recording", "message"),
    [
        (None, RECORDING, "no survey"),
        (Calibration(distance_m=np.ones((RUNS, 3)), rss_dbm=np.ones((RUNS, 3))), RECORDING, "no survey"),
        (SURVEY, replace(RECORDING, rss_dbm=None), "no received strengths"),
        (SURVEY, replace(RECORDING, rss_dbm=SCAN_DBM[..., :4]), "does not fit"),
        (SURVEY, replace(RECORDING, rss_dbm=SCAN_DBM[:, :4]), "does not fit"),
        (Survey(rss_dbm=SURVEY.rss_dbm[:2], position_m=SURVEY.position_m[:2]), RECORDING, "does not fit"),
        (SURVEY, scans((0, 1, 2), np.inf), r"recording.rss_dbm\[0, 1, 2\]"),
        (replace(SURVEY, rss_dbm=SURVEY.rss_dbm - np.inf), RECORDING, "not a finite number"),
        (replace(SURVEY, position_m=SURVEY.position_m * np.nan), RECORDING, "not a finite number"),
        (SURVEY.at(0), RECORDING, "recording, n, ap"),
    ],
)
def test_input_that_cannot_be_used_is_refused(survey: Any, recording: Recording, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fingerprint_fixes(ALGORITHM, survey, recording)


def test_an_answer_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InputError, match="the answer of Wrong"):
        fingerprint_fixes(Wrong(), SURVEY, RECORDING)


def test_the_covariance_is_the_error_between_the_halves_of_the_map() -> None:
    covariance_m2 = fix_covariance_m2(Knn(k=2), SURVEY)
    assert covariance_m2.shape == (RUNS, 2, 2)
    rss_dbm, position_m = SURVEY.rss_dbm[2], SURVEY.position_m[2]
    order = np.lexsort(position_m.T[::-1])
    even, odd = order[::2], order[1::2]
    error_m = np.vstack(
        [
            Knn(k=2).fit(rss_dbm[a], position_m[a]).predict(rss_dbm[b]) - position_m[b]
            for a, b in ((even, odd), (odd, even))
        ]
    )
    expected = error_m.T @ error_m / PLACES + 0.01 * np.eye(2)
    np.testing.assert_allclose(covariance_m2[2], expected, rtol=1e-10)
    # The order in which places were surveyed does not matter, nor where the others of a place stand.
    back = replace(SURVEY, rss_dbm=SURVEY.rss_dbm[:, ::-1], position_m=SURVEY.position_m[:, ::-1])
    np.testing.assert_allclose(fix_covariance_m2(Knn(k=2), back), covariance_m2, rtol=1e-9)


def test_places_surveyed_twice_stay_in_one_half() -> None:
    # Two scans a place that are equal: with one in each half, every error would be zero.
    twice = Survey(rss_dbm=SURVEY.rss_dbm.repeat(2, axis=1), position_m=SURVEY.position_m.repeat(2, axis=1))
    np.testing.assert_allclose(
        fix_covariance_m2(Knn(k=1), twice), fix_covariance_m2(Knn(k=1), SURVEY), rtol=1e-9
    )


def test_the_spread_of_the_places_stands_for_halves_that_are_too_small() -> None:
    few = Survey(rss_dbm=SURVEY.rss_dbm[:, :6], position_m=SURVEY.position_m[:, :6])
    _, spread_m2 = map_centre_and_variance(few)
    np.testing.assert_array_equal(fix_covariance_m2(Knn(k=4), few), spread_m2)
    expected = np.cov(few.position_m[0].T, bias=True) + 0.01 * np.eye(2)
    np.testing.assert_allclose(spread_m2[0], expected)


# The tracker


def test_a_track_holds_the_last_fix_and_starts_in_the_centre_of_the_survey() -> None:
    track = FingerprintAlone(fingerprinting=ALGORITHM).track_stack(RECORDING, SURVEY, SITE, rngs())
    fix_m = fingerprint_fixes(ALGORITHM, SURVEY, RECORDING)
    np.testing.assert_array_equal(track.extra["fix_m"], fix_m)
    for run in range(RUNS):
        last = SURVEY.position_m[run].mean(axis=0)
        covariance_m2 = map_centre_and_variance(SURVEY)[1][run]
        for epoch in range(LENGTHS[run]):
            if SCANNED[run, epoch]:
                last, covariance_m2 = fix_m[run, epoch], fix_covariance_m2(ALGORITHM, SURVEY)[run]
            np.testing.assert_array_equal(track.position_m[run, epoch], last)
            np.testing.assert_array_equal(track.covariance_m2[run, epoch], covariance_m2)
    assert np.isnan(track.position_m[ENDED]).all()
    assert np.isnan(track.covariance_m2[ENDED]).all()
    assert np.linalg.eigvalsh(track.covariance_m2[~ENDED]).min() > 0
    np.testing.assert_array_equal(track.covariance_m2, np.swapaxes(track.covariance_m2, -1, -2))


@pytest.mark.parametrize("fingerprinting", [None, ALGORITHM])
def test_a_stack_gives_exactly_what_each_recording_gives(fingerprinting: Any) -> None:
    tracker = FingerprintAlone(fingerprinting=fingerprinting)
    together = tracker.track_stack(RECORDING, SURVEY, SITE, rngs())
    assert tracker.fingerprinting is fingerprinting
    for run, length in enumerate(LENGTHS):
        recording = RECORDING.at(run).until(length)
        alone = tracker.track(recording, SURVEY.at(run), SITE.at(run), rngs()[run])
        np.testing.assert_array_equal(alone.position_m, together.position_m[run, :length])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[run, :length])
        np.testing.assert_array_equal(alone.extra["fix_m"], together.extra["fix_m"][run, :length])


def test_it_finds_the_way_and_takes_the_default_pair() -> None:
    track = FingerprintAlone().track_stack(RECORDING, SURVEY, SITE, rngs())
    pair = Reduced(access_points=FastOrthogonalSearch(columns=4), regressor=KnnSoftmax(k=4))
    np.testing.assert_array_equal(track.extra["fix_m"], fingerprint_fixes(pair, SURVEY, RECORDING))

    def error_m(position_m: Array) -> float:
        return float(np.nanmean(np.linalg.norm(position_m - TRUE_M, axis=-1)[:, 1:]))

    assert error_m(track.position_m) < 0.6 * error_m(np.full_like(TRUE_M, 10.0))


def test_nothing_is_drawn_and_nothing_is_changed_and_later_scans_leave_no_trace() -> None:
    generators, states = rngs(), [rng.bit_generator.state for rng in rngs()]
    kept = make_stack()
    track = FingerprintAlone().track_stack(RECORDING, SURVEY, SITE, generators)
    assert [rng.bit_generator.state for rng in generators] == states
    for part, copy in zip((RECORDING, SURVEY, SITE), kept[:3], strict=True):
        for field, values in part.to_arrays().items():
            np.testing.assert_array_equal(values, copy.to_arrays()[field])
    earlier = FingerprintAlone().track_stack(scans(np.s_[:, 9:], np.nan), SURVEY, SITE, rngs())
    np.testing.assert_array_equal(earlier.position_m[:, :9], track.position_m[:, :9])
    assert (earlier.position_m[:, 9:] != track.position_m[:, 9:]).any()


def test_silence_stays_in_the_centre_of_the_survey() -> None:
    track = FingerprintAlone().track_stack(scans(np.s_[:], np.nan), SURVEY, SITE, rngs())
    centre_m = np.broadcast_to(SURVEY.position_m.mean(axis=1)[:, None], track.position_m.shape)
    np.testing.assert_array_equal(track.position_m[~ENDED], centre_m[~ENDED])


def test_a_map_may_have_as_many_places_as_neighbours() -> None:
    for places in (1, 5):
        few = Survey(rss_dbm=SURVEY.rss_dbm[:, :places], position_m=SURVEY.position_m[:, :places])
        assert cannot_fix(Knn(k=places), few, RECORDING, SITE) == ""
        assert np.isfinite(fingerprint_fixes(Knn(k=places), few, RECORDING)[SCANNED & ~ENDED]).all()
        reason = cannot_fix(Knn(k=places + 1), few, RECORDING, SITE)
        assert f"needs {places + 1} training fingerprints, this survey leaves {places}" in reason
        assert "smaller k" in reason.cure
    # Several scans of a place count as they do in the fit.
    twice = Survey(
        rss_dbm=np.repeat(SURVEY.rss_dbm[:, :2], 3, axis=1),
        position_m=np.repeat(SURVEY.position_m[:, :2], 3, axis=1),
    )
    assert cannot_fix(Knn(k=6), twice, RECORDING, SITE) == ""
    assert "leaves 6" in cannot_fix(Knn(k=7), twice, RECORDING, SITE)


def test_skip_names_what_is_missing() -> None:
    tracker = FingerprintAlone()
    assert tracker.skip(RECORDING, SURVEY, SITE) == ""
    assert "no survey" in tracker.skip(RECORDING, None, SITE)
    calibration = Calibration(distance_m=np.ones((RUNS, 3)), rss_dbm=np.ones((RUNS, 3)))
    assert "no survey" in tracker.skip(RECORDING, calibration, SITE)
    assert "no received strengths" in tracker.skip(replace(RECORDING, rss_dbm=None), SURVEY, SITE)
    narrow = replace(SURVEY, rss_dbm=SURVEY.rss_dbm[..., :3])
    assert "columns = 4 are asked" in tracker.skip(RECORDING, narrow, SITE)
    assert "fewer columns" in tracker.skip(RECORDING, narrow, SITE).cure
    assert cannot_fix(ControlCentre(), narrow, RECORDING, SITE) == ""
    with pytest.raises(InputError, match="no survey"):
        tracker.track_stack(RECORDING, None, SITE, rngs())
    backwards = replace(RECORDING, time_s=-RECORDING.time_s)
    with pytest.raises(InputError, match="does not increase"):
        tracker.track_stack(backwards, SURVEY, SITE, rngs())
