"""The particle filters of RISS and WiFi against their contract, each other and known answers."""

import importlib
import inspect
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from algorithms.fingerprinting.knn import Knn
from algorithms.tracking.riss_adaptive_mixture_filter import RissAdaptiveMixtureFilter
from algorithms.tracking.riss_fast_mixture_filter import RissFastMixtureFilter
from algorithms.tracking.riss_mixture_filter import RissMixtureFilter
from algorithms.tracking.riss_particle_filter import RissParticleFilter
from positioning.errors import InputError
from positioning.fingerprint_fixes import fingerprint_fixes
from positioning.inertial.riss_readings import downsample
from positioning.model import Array, Recording, Site, Survey, Track, Truth
from positioning.registry import class_name
from positioning.tasks import tracking

NAMES = [f"riss_{kind}filter" for kind in ("particle_", "mixture_", "fast_mixture_", "adaptive_mixture_")]
RUNS, EPOCHS, LENGTHS, RATE_HZ, REST_S = 4, 40, (40, 31, 40, 1), 20.0, 6.0
SIZE_M = np.array([30.0, 20.0])
FAST: dict[str, Any] = {"particles": 100}


class Coordinates:
    """A fingerprinting whose first two readings are the place itself, in metres less 200."""

    def fit(self, rss_dbm: Array, position_m: Array) -> "Coordinates":
        """Learn nothing."""
        return self

    def predict(self, rss_dbm: Array) -> Array:
        """Return the place."""
        return np.asarray(rss_dbm[:, :2] + 200.0)

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return no parameters, so that it can be cloned."""
        return {}


def make_stack(
    seed: int = 1, fix_sigma_m: float = 1.5, bias_rad_per_s: float = 0.002, scale: float = 1.05
) -> tuple[Recording, Survey, Site, Truth]:
    """Return runs that rest, drive along a bend, stop, and go on."""
    rng = np.random.default_rng(seed)
    motion_s = np.arange(0.0, EPOCHS, 1 / RATE_HZ)
    driving = (motion_s > REST_S + 0.01) & ~((motion_s > 20) & (motion_s < 24))
    speed = np.where(driving, 0.7, 0.0) * np.ones((RUNS, 1))
    turn = np.where(driving, rng.uniform(-0.06, 0.06, (RUNS, 1)), 0.0)
    heading = np.full((RUNS, 1), 0.3) + np.cumsum(turn, axis=1) / RATE_HZ
    step_m = speed[..., None] / RATE_HZ * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    path_m = np.array([4.0, 8.0]) + np.cumsum(step_m, axis=1)
    each = np.arange(EPOCHS) * int(RATE_HZ)
    time_s, position_m = np.tile(motion_s[each], (RUNS, 1)), path_m[:, each]
    rss_dbm = np.full((RUNS, EPOCHS, 3), -60.0)
    rss_dbm[..., :2] = position_m + fix_sigma_m * rng.standard_normal(position_m.shape) - 200
    rss_dbm[:, 11] = rss_dbm[1, 15:20] = np.nan
    ended = np.arange(EPOCHS) >= np.array(LENGTHS)[:, None]
    for values in (time_s, rss_dbm, position_m):
        values[ended] = np.nan
    gyro = turn + np.where(driving, bias_rad_per_s, 0.0) + 0.03 + 0.005 * rng.standard_normal(turn.shape)
    place_m = np.stack(np.meshgrid(np.arange(1.0, 30, 4), np.arange(1.0, 20, 4)), axis=-1).reshape(-1, 2)
    survey_dbm = np.concatenate([place_m - 200, np.full((len(place_m), 1), -60.0)], axis=1)
    return (
        Recording(
            time_s=time_s,
            rss_dbm=rss_dbm,
            start_heading_rad=np.full(RUNS, 0.3),
            start_position_m=position_m[:, 0],
            motion_time_s=np.tile(motion_s, (RUNS, 1)),
            gyro_rad_per_s=gyro,
            odometer_m_per_s=scale * speed,
        ),
        Survey(rss_dbm=np.tile(survey_dbm, (RUNS, 1, 1)), position_m=np.tile(place_m, (RUNS, 1, 1))),
        Site(corner_m=np.tile([[0.0, 0.0], SIZE_M], (RUNS, 1, 1))),
        Truth(position_m=position_m),
    )


RECORDING, SURVEY, SITE, TRUTH = make_stack()
ENDED = np.isnan(RECORDING.time_s)


def algorithm_class(name: str) -> Any:
    """Return the class of an algorithm's file."""
    return getattr(importlib.import_module(f"algorithms.tracking.{name}"), class_name(name))


