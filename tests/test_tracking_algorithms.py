"""Every tracking algorithm against its contract, and each against known answers."""

import importlib
import inspect
import pkgutil
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

import algorithms.tracking
from algorithms.tracking.control_centre import ControlCentre
from algorithms.tracking.control_oracle import ControlOracle, bilinear
from algorithms.tracking.extended_kalman_filter import ExtendedKalmanFilter
from algorithms.tracking.particle_filter import ParticleFilter
from algorithms.tracking.template import Template
from algorithms.tracking.trilateration_alone import TrilaterationAlone
from algorithms.trilateration.least_squares import LeastSquares
from positioning.errors import InputError
from positioning.filters import kalman
from positioning.model import Array, Calibration, Recording, Site, Survey, Track, Truth
from positioning.registry import class_name

FOUND = sorted(module.name for module in pkgutil.iter_modules(algorithms.tracking.__path__))
SIZE_M = np.array([6.0, 8.0])
BEACONS_M = np.array([[1.72, 0.35], [1.79, 5.63], [3.05, 2.61]])
RUNS, EPOCHS, GRID_M, DEVIATION_DB = 5, 14, 0.5, 1.0
LENGTHS = (14, 9, 14, 1, 12)
TURN_RAD, ADVANCE_M, DRIFT_RAD_PER_M = 0.05, 0.05, 0.05
SMALL: dict[str, dict[str, Any]] = {
    "particle_filter": {"particles": 200},
    "control_oracle": {"particles": 300},
}


def law_dbm(distance_m: Array) -> Array:
    """Return a falling strength with a fringe, so that some strengths have several distances."""
    return -50 - 20 * np.log10(np.maximum(distance_m, 0.1)) + 2.5 * np.sin(4 * distance_m)


def make_stack(seed: int = 3) -> tuple[Recording, Calibration, Site, Truth]:
    """Return a few runs of different length, with epochs that miss a beacon or all."""
    rng = np.random.default_rng(seed)
    before, after = rng.choice([0.0, np.pi / 2, np.pi, -np.pi / 2], (2, RUNS, EPOCHS))
    advance = rng.uniform(0.5, 1.0, (RUNS, EPOCHS))
    before[:, 0] = advance[:, 0] = after[:, 0] = 0.0
    start_heading = rng.uniform(0, 2 * np.pi, RUNS)
    heading, place = start_heading.copy(), rng.uniform(2.0, 4.0, (RUNS, 2))
    position_m = np.empty((RUNS, EPOCHS, 2))
    for epoch in range(EPOCHS):
        noise = rng.standard_normal((4, RUNS)) * (epoch > 0)
        drift = DRIFT_RAD_PER_M * advance[:, epoch] * noise[2]
        heading = heading + before[:, epoch] + TURN_RAD * noise[0]
        # Turn back to the middle rather than leave: one more commanded turn.
        middle = np.arctan2(*(SIZE_M / 2 - place).T[::-1])
        leaves = (
            np.abs(place + advance[:, epoch, None] * unit(heading) - SIZE_M / 2) > SIZE_M / 2 - 0.2
        ).any(1)
        before[:, epoch] += np.where(leaves & (epoch > 0), middle - heading, 0.0)
        heading = np.where(leaves & (epoch > 0), middle, heading)
        driven = advance[:, epoch] + ADVANCE_M * noise[1]
        place = place + driven[:, None] * unit(heading + drift / 2)
        heading = heading + drift + after[:, epoch] + TURN_RAD * noise[3]
        position_m[:, epoch] = place
    nodes = (SIZE_M / GRID_M).astype(int) + 1
    offset_dbm = rng.normal(0, 1.0, (RUNS, *nodes, 3))
    axes = [np.arange(n) * GRID_M for n in nodes]
    field = np.stack(
        [RegularGridInterpolator(axes, offset_dbm[r])(np.clip(position_m[r], 0, SIZE_M)) for r in range(RUNS)]
    )
    distance_m = np.linalg.norm(position_m[:, :, None] - BEACONS_M, axis=-1)
    rss_dbm = law_dbm(distance_m) + field + DEVIATION_DB * rng.standard_normal(distance_m.shape)
    rss_dbm[0, 0] = np.nan
    rss_dbm[0, 3, 1] = np.nan
    rss_dbm[1, 5:7] = np.nan
    rss_dbm[2, 2] = -200.0
    time_s = np.tile(3.0 * np.arange(EPOCHS), (RUNS, 1))
    ended = np.arange(EPOCHS) >= np.array(LENGTHS)[:, None]
    for values in (time_s, before, advance, after, rss_dbm, position_m):
        values[ended] = np.nan
    calibration_m = np.tile(np.arange(0.25, 9.0, 0.25), (RUNS, 1))
    law_m = np.tile(np.arange(0.0, 12.0, 0.05), (RUNS, 1))
    return (
        Recording(
            time_s=time_s,
            rss_dbm=rss_dbm,
            turn_before_rad=before,
            advance_m=advance,
            turn_after_rad=after,
            start_heading_rad=start_heading,
        ),
        Calibration(distance_m=calibration_m, rss_dbm=law_dbm(calibration_m)),
        Site(
            corner_m=np.tile([[0.0, 0.0], SIZE_M], (RUNS, 1, 1)),
            access_point_m=np.tile(BEACONS_M, (RUNS, 1, 1)),
        ),
        Truth(
            position_m=position_m,
            law_distance_m=law_m,
            law_dbm=law_dbm(law_m),
            offset_dbm=offset_dbm,
            grid_m=np.full(RUNS, GRID_M),
            deviation_db=np.full(RUNS, DEVIATION_DB),
            turn_noise_rad=np.full(RUNS, TURN_RAD),
            advance_noise_m=np.full(RUNS, ADVANCE_M),
            drift_noise_rad_per_m=np.full(RUNS, DRIFT_RAD_PER_M),
        ),
    )


