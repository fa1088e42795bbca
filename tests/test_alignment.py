"""The runner of alignment, what it is given, how it is scored, and the contract of every algorithm."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from positioning.errors import InputError
from positioning.geometry import rigid_fit, rotated
from positioning.model import Aligned, Truth, Walks
from positioning.registry import class_name
from positioning.seeds import stream
from positioning.tasks import alignment
from positioning.walks import check_walks, motion

FOLDER = Path(__file__).parents[1] / "algorithms/alignment"
NAMES = sorted(path.stem for path in FOLDER.glob("[a-z]*.py"))
angles = st.floats(-3.1, 3.1)
lengths = st.floats(-50, 50)


def drawn(seed: int = 0, poses: int = 60, access_points: int = 12) -> tuple[Walks, Truth]:
    """Three walks round the same ring in a field of smooth levels; the second one ends early."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 4 * np.pi, poses) + rng.uniform(0, 6, (3, 1))
    path_m = 15 * np.stack([np.cos(angle), 0.6 * np.sin(angle)], axis=-1)
    step = np.gradient(path_m, axis=1)
    heading_rad = np.unwrap(np.arctan2(step[..., 1], step[..., 0]), axis=-1)
    place_m = rng.uniform(-20, 20, (access_points, 2))
    distance_m = np.linalg.norm(path_m[:, :, None] - place_m, axis=-1)
    rss_dbm = np.rint(-40 - 30 * np.log10(1 + distance_m) + rng.normal(0, 1.5, distance_m.shape))
    rss_dbm[rss_dbm < -85] = np.nan
    time_s = np.tile(2.0 * np.arange(poses), (3, 1))
    # Dead reckoning: the truth in the frame of the first pose, turned by an unknown angle.
    turn = rng.uniform(-2, 2, (3, 1)) - heading_rad[:, :1]
    own_m = rotated(path_m - path_m[:, :1], turn) + np.cumsum(rng.normal(0, 0.02, path_m.shape), axis=1)
    own_m[:, 0] = 0
    end = np.arange(poses) >= poses - 7
    dead = np.zeros((3, poses), dtype=bool)
    dead[1] = end
    cut = {
        "time_s": np.where(dead, np.nan, time_s),
        "position_m": np.where(dead[..., None], np.nan, own_m),
        "heading_rad": np.where(dead, np.nan, heading_rad + turn),
        "rss_dbm": np.where(dead[..., None], np.nan, rss_dbm),
    }
    true_m = np.where(dead[..., None], np.nan, path_m)
    asked_m = np.where(np.arange(poses)[:, None] % 10 == 0, true_m, np.nan)
    return Walks(**cut), Truth(
        position_m=asked_m, path_m=true_m, heading_rad=np.where(dead, np.nan, heading_rad)
    )


def made(name: str, truth: Truth | None = None):
    cls = getattr(importlib.import_module(f"algorithms.alignment.{name}"), class_name(name))
    return cls(truth=truth) if name.startswith("control_") and name != "control_centre" else cls()


def stacked(count: int = 2) -> tuple[dict, dict]:
    pairs = [drawn(seed) for seed in range(count)]
    observed = [walks.to_arrays() for walks, _ in pairs]
    truth = [truth.to_arrays() for _, truth in pairs]
    return tuple(
        {name: np.stack([part[name] for part in parts]) for name in parts[0]} for parts in (observed, truth)
    )


# Every algorithm


@pytest.mark.parametrize("name", NAMES)
def test_the_contract_of_alignment(name: str) -> None:
    walks, truth = drawn()
    algorithm = made(name, truth)
    if hasattr(algorithm, "skip") and algorithm.skip(walks):
        pytest.skip(algorithm.skip(walks))
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    first = algorithm.align(walks, np.random.default_rng(3))
    again = made(name, truth).align(walks, np.random.default_rng(3))
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.testing.assert_array_equal(first.position_m, again.position_m)
    np.testing.assert_array_equal(first.heading_rad, again.heading_rad)
    there = ~np.isnan(walks.time_s)
    assert first.position_m.shape == (*there.shape, 2)
    np.testing.assert_array_equal(np.isfinite(first.position_m).all(axis=-1), there)
    np.testing.assert_array_equal(np.isfinite(first.heading_rad), there)


# These take the frames of dead reckoning as they are.
FRAMED = ("dead_reckoning", "template", "graph_slam")


@pytest.mark.parametrize("name", [n for n in NAMES if not n.startswith("control_") and n not in FRAMED])
def test_the_answer_does_not_depend_on_the_frames_of_the_walks(name: str) -> None:
    """A turned frame of dead reckoning is the same walk: what is aligned has the same shape."""
    walks, _ = drawn()
    algorithm = made(name)
    if hasattr(algorithm, "skip") and algorithm.skip(walks):
        pytest.skip(algorithm.skip(walks))
    turned = Walks(
        time_s=walks.time_s,
        position_m=rotated(walks.position_m, np.array([[0.0], [1.0], [-2.0]])),
        heading_rad=walks.heading_rad + np.array([[0.0], [1.0], [-2.0]]),
        rss_dbm=walks.rss_dbm,
    )
    there = ~np.isnan(walks.time_s)
    found = algorithm.align(walks, np.random.default_rng(3)).position_m[there]
    other = made(name).align(turned, np.random.default_rng(3)).position_m[there]
    angle, shift = rigid_fit(other, found)
    np.testing.assert_allclose(rotated(other, angle) + shift, found, atol=0.05)