def make(name: str, **changes: Any) -> Any:
    """Return a small filter whose fixes are those that were put into the readings."""
    small = FAST | (
        {"clusters": 20} if "clusters" in inspect.signature(algorithm_class(name)).parameters else {}
    )
    return algorithm_class(name)(**({"fingerprinting": Coordinates()} | small | changes))


def rngs(count: int = RUNS) -> list[np.random.Generator]:
    """Return fresh generators."""
    return [np.random.default_rng([9, number]) for number in range(count)]


def track(algorithm: Any, recording: Recording = RECORDING, survey: Survey = SURVEY) -> Track:
    """Track all recordings."""
    return algorithm.track_stack(recording, survey, SITE, rngs())  # type: ignore[no-any-return]


def error_m(found: Track, first: int = 0) -> Array:
    """Return the errors of all epochs from the first."""
    offset_m = (found.position_m - TRUTH.position_m)[:, first:]
    return np.linalg.norm(offset_m[~ENDED[:, first:]], axis=-1)


# The contract


@pytest.mark.parametrize("name", NAMES)
def test_parameters_are_keywords_documented_and_stored_unchanged(name: str) -> None:
    cls = algorithm_class(name)
    algorithm = make(name, fingerprinting=Coordinates())
    text = inspect.getdoc(cls) or ""
    names = [word for line in text.splitlines() if line[:1].isalpha() for word in line.split(", ")]
    before = dict(vars(algorithm))
    for parameter in inspect.signature(cls).parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert parameter.default is not inspect.Parameter.empty
        assert parameter.name in names, parameter.name
        assert parameter.name in before
    assert set(before) == set(inspect.signature(cls).parameters)
    track(algorithm)
    assert all(getattr(algorithm, key) is value for key, value in before.items())


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_finite_until_the_end_and_covariances_are_ones(name: str) -> None:
    found = track(make(name))
    assert found.position_m.shape == (RUNS, EPOCHS, 2)
    assert set(found.extra) == {
        "effective_sample_size",
        "weight_evaluations",
        "weight_prediction",
        "weight_wifi",
    }
    for values in (found.position_m, found.covariance_m2, *found.extra.values()):
        assert np.isfinite(values[~ENDED]).all()
        assert np.isnan(np.asarray(values, dtype=float)[ENDED]).all()
    covariance = found.covariance_m2[~ENDED]
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_a_stack_gives_exactly_what_each_recording_gives(name: str) -> None:
    together = track(make(name))
    for row, length in enumerate(LENGTHS):
        alone = make(name).track(RECORDING.at(row).until(length), SURVEY.at(row), SITE.at(row), rngs()[row])
        np.testing.assert_array_equal(alone.position_m, together.position_m[row, :length])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[row, :length])
        for key, values in alone.extra.items():
            np.testing.assert_array_equal(values, together.extra[key][row, :length])


@pytest.mark.parametrize("name", NAMES)
def test_global_random_state_and_inputs_are_left_alone(name: str) -> None:
    state, kept = np.random.get_state(), make_stack()  # noqa: NPY002
    first, second = track(make(name)), track(make(name))
    np.testing.assert_array_equal(first.position_m, second.position_m)
    for old, new in zip(state, np.random.get_state(), strict=True):  # noqa: NPY002
        np.testing.assert_array_equal(old, new)
    for part, copy in zip((RECORDING, SURVEY, SITE), kept, strict=False):
        for field, values in part.to_arrays().items():
            np.testing.assert_array_equal(values, copy.to_arrays()[field])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("epoch", [3, 18])
def test_later_epochs_leave_no_trace(name: str, epoch: int) -> None:
    # Nor within the first rest, although the start is made of its fixes.
    assert RECORDING.rss_dbm is not None
    rss_dbm = RECORDING.rss_dbm.copy()
    rss_dbm[:, epoch:] += 3.0
    first, second = track(make(name)), track(make(name), replace(RECORDING, rss_dbm=rss_dbm))
    np.testing.assert_array_equal(first.position_m[:, :epoch], second.position_m[:, :epoch])
    assert np.nanmax(np.abs(first.position_m[:, epoch] - second.position_m[:, epoch])) > 0.01