def unit(heading_rad: Array) -> Array:
    """Return unit vectors."""
    return np.stack([np.cos(heading_rad), np.sin(heading_rad)], axis=-1)


RECORDING, CALIBRATION, SITE, TRUTH = make_stack()
ENDED = np.isnan(RECORDING.time_s)


def algorithm_class(name: str) -> Any:
    """Return the class of an algorithm's file."""
    return getattr(importlib.import_module(f"algorithms.tracking.{name}"), class_name(name))


def make(name: str, truth: Truth = TRUTH, **changes: Any) -> Any:
    """Return an algorithm as the runner would make it, but smaller."""
    cls = algorithm_class(name)
    known = inspect.signature(cls).parameters
    return cls(**({"truth": truth} if "truth" in known else {}) | SMALL.get(name, {}) | changes)


def rngs(count: int = RUNS) -> list[np.random.Generator]:
    """Return fresh generators."""
    return [np.random.default_rng([8, n]) for n in range(count)]


def track(
    algorithm: Any, recording: Recording = RECORDING, site: Site = SITE, survey: Any = CALIBRATION
) -> Track:
    """Track a stack, at once where the algorithm can."""
    if hasattr(algorithm, "track_stack"):
        return algorithm.track_stack(recording, survey, site, rngs(len(recording.time_s)))  # type: ignore[no-any-return]
    tracks = [one(algorithm, index) for index in range(len(recording.time_s))]
    longest = recording.time_s.shape[1]

    def fill(values: Any) -> Array:
        rest = np.full((longest - len(values), *np.shape(values)[1:]), np.nan)
        return np.concatenate([np.asarray(values, dtype=float), rest])

    return Track(
        time_s=recording.time_s,
        position_m=np.stack([fill(t.position_m) for t in tracks]),
        covariance_m2=np.stack([fill(t.covariance_m2) for t in tracks]),
        extra={name: np.stack([fill(t.extra[name]) for t in tracks]) for name in tracks[0].extra},
    )


def one(algorithm: Any, index: int) -> Track:
    """Track one recording of the stack, as long as it is."""
    recording = RECORDING.at(index).until(int(np.count_nonzero(~ENDED[index])))
    return algorithm.track(recording, CALIBRATION.at(index), SITE.at(index), rngs()[index])  # type: ignore[no-any-return]


def runs_here(name: str) -> bool:
    """Tell whether an algorithm can run on beacons and distances; others have worlds of their own."""
    algorithm = make(name)
    return not (hasattr(algorithm, "skip") and algorithm.skip(RECORDING, CALIBRATION, SITE))


NAMES = [name for name in FOUND if runs_here(name)]


class Given:
    """A trilateration that looks its fixes up by number: the first of the ranges."""

    def __init__(self, position_m: Any) -> None:
        self.position_m = np.asarray(position_m, dtype=float)

    def solve(self, beacon_m: Any, range_m: Any) -> Array:
        """Return the position whose number is the first range."""
        return self.position_m[np.rint(np.asarray(range_m)[..., 0]).astype(int) - 1]