# Runner and score


def test_the_runner_gives_every_world_its_own_answer() -> None:
    observed, _ = stacked()
    made_of = {}

    class Marked:
        def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
            return Aligned(
                walks.position_m + rng.uniform(), walks.heading_rad, {"draw": np.array([rng.uniform()])}
            )

    outcome = alignment.run(Marked, observed, None, {}, [stream(i, "a") for i in range(2)])
    for index in range(2):
        rng = stream(index, "a")
        made_of[index] = observed["walks.position_m"][index] + rng.uniform()
        np.testing.assert_array_equal(outcome.estimates["position_m"][index], made_of[index])
        assert outcome.estimates["extra_draw"][index] == [rng.uniform()]
    assert outcome.seconds.shape == (2,)


def test_without_walks_nothing_runs() -> None:
    assert "no walks" in alignment.run(Aligned, {}, None, {}, []).skipped


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda p, h: (p[:, :-1], h), ["position_m", "shape", "Correct the algorithm"]),
        (lambda p, h: (p, h * np.nan), ["heading_rad[walk 0, pose 0]", "not finite"]),
        (lambda p, h: ([[1, 2], [3]], h), ["position_m", "no array"]),
        (lambda p, h: (p, h, 3), ["extra", "int", "dict"]),
    ],
)
def test_a_wrong_answer_is_refused(change, words) -> None:
    observed, _ = stacked(1)

    class Wrong:
        def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
            return Aligned(*change(walks.position_m, walks.heading_rad))

    with pytest.raises(InputError) as error:
        alignment.run(Wrong, observed, None, {}, [stream(0, "a")])
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("change", "found"),
    [(lambda p, h: (p, h), "tuple"), (lambda p, h: p, "ndarray"), (lambda p, h: None, "NoneType")],
)
def test_an_answer_of_another_kind_is_told_what_is_needed(change, found: str) -> None:
    class Wrong:
        def align(self, walks: Walks, rng: np.random.Generator):
            return change(walks.position_m, walks.heading_rad)

    with pytest.raises(InputError, match=f"gave a {found}, an Aligned .* is needed.*Aligned\\(position_m="):
        alignment.run(Wrong, stacked(1)[0], None, {}, [stream(0, "a")])


def test_what_is_kept_in_one_world_is_kept_in_all() -> None:
    class Moody:
        def align(self, walks: Walks, rng: np.random.Generator) -> Aligned:
            kept = {"a": np.zeros(2)} if walks.rss_dbm[0, 0, 0] == first else {}
            return Aligned(walks.position_m, walks.heading_rad, kept)

    observed, _ = stacked()
    first = observed["walks.rss_dbm"][0, 0, 0, 0]
    assert first != observed["walks.rss_dbm"][1, 0, 0, 0]
    with pytest.raises(InputError, match=r"extra\['a'\].*every world"):
        alignment.run(Moody, observed, None, {}, [stream(0, "a"), stream(1, "a")])


@given(angle=angles, x=lengths, y=lengths)
def test_a_true_answer_in_any_frame_has_no_error(angle: float, x: float, y: float) -> None:
    _, truth = stacked(1)
    estimates = {
        "position_m": rotated(truth["truth.path_m"], angle) + np.array([x, y]),
        "heading_rad": truth["truth.heading_rad"] + angle,
    }
    columns = alignment.score(estimates, truth)
    asked = ~np.isnan(truth["truth.position_m"][..., 0]).reshape(1, -1)
    for name in ("error_m", "error_first_m"):
        np.testing.assert_array_equal(~np.isnan(columns[name]), asked)
        assert columns[name][asked].max() < 1e-9


def test_ties_of_the_frame_differ_by_where_the_error_lies() -> None:
    """A walk that misses by one metre everywhere but at its start: the fit shares it, the start does not."""
    _, truth = stacked(1)
    path_m = truth["truth.path_m"][:, :1]
    own = {"truth.path_m": path_m, "truth.heading_rad": truth["truth.heading_rad"][:, :1]}
    own["truth.position_m"] = path_m
    estimate_m = path_m + np.where(np.arange(path_m.shape[2])[:, None] > 0, [1.0, 0.0], 0.0)
    columns = alignment.score({"position_m": estimate_m, "heading_rad": own["truth.heading_rad"]}, own)
    np.testing.assert_allclose(columns["error_first_m"][0, 1:], 1.0)
    assert columns["error_m"][0, 1:].max() < 0.1