@pytest.mark.parametrize("name", NAMES)
def test_the_start_that_dead_reckoning_alone_may_use_enters_no_filter(name: str) -> None:
    observed = RECORDING.to_arrays() | SURVEY.to_arrays() | SITE.to_arrays()
    moved = observed | {"recording.start_position_m": TRUTH.position_m[:, 0] + 50.0}
    found = [
        tracking.run(lambda **given: make(name, **given), arrays, None, {}, rngs()).estimates
        for arrays in (observed, moved)
    ]
    for key, values in found[0].items():
        np.testing.assert_array_equal(values, found[1][key])


# Each filter and the one before it


@pytest.mark.parametrize("name", NAMES[1:])
def test_without_samples_from_the_fix_every_filter_is_the_plain_one(name: str) -> None:
    plain = track(make(NAMES[0]))
    exact: dict[str, Any] = {} if name == NAMES[1] else {"clusters": FAST["particles"]}
    if name == NAMES[3]:
        # Other factors cancel as well, but for the last digit of the weights.
        exact |= {"near": (0.5, 0.5), "far": (0.5, 0.5)}
    found = track(make(name, from_wifi=0.0, **exact))
    np.testing.assert_array_equal(found.position_m, plain.position_m)
    np.testing.assert_array_equal(found.covariance_m2, plain.covariance_m2)
    other = track(make(name, from_wifi=0.5, **exact))
    assert np.nanmax(np.abs(other.position_m - plain.position_m)) > 0.01


def test_as_many_clusters_as_samples_are_the_exact_mixture() -> None:
    exact = track(make(NAMES[1]))
    found = track(make(NAMES[2], clusters=FAST["particles"]))
    np.testing.assert_array_equal(found.position_m, exact.position_m)
    np.testing.assert_array_equal(found.extra["weight_evaluations"], exact.extra["weight_evaluations"])
    assert np.nanmax(np.abs(track(make(NAMES[2])).position_m - exact.position_m)) > 0.01


@pytest.mark.parametrize("clusters", [20, None])
def test_constant_factors_are_the_filter_that_does_not_adapt(clusters: int | None) -> None:
    fixed = track(make(NAMES[2]) if clusters else make(NAMES[1]))
    found = track(make(NAMES[3], near=(0.5, 0.5), far=(0.5, 0.5), clusters=clusters))
    np.testing.assert_array_equal(found.position_m, fixed.position_m)
    np.testing.assert_array_equal(found.covariance_m2, fixed.covariance_m2)
    adaptive = track(make(NAMES[3], clusters=clusters))
    assert np.nanmax(np.abs(adaptive.position_m - fixed.position_m)) > 0.01


def test_every_weight_but_those_of_samples_from_the_fix_is_saved() -> None:
    exact, fast = (track(make(name)).extra["weight_evaluations"] for name in NAMES[1:3])
    told = exact > 0
    assert set(np.unique(exact[told])) == {120}
    # 80 % of 100 predicted samples; 20 about the fix stay.
    assert set(np.unique(fast[told])) == {40}
    plain = track(make(NAMES[0])).extra["weight_evaluations"]
    assert set(np.unique(plain[told])) == {100}


def test_factors_follow_the_stops() -> None:
    found = track(make(NAMES[3], near=[0.8, 0.2], far=[0.3, 0.7], hold_s=2.0, ramp_s=4.0))
    prediction, wifi = (found.extra[f"weight_{part}"][0] for part in ("prediction", "wifi"))
    time_s = RECORDING.time_s[0]
    resting = (time_s <= REST_S) | ((time_s > 21) & (time_s < 24))
    np.testing.assert_array_equal(prediction[resting], 0.8)
    np.testing.assert_array_equal(wifi[resting], 0.2)
    np.testing.assert_allclose(prediction[(time_s > 13) & (time_s < 20)], 0.3)
    np.testing.assert_allclose(wifi[time_s > 31], 0.7)
    np.testing.assert_allclose(np.diff(prediction[8:12]), -0.125)


# Known answers