def given_fixes(fixes: list[Any], **motion: Any) -> tuple[Recording, Site, Given]:
    """Return a recording of one run whose epochs have these fixes, None for none."""
    epochs = len(fixes)
    number = np.array([np.nan if fix is None else n + 1.0 for n, fix in enumerate(fixes)])
    solver = Given([(np.nan, np.nan) if fix is None else fix for fix in fixes])
    recording = Recording(
        time_s=np.arange(epochs, dtype=float)[None], range_m=np.tile(number[:, None], (1, 1, 3)), **motion
    )
    return recording, SITE.at(slice(0, 1)), solver  # type: ignore[arg-type]


# The contract


def test_all_algorithms_of_the_study_are_found() -> None:
    assert set(NAMES) >= {
        *("control_centre", "control_oracle", "extended_kalman_filter", "particle_filter", "template"),
        "trilateration_alone",
    }


@pytest.mark.parametrize("name", FOUND)
def test_parameters_are_keywords_documented_and_stored_unchanged(name: str) -> None:
    cls = algorithm_class(name)
    text = inspect.getdoc(cls) or ""
    algorithm = make(name)
    for parameter in inspect.signature(cls).parameters.values():
        assert parameter.kind is inspect.Parameter.KEYWORD_ONLY
        assert parameter.default is not inspect.Parameter.empty
        names = [word for line in text.splitlines() if line[:1].isalpha() for word in line.split(", ")]
        assert parameter.name in names, parameter.name
        assert hasattr(algorithm, parameter.name)
    before = dict(vars(algorithm))
    if name in NAMES:
        track(algorithm)
    assert all(getattr(algorithm, key) is value for key, value in before.items())


@pytest.mark.parametrize("name", FOUND)
def test_truth_is_for_controls_only(name: str) -> None:
    assert name.startswith("control_") or "truth" not in inspect.signature(algorithm_class(name)).parameters


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_finite_and_of_the_right_shape_until_the_end(name: str) -> None:
    found = track(make(name))
    assert found.position_m.shape == (RUNS, EPOCHS, 2)
    assert found.covariance_m2.shape == (RUNS, EPOCHS, 2, 2)
    np.testing.assert_array_equal(found.time_s, RECORDING.time_s)
    for values in (found.position_m, found.covariance_m2, *found.extra.values()):
        assert np.isfinite(values[~ENDED]).all()
        assert np.isnan(np.asarray(values, dtype=float)[ENDED]).all()


@pytest.mark.parametrize("name", NAMES)
def test_covariances_are_symmetric_and_positive_semi_definite(name: str) -> None:
    covariance = track(make(name)).covariance_m2[~ENDED]
    np.testing.assert_array_equal(covariance, np.swapaxes(covariance, -1, -2))
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("name", NAMES)
def test_a_stack_gives_exactly_what_each_recording_gives(name: str) -> None:
    together = track(make(name))
    for index, length in enumerate(LENGTHS):
        alone = one(make(name, truth=TRUTH.at(index)), index)
        np.testing.assert_array_equal(alone.position_m, together.position_m[index, :length])
        np.testing.assert_array_equal(alone.covariance_m2, together.covariance_m2[index, :length])
        assert set(alone.extra) == set(together.extra)
        for key, values in alone.extra.items():
            np.testing.assert_array_equal(values, together.extra[key][index, :length])