# Walks


def test_motion_leads_from_pose_to_pose() -> None:
    walks, _ = drawn()
    u = motion(walks.position_m[0], walks.heading_rad[0])
    position_m, heading_rad = walks.position_m[0, 0], walks.heading_rad[0, 0]
    for index, (forward, left, turn) in enumerate(u):
        position_m = position_m + rotated([forward, left], heading_rad)
        heading_rad = heading_rad + turn
        np.testing.assert_allclose(position_m, walks.position_m[0, index + 1], atol=1e-9)
    np.testing.assert_allclose(heading_rad, walks.heading_rad[0, -1])


@pytest.mark.parametrize(
    ("name", "place", "value", "words"),
    [
        ("time_s", (0, 4), np.nan, ["time_s[0, 4]", "NaN after the end only"]),
        ("time_s", (0, 4), 0.0, ["time_s[0, 4]", "not increase"]),
        ("time_s", 0, np.nan, ["time_s[0]", "no pose"]),
        ("position_m", (2, 3, 1), np.nan, ["position_m[2, 3]", "not a number"]),
        ("time_s", (0, slice(4, 7)), np.nan, ["time_s[0, 4]", "missing before the end"]),
        ("time_s", (0, 59), np.inf, ["time_s[0, 59]", "infinite"]),
        ("time_s", (0, 0), -np.inf, ["time_s[0, 0]", "infinite"]),
        ("heading_rad", (2, 3), np.inf, ["heading_rad[2, 3]", "not a number"]),
        ("heading_rad", (2, 3), np.nan, ["heading_rad[2, 3]", "not a number"]),
        ("heading_rad", (2, slice(3, None)), 90.0, ["heading_rad[2, 3]", "whole turn", "radians"]),
        ("rss_dbm", (1, 2, 3), np.inf, ["rss_dbm[1, 2, 3]", "Use NaN"]),
        ("rss_dbm", (1, 2, 3), 100.0, ["rss_dbm[1, 2, 3]", "below 0 dBm", "Use NaN for not heard"]),
        ("rss_dbm", (1, 2, 3), 0.0, ["rss_dbm[1, 2, 3]", "below 0 dBm", "Use NaN for not heard"]),
    ],
)
def test_walks_that_cannot_be_are_refused(name, place, value, words) -> None:
    walks, _ = drawn()
    getattr(walks, name)[place] = value
    with pytest.raises(InputError) as error:
        check_walks(walks)
    assert all(word in str(error.value) for word in words)


def test_wrapped_headings_may_jump_by_a_whole_turn() -> None:
    walks, _ = drawn()
    wrapped = np.mod(walks.heading_rad + np.pi, 2 * np.pi) - np.pi
    assert np.nanmax(np.abs(np.diff(wrapped, axis=1))) > np.pi
    check_walks(replace(walks, heading_rad=wrapped))


def test_arrays_that_do_not_fit_are_refused() -> None:
    walks, _ = drawn()
    short = Walks(
        time_s=walks.time_s,
        position_m=walks.position_m[:, :-1],
        heading_rad=walks.heading_rad,
        rss_dbm=walks.rss_dbm,
    )
    with pytest.raises(InputError, match="position_m"):
        check_walks(short)


# The fit


@given(angle=angles, x=lengths, y=lengths, seed=st.integers(0, 1000))
def test_a_moved_figure_is_found_again(angle: float, x: float, y: float, seed: int) -> None:
    point_m = np.random.default_rng(seed).normal(0, 5, (3, 7, 2))
    found, shift = rigid_fit(point_m, rotated(point_m, angle) + np.array([x, y]))
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angle), atol=1e-9)
    np.testing.assert_allclose(shift, np.broadcast_to([x, y], (3, 2)), atol=1e-8)


@given(seed=st.integers(0, 1000))
def test_the_fit_is_that_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    point_m, target_m = rng.normal(0, 5, (2, 9, 2))
    known = rng.random(9) < 0.7
    known[:2] = True
    found, shift = rigid_fit(point_m, target_m, known)
    a, b = point_m[known], target_m[known]

    def lifted(values):
        # Far points on the third axis hold the rotation to the plane.
        centred = np.c_[values - values.mean(axis=0), np.zeros(len(values))]
        return np.vstack([centred, [0, 0, 1e4]])

    rotation, _ = Rotation.align_vectors(lifted(b), lifted(a))
    np.testing.assert_allclose(
        rotated(a[0] - a.mean(axis=0), found), rotation.apply(lifted(a))[0, :2], atol=1e-4
    )
    np.testing.assert_allclose(shift + rotated(a.mean(axis=0), found), b.mean(axis=0), atol=1e-9)


def test_without_a_known_place_there_is_no_fit() -> None:
    with pytest.raises(InputError, match="no place is known"):
        rigid_fit(np.zeros((3, 2)), np.zeros((3, 2)), np.zeros(3, dtype=bool))