@pytest.mark.parametrize("name", NAMES)
def test_a_track_is_much_better_than_its_fixes(name: str) -> None:
    fix_m = fingerprint_fixes(Coordinates(), SURVEY, RECORDING)
    of_fixes = np.linalg.norm(fix_m - TRUTH.position_m, axis=-1)
    rms_m = np.sqrt(np.mean(error_m(track(make(name, particles=1000)), 6) ** 2))
    assert rms_m < 0.75 * np.sqrt(np.nanmean(of_fixes[:, 6:] ** 2))


@pytest.mark.parametrize("name", NAMES)
def test_without_fixes_it_is_dead_reckoning_from_anywhere(name: str) -> None:
    assert RECORDING.rss_dbm is not None
    silent = replace(RECORDING, rss_dbm=np.full_like(RECORDING.rss_dbm, np.nan))
    found = track(
        make(
            name,
            particles=4000,
            turn_noise_rad_per_sqrt_s=0.0,
            distance_noise=0.0,
            start_heading_sigma_rad=0.0,
        ),
        silent,
    )
    np.testing.assert_allclose(found.position_m[:, 0], np.tile([15.0, 9.0], (RUNS, 1)), atol=0.8)
    going = found.position_m - found.position_m[:, :1]
    expected = TRUTH.position_m - TRUTH.position_m[:, :1]
    # Five per cent too far, and the bias of the gyroscope leads astray.
    np.testing.assert_allclose(going[~ENDED], expected[~ENDED], atol=0.1 * np.nanmax(np.abs(expected)))
    assert (found.extra["weight_evaluations"][~ENDED] == 0).all()
    assert (found.extra["effective_sample_size"][~ENDED] == 4000).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_scan_that_hears_nothing_is_a_prediction_only(name: str) -> None:
    found = track(make(name))
    evaluations = found.extra["weight_evaluations"]
    assert (evaluations[:3, 11] == 0).all()
    assert (evaluations[1, 15:20] == 0).all()
    assert (evaluations[0, 12:20] > 0).all()
    # The first rest makes the start.
    assert (evaluations[:3, :6] == 0).all()


def test_every_second_fix_only() -> None:
    told = track(make(NAMES[0], scan_every=2)).extra["weight_evaluations"] > 0
    all_told = track(make(NAMES[0])).extra["weight_evaluations"] > 0
    fix_m = fingerprint_fixes(Coordinates(), SURVEY, RECORDING)
    for row in range(RUNS):
        kept = np.zeros(EPOCHS, dtype=bool)
        kept[np.flatnonzero(np.isfinite(fix_m[row, :, 0]))[::2]] = True
        np.testing.assert_array_equal(told[row], kept & all_told[row])
    # One scan of all, at the first epoch: the start, and then the motion alone.
    once = track(make(NAMES[0], scan_every=1000))
    assert (once.extra["weight_evaluations"][~ENDED] == 0).all()
    np.testing.assert_allclose(once.position_m[:, 0], fix_m[:, 0], atol=0.7)


def test_readings_are_averaged_first() -> None:
    for factor in (2, 5):
        found = track(make(NAMES[0], downsampling=factor)).position_m
        averaged = downsample(RECORDING, factor=factor)
        np.testing.assert_array_equal(found, track(make(NAMES[0], downsampling=1), averaged).position_m)
    assert np.nanmax(np.abs(found - track(make(NAMES[0], downsampling=1)).position_m)) > 1e-6


def test_a_heading_that_nobody_noted_is_found_by_driving() -> None:
    exact, *_ = make_stack(fix_sigma_m=0.1)
    lost = replace(exact, start_heading_rad=None)
    found = track(make(NAMES[0], particles=2000, scale_m=0.3), lost)
    assert error_m(found, 30).max() < 1.0
    half = np.array([np.nan, 0.3, 0.3, 0.3])
    partly = track(make(NAMES[0], particles=200), replace(exact, start_heading_rad=half))
    known = track(make(NAMES[0], particles=200), exact)
    np.testing.assert_array_equal(partly.position_m[1:], known.position_m[1:])


def test_the_default_fingerprinting_locates_by_itself() -> None:
    # Strengths that fall with the distance to six places.
    rng = np.random.default_rng(3)
    source_m = rng.uniform(0, SIZE_M, (6, 2))

    def rss_dbm(position_m: Array) -> Array:
        distance_m = np.linalg.norm(position_m[..., None, :] - source_m, axis=-1)
        return np.asarray(-30 - 25 * np.log10(np.maximum(distance_m, 0.5)))

    survey = replace(SURVEY, rss_dbm=rss_dbm(SURVEY.position_m))
    recording = replace(RECORDING, rss_dbm=rss_dbm(TRUTH.position_m))
    for fingerprinting in (None, Knn(k=3)):
        found = track(RissParticleFilter(particles=300, fingerprinting=fingerprinting), recording, survey)
        assert np.sqrt(np.mean(error_m(found) ** 2)) < 2.5