@pytest.mark.parametrize("fusion", ["product", "least_residual"])
@pytest.mark.parametrize("motion", [True, False])
def test_a_stack_gives_what_each_gives_in_every_variant(
    fusion: str, motion: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not motion:
        still = replace(RECORDING, turn_before_rad=None, advance_m=None, turn_after_rad=None)
        monkeypatch.setattr(f"{__name__}.RECORDING", still)
    for name, changes in (("particle_filter", {"fusion": fusion}), ("extended_kalman_filter", {})):
        together = track(make(name, **changes), RECORDING)
        for index, length in enumerate(LENGTHS):
            alone = one(make(name, **changes), index)
            np.testing.assert_array_equal(alone.position_m, together.position_m[index, :length])


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_repeatable_and_leave_global_random_state_alone(name: str) -> None:
    state = np.random.get_state()  # noqa: NPY002
    first, second = track(make(name)), track(make(name))
    np.testing.assert_array_equal(first.position_m, second.position_m)
    for old, new in zip(state, np.random.get_state(), strict=True):  # noqa: NPY002
        np.testing.assert_array_equal(old, new)


@pytest.mark.parametrize("name", NAMES)
def test_inputs_are_left_unchanged(name: str) -> None:
    kept = make_stack()
    track(make(name))
    for part, copy in zip((RECORDING, CALIBRATION, SITE, TRUTH), kept, strict=True):
        for field, values in part.to_arrays().items():
            np.testing.assert_array_equal(values, copy.to_arrays()[field])


@pytest.mark.parametrize("name", [n for n in NAMES if n != "template"])
def test_later_epochs_leave_no_trace(name: str) -> None:
    # Trackers filter: what comes later does not change what was said before.
    assert RECORDING.rss_dbm is not None
    rss_dbm = RECORDING.rss_dbm.copy()
    rss_dbm[:, 8:] = np.nan
    first, second = track(make(name)), track(make(name), replace(RECORDING, rss_dbm=rss_dbm))
    np.testing.assert_array_equal(first.position_m[:, :8], second.position_m[:, :8])


@pytest.mark.parametrize("name", [n for n in NAMES if n != "control_centre"])
def test_errors_are_below_those_of_the_centre(name: str) -> None:
    def error_m(found: Track) -> float:
        return float(np.nanmean(np.linalg.norm(found.position_m - TRUTH.position_m, axis=-1)))

    assert error_m(track(make(name))) < 0.85 * error_m(track(ControlCentre()))


@pytest.mark.parametrize("name", NAMES)
def test_silence_everywhere_gives_finite_positions(name: str) -> None:
    silent = replace(RECORDING, rss_dbm=np.full((RUNS, EPOCHS, 3), np.nan))
    algorithm = make(name)
    if hasattr(algorithm, "track_stack"):
        assert np.isfinite(track(algorithm, silent).position_m[~ENDED]).all()
    else:
        alone = algorithm.track(silent.at(0), CALIBRATION.at(0), SITE.at(0), rngs()[0])
        np.testing.assert_array_equal(alone.position_m, np.tile(SIZE_M / 2, (EPOCHS, 1)))


@pytest.mark.parametrize("name", NAMES)
def test_skip_gives_no_reason_here(name: str) -> None:
    skip = getattr(make(name), "skip", None)
    assert skip is None or skip(RECORDING, CALIBRATION, SITE) == ""


def test_skip_names_what_is_missing() -> None:
    no_heading = replace(RECORDING, start_heading_rad=None)
    for cls in (ParticleFilter, ExtendedKalmanFilter, TrilaterationAlone, Template):
        algorithm = cls()
        assert "beacons are not known" in algorithm.skip(
            RECORDING, CALIBRATION, replace(SITE, access_point_m=None)
        )
        assert "three beacons" in algorithm.skip(
            RECORDING, CALIBRATION, replace(SITE, access_point_m=np.zeros((RUNS, 2, 2)))
        )
        assert "calibration" in algorithm.skip(RECORDING, None, SITE)
        survey = Survey(rss_dbm=np.zeros((RUNS, 4, 3)), position_m=np.zeros((RUNS, 4, 2)))
        assert "calibration" in algorithm.skip(RECORDING, survey, SITE)
        ranged = replace(RECORDING, rss_dbm=None, range_m=np.ones((RUNS, EPOCHS, 3)))
        assert algorithm.skip(ranged, None, SITE) == ""
    for cls in (ParticleFilter, ExtendedKalmanFilter):
        assert "heading" in cls(heading_known=True).skip(no_heading, CALIBRATION, SITE)
        with pytest.raises(InputError, match="start_heading_rad"):
            track(cls(heading_known=True), no_heading)
    assert "synthetic" in ControlOracle().skip(RECORDING, CALIBRATION, SITE)
    no_law = Truth(position_m=TRUTH.position_m)
    assert "synthetic" in ControlOracle(truth=no_law).skip(RECORDING, CALIBRATION, SITE)
    assert "motion" in ControlOracle(truth=TRUTH).skip(no_heading, CALIBRATION, SITE)
    with pytest.raises(InputError, match="true radio law"):
        track(ControlOracle(truth=no_law))


def changed(name: str, where: Any, value: float) -> Recording:
    """Return the recording with one value changed."""
    values = np.array(getattr(RECORDING, name))
    values[where] = value
    return replace(RECORDING, **{name: values})


@pytest.mark.parametrize("name", [n for n in NAMES if n != "template"])
@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda: (replace(RECORDING, time_s=np.full((RUNS, EPOCHS), np.nan)), SITE), "no epoch"),
        (lambda: (replace(RECORDING, time_s=np.zeros((RUNS, 0))), SITE), "no epochs"),
        (lambda: (changed("time_s", (1, 3), np.nan), SITE), r"time_s\[1, 3\].*missing"),
        (lambda: (changed("time_s", (1, 3), np.inf), SITE), r"time_s\[1, 3\].*infinite"),
        (lambda: (changed("advance_m", (0, 5), np.nan), SITE), r"advance_m\[0, 5\].*finite"),
        (lambda: (changed("rss_dbm", (0, 5, 1), np.inf), SITE), r"rss_dbm\[0, 5, 1\].*infinite"),
        (lambda: (replace(RECORDING, advance_m=None), SITE), "rest of the motion"),
        (lambda: (replace(RECORDING, rss_dbm=np.zeros((RUNS, EPOCHS, 2))), SITE), "rss_dbm: its shape"),
        (lambda: (RECORDING, replace(SITE, corner_m=SITE.corner_m[:, ::-1])), "no area"),
        (lambda: (RECORDING, replace(SITE, corner_m=np.full((RUNS, 2, 2), np.nan))), "no area"),
    ],
)
def test_recordings_that_cannot_be_used_are_refused(
    name: str, spoil: Callable[[], tuple[Recording, Site]], message: str
) -> None:
    recording, site = spoil()
    with pytest.raises(InputError, match=message):
        track(make(name), recording, site)


@pytest.mark.parametrize("name", ["particle_filter", "extended_kalman_filter", "control_oracle"])
@pytest.mark.parametrize("time_s", [9.0, 3.0])
def test_filters_refuse_times_that_do_not_increase(name: str, time_s: float) -> None:
    with pytest.raises(InputError, match=r"time_s\[0, 4\].*does not increase"):
        track(make(name), changed("time_s", (0, 4), time_s))


@pytest.mark.parametrize("name", ["particle_filter", "extended_kalman_filter", "trilateration_alone"])
def test_sites_without_beacons_are_refused(name: str) -> None:
    with pytest.raises(InputError, match="beacons are not known"):
        track(make(name), site=replace(SITE, access_point_m=None))
    with pytest.raises(InputError, match="finite"):
        track(make(name), site=replace(SITE, access_point_m=np.full((RUNS, 3, 2), np.nan)))
    with pytest.raises(InputError, match="calibration"):
        track(make(name), survey=None)
    lying = np.tile([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], (RUNS, 1, 1))
    with pytest.raises(InputError, match="line"):
        track(make(name), site=replace(SITE, access_point_m=lying))


@pytest.mark.parametrize(
    ("cls", "parameter", "value"),
    [
        (ParticleFilter, "particles", 0),
        (ParticleFilter, "fusion", "mean"),
        (ParticleFilter, "sigma_m", 0.0),
        (ParticleFilter, "resample_below", 1.5),
        (ParticleFilter, "turn_noise_rad", -0.1),
        (ParticleFilter, "advance_noise_m", float("nan")),
        (ParticleFilter, "walk_m_per_s", -1.0),
        (ExtendedKalmanFilter, "headings", 0),
        (ExtendedKalmanFilter, "sigma_m", -1.0),
        (ExtendedKalmanFilter, "drift_noise_rad_per_m", -1.0),
        (ExtendedKalmanFilter, "true_fix_share", 1.0),
        (Template, "memory_epochs", 0.0),
    ],
)
def test_senseless_settings_are_refused(cls: Any, parameter: str, value: Any) -> None:
    with pytest.raises(InputError, match=parameter):
        track(cls(**{parameter: value}))


# Known answers


def test_trilateration_alone_holds_the_last_fix() -> None:
    recording, site, solver = given_fixes([None, (1.0, 2.0), None, None, (3.0, 4.0)])
    found = track(TrilaterationAlone(trilateration=solver), recording, site)
    expected = [SIZE_M / 2, (1, 2), (1, 2), (1, 2), (3, 4)]
    np.testing.assert_array_equal(found.position_m[0], expected)
    np.testing.assert_array_equal(found.extra["fixes"][0], [0, 1, 0, 0, 1])
    np.testing.assert_allclose(found.covariance_m2[0, 0], np.diag(SIZE_M**2 / 12))
    # One fix: no spread, but a residual.
    distance_m = np.linalg.norm(BEACONS_M - [1.0, 2.0], axis=1)
    residual2 = np.mean((2.0 - distance_m) ** 2)
    np.testing.assert_allclose(found.covariance_m2[0, 2], (residual2 + 0.01) * np.eye(2))