def test_a_dropped_out_odometer_is_bridged() -> None:
    assert RECORDING.odometer_m_per_s is not None
    odometer = RECORDING.odometer_m_per_s.copy()
    odometer[:, 200:240] = np.nan
    found = track(make(NAMES[3]), replace(RECORDING, odometer_m_per_s=odometer))
    np.testing.assert_array_equal(found.position_m, track(make(NAMES[3])).position_m)


# Bad input


def test_skip_names_what_is_missing() -> None:
    for name in NAMES:
        algorithm = make(name)
        assert algorithm.skip(RECORDING, SURVEY, SITE) == ""
        assert "gyro" in algorithm.skip(replace(RECORDING, gyro_rad_per_s=None), SURVEY, SITE)
        assert "odometer" in algorithm.skip(replace(RECORDING, odometer_m_per_s=None), SURVEY, SITE)
        assert "survey" in algorithm.skip(RECORDING, None, SITE)
        assert "strengths" in algorithm.skip(replace(RECORDING, rss_dbm=None), SURVEY, SITE)
    # Three columns are fewer than the four of the default.
    for row in (RECORDING, SURVEY, SITE), (RECORDING.at(0), SURVEY.at(0), SITE.at(0)):
        assert "columns" in RissParticleFilter().skip(*row)  # type: ignore[arg-type]
        assert make(NAMES[0]).skip(*row) == ""
    with pytest.raises(InputError, match="survey"):
        make(NAMES[0]).track_stack(RECORDING, None, SITE, rngs())


@pytest.mark.parametrize(
    ("cls", "parameter", "value"),
    [
        (RissParticleFilter, "particles", 0),
        (RissParticleFilter, "scale_m", 0.0),
        (RissParticleFilter, "turn_noise_rad_per_sqrt_s", -1.0),
        (RissParticleFilter, "distance_noise", float("nan")),
        (RissParticleFilter, "start_sigma_m", -1.0),
        (RissParticleFilter, "start_heading_sigma_rad", -1.0),
        (RissParticleFilter, "scan_every", 0),
        (RissParticleFilter, "downsampling", 0),
        (RissMixtureFilter, "from_wifi", -0.5),
        (RissMixtureFilter, "fix_sigma_m", -1.0),
        (RissMixtureFilter, "weight_prediction", -1.0),
        (RissMixtureFilter, "weight_wifi", float("nan")),
        (RissFastMixtureFilter, "clusters", 0),
        (RissFastMixtureFilter, "clusters", 1001),
        (RissParticleFilter, "particles", 99.5),
        (RissParticleFilter, "particles", "many"),
        (RissParticleFilter, "scale_m", "wide"),
        (RissFastMixtureFilter, "clusters", 20.0),
        (RissAdaptiveMixtureFilter, "far", (0, 0)),
        (RissAdaptiveMixtureFilter, "near", (0.5, -0.5)),
        (RissAdaptiveMixtureFilter, "far", (0.5, 0.5, 0.5)),
        (RissAdaptiveMixtureFilter, "hold_s", -1.0),
        (RissAdaptiveMixtureFilter, "ramp_s", 0.0),
    ],
)
def test_senseless_settings_are_refused(cls: Any, parameter: str, value: Any) -> None:
    with pytest.raises(InputError, match="both are zero" if value == (0, 0) else parameter):
        track(cls(**{"fingerprinting": Coordinates(), parameter: value}))
    with pytest.raises(InputError, match="both are zero"):
        track(RissMixtureFilter(fingerprinting=Coordinates(), weight_prediction=0, weight_wifi=0))


@pytest.mark.parametrize("name", ["time_s", "motion_time_s"])
@pytest.mark.parametrize("value", [0.05, np.nan])
def test_time_stamps_out_of_order_are_refused(name: str, value: float) -> None:
    times_s = np.array(getattr(RECORDING, name))
    times_s[0, 5] = value
    with pytest.raises(InputError, match=name):
        track(make(NAMES[0]), replace(RECORDING, **{name: times_s}))