def test_static_places_are_located_one_by_one() -> None:
    recording, site, solver = given_fixes([(1.0, 2.0), None, (3.0, 4.0)])
    static = replace(recording, time_s=np.zeros((1, 3)))
    assert not TrilaterationAlone.needs_order
    found = track(TrilaterationAlone(trilateration=solver), static, site)
    np.testing.assert_array_equal(found.position_m[0], [(1, 2), SIZE_M / 2, (3, 4)])
    np.testing.assert_array_equal(track(ControlCentre(), static, site).position_m[0, 1], SIZE_M / 2)


def test_trilateration_alone_takes_the_least_residual_of_all_triplets() -> None:
    true_m = np.array([2.3, 4.1])
    distance_m = np.linalg.norm(BEACONS_M - true_m, axis=1)
    rss_dbm = law_dbm(distance_m)[None, None]
    recording = Recording(time_s=np.zeros((1, 1)), rss_dbm=rss_dbm)
    fine_m = np.arange(0.25, 9.0, 0.01)[None]
    found = track(
        TrilaterationAlone(trilateration=LeastSquares()),
        recording,
        SITE.at(slice(0, 1)),  # type: ignore[arg-type]
        Calibration(distance_m=fine_m, rss_dbm=law_dbm(fine_m)),
    )
    assert found.extra["fixes"][0, 0] > 1
    np.testing.assert_allclose(found.position_m[0, 0], true_m, atol=0.02)
    # The other triplets say how sure that is.
    assert np.trace(found.covariance_m2[0, 0]) > 0.02


def test_the_centre_and_the_variance_of_a_uniform_place() -> None:
    found = track(ControlCentre())
    np.testing.assert_array_equal(found.position_m[~ENDED], np.tile([3.0, 4.0], (sum(LENGTHS), 1)))
    sample = np.random.default_rng(0).uniform(0, SIZE_M, (200_000, 2))
    np.testing.assert_allclose(np.cov(sample.T), found.covariance_m2[0, 0], atol=0.05)


def drive(fixes: list[Any], advance_m: float = 0.5) -> tuple[Recording, Site, Given]:
    """Return a drive straight on along x."""
    epochs = len(fixes)
    motion = {
        "turn_before_rad": np.zeros((1, epochs)),
        "advance_m": np.where(np.arange(epochs) > 0, advance_m, 0.0)[None],
        "turn_after_rad": np.zeros((1, epochs)),
        "start_heading_rad": np.zeros(1),
    }
    return given_fixes(fixes, **motion)


def test_without_a_fix_filters_only_predict() -> None:
    recording, site, solver = drive([None] * 5)
    for algorithm in (
        ParticleFilter(particles=40_000, heading_known=True, trilateration=solver),
        ExtendedKalmanFilter(heading_known=True, trilateration=solver),
    ):
        found = track(algorithm, recording, site)
        expected = SIZE_M / 2 + np.arange(5)[:, None] * [0.5, 0.0]
        np.testing.assert_allclose(found.position_m[0], expected, atol=0.06)
        np.testing.assert_allclose(found.covariance_m2[0, 0], np.diag(SIZE_M**2 / 12), atol=0.1)
        assert found.covariance_m2[0, -1, 0, 0] > found.covariance_m2[0, 0, 0, 0] - 0.1
    assert (
        track(ParticleFilter(trilateration=solver), recording, site).extra["effective_sample_size"] > 499
    ).all()


def test_with_one_fix_an_epoch_both_filters_agree() -> None:
    rng = np.random.default_rng(4)
    true_m = np.column_stack([1 + 0.5 * np.arange(8), np.full(8, 3.0)])
    recording, site, solver = drive(list(true_m + 0.3 * rng.standard_normal((8, 2))))
    particles = track(
        ParticleFilter(particles=40_000, sigma_m=0.3, heading_known=True, trilateration=solver),
        recording,
        site,
    )
    gaussian = track(
        ExtendedKalmanFilter(sigma_m=0.3, heading_known=True, true_fix_share=1 - 1e-6, trilateration=solver),
        recording,
        site,
    )
    # At first one starts uniform, the other Gaussian.
    np.testing.assert_allclose(particles.position_m[0, 2:], gaussian.position_m[0, 2:], atol=0.03)
    np.testing.assert_allclose(particles.covariance_m2[0, 2:], gaussian.covariance_m2[0, 2:], atol=0.004)
    error_m = gaussian.position_m[0, -1] - true_m[-1]
    # 99 % of the chi-squared distribution with two degrees of freedom.
    assert error_m @ np.linalg.solve(gaussian.covariance_m2[0, -1], error_m) < 9.2


def test_errors_of_the_bank_are_as_large_as_its_covariance_says() -> None:
    # Many drives by the model itself, each with one good fix an epoch and a known start heading.
    rng, drives, epochs, sigma_m = np.random.default_rng(6), 300, 8, 0.3
    place, heading = rng.uniform(1, 5, (drives, 2)), np.zeros(drives)
    advance = np.where(np.arange(epochs) > 0, 0.5, 0.0)
    fixes, true_m = [], []
    for epoch in range(epochs):
        noise = rng.standard_normal((4, drives)) * (epoch > 0)
        drift = 0.05 * advance[epoch] * noise[2]
        heading = heading + 0.05 * noise[0]
        place = place + (advance[epoch] + 0.05 * noise[1])[:, None] * unit(heading + drift / 2)
        heading = heading + drift + 0.05 * noise[3]
        true_m.append(place)
        fixes.append(place + sigma_m * rng.standard_normal((drives, 2)))
    solver = Given(np.concatenate(fixes))
    number = 1.0 + np.arange(epochs) * drives + np.arange(drives)[:, None]
    still = np.zeros((drives, epochs))
    recording = Recording(
        time_s=np.tile(np.arange(float(epochs)), (drives, 1)),
        range_m=np.repeat(number[..., None], 3, axis=-1),
        turn_before_rad=still,
        advance_m=np.tile(advance, (drives, 1)),
        turn_after_rad=still,
        start_heading_rad=np.zeros(drives),
    )
    site = Site(
        corner_m=np.tile([[0.0, 0.0], SIZE_M], (drives, 1, 1)),
        access_point_m=np.tile(BEACONS_M, (drives, 1, 1)),
    )
    shown = {"sigma_m": sigma_m, "heading_known": True, "trilateration": solver}
    for algorithm in (
        ExtendedKalmanFilter(true_fix_share=1 - 1e-6, **shown),
        ParticleFilter(particles=2000, **shown),
    ):
        found = track(algorithm, recording, site)
        error_m = found.position_m - np.stack(true_m, axis=1)
        inverse = np.linalg.inv(found.covariance_m2)
        nees = np.einsum("rni,rnij,rnj->rn", error_m, inverse, error_m)[:, 2:]
        # Each row's mean is 2; five standard errors of rows, and what linearisation and samples add.
        assert nees.mean() == pytest.approx(2.0, abs=5 * nees.mean(axis=1).std() / np.sqrt(drives) + 0.1)


def test_an_unknown_heading_is_found_by_driving() -> None:
    heading_rad = 2.2
    true_m = np.array([4.0, 2.0]) + 0.5 * np.arange(8)[:, None] * unit(np.array(heading_rad))
    recording, site, solver = drive([*true_m[:6], None, None])
    for cls, changes in ((ParticleFilter, {"particles": 3000}), (ExtendedKalmanFilter, {})):
        found = track(cls(sigma_m=0.2, trilateration=solver, **changes), recording, site)
        # The last two epochs have no fix: without the heading they would go anywhere.
        assert np.linalg.norm(found.position_m[0, -1] - true_m[-1]) < 0.35
        wrong = track(cls(sigma_m=0.2, heading_known=True, trilateration=solver, **changes), recording, site)
        assert np.linalg.norm(wrong.position_m[0, -1] - true_m[-1]) > 0.5


def test_filters_ignore_an_outlier() -> None:
    true_m = np.column_stack([1 + 0.4 * np.arange(9), np.full(9, 3.0)])
    fixes = list(true_m)
    fixes[6] = np.array([5.8, 7.9])
    recording, site, solver = drive(fixes, advance_m=0.4)
    for cls in (ParticleFilter, ExtendedKalmanFilter):
        found = track(cls(sigma_m=0.3, heading_known=True, trilateration=solver), recording, site)
        assert np.linalg.norm(found.position_m[0, 6] - true_m[6]) < (1.0 if cls is ParticleFilter else 0.1)


def test_a_random_walk_widens_with_time() -> None:
    fixes = [(3.0, 4.0), None, None]
    recording, site, solver = given_fixes(fixes)
    recording = replace(recording, time_s=np.array([[0.0, 1.0, 5.0]]))
    for algorithm in (
        ParticleFilter(particles=60_000, sigma_m=0.2, walk_m_per_s=0.5, trilateration=solver),
        ExtendedKalmanFilter(sigma_m=0.2, walk_m_per_s=0.5, true_fix_share=1 - 1e-9, trilateration=solver),
    ):
        variance = track(algorithm, recording, site).covariance_m2[0, :, 0, 0]
        np.testing.assert_allclose(np.diff(variance), [0.25, 1.0], rtol=0.1)


def test_the_bank_is_a_kalman_filter_where_all_is_linear() -> None:
    rng = np.random.default_rng(5)
    fixes = [np.array([3.0, 4.0]) + rng.standard_normal(2) for _ in range(6)]
    recording, site, solver = given_fixes(fixes)
    found = track(
        ExtendedKalmanFilter(true_fix_share=1 - 1e-9, walk_m_per_s=0.4, trilateration=solver), recording, site
    )
    mean, covariance = SIZE_M / 2, np.diag(SIZE_M**2 / 12)
    for epoch, fix in enumerate(fixes):
        if epoch:
            mean, covariance = kalman.predict(mean, covariance, np.eye(2), 0.16 * np.eye(2))
        mean, covariance, *_ = kalman.update(mean, covariance, fix - mean, np.eye(2), np.eye(2))
        np.testing.assert_allclose(found.position_m[0, epoch], mean, atol=1e-6)
        np.testing.assert_allclose(found.covariance_m2[0, epoch], covariance, atol=1e-6)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10_000))
def test_bilinear_equals_the_interpolator_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    field = rng.normal(size=(2, 13, 17, 3))
    site = Site(corner_m=np.array([[[0.0, 0.0], SIZE_M], [[-1.0, 2.0], [5.0, 10.0]]]))
    place = rng.uniform(-0.5, 1.05 * SIZE_M, (2, 40, 2))
    place[:, 0] = SIZE_M
    found = bilinear(place + site.corner_m[:, None, 0], np.array([0, 1]), field, site, np.full(2, 0.5))
    axes = [np.arange(13) * 0.5, np.arange(17) * 0.5]
    for row in range(2):
        expected = RegularGridInterpolator(axes, field[row])(np.clip(place[row], 0, SIZE_M))
        for beacon in range(3):
            np.testing.assert_allclose(found[beacon][row], expected[:, beacon], atol=1e-9)


def test_the_oracle_is_much_better_than_the_fixes() -> None:
    def error_m(found: Track) -> float:
        return float(np.nanmean(np.linalg.norm(found.position_m - TRUTH.position_m, axis=-1)[:, 3:]))

    oracle = error_m(track(ControlOracle(truth=TRUTH)))
    assert oracle < 0.4
    assert oracle < 0.6 * min(error_m(track(ParticleFilter())), error_m(track(TrilaterationAlone())))


def test_the_oracle_without_noise_stays_on_the_place() -> None:
    exact = replace(
        TRUTH,
        offset_dbm=np.zeros_like(TRUTH.offset_dbm),
        deviation_db=np.full(RUNS, 0.5),
    )
    distance_m = np.linalg.norm(TRUTH.position_m[:, :, None] - BEACONS_M, axis=-1)
    found = track(ControlOracle(truth=exact), replace(RECORDING, rss_dbm=law_dbm(distance_m)))
    error_m = np.linalg.norm(found.position_m - TRUTH.position_m, axis=-1)
    assert np.nanmean(error_m[:, 4:]) < 0.12


def test_the_oracle_of_other_worlds_is_refused() -> None:
    with pytest.raises(InputError, match=r"truth.offset_dbm"):
        track(ControlOracle(truth=replace(TRUTH, offset_dbm=np.zeros((RUNS, 3, 3, 2)))))


def test_the_template_forgets() -> None:
    recording, site, solver = given_fixes([None, (1.0, 1.0), (3.0, 1.0), None])
    found = Template(memory_epochs=2.0, trilateration=solver).track(
        recording.at(0), None, site.at(0), np.random.default_rng(0)
    )
    fade = np.exp(-0.5)
    latest = (fade * np.array([1.0, 1.0]) + [3.0, 1.0]) / (1 + fade)
    np.testing.assert_allclose(found.position_m, [SIZE_M / 2, (1, 1), latest, latest])
