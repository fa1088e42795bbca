"""The worlds of the fingerprint study: what is fixed, what is random, what is hidden."""

import numpy as np
import pytest

from positioning.errors import InputError
from positioning.geometry import wall_crossings
from positioning.seeds import stream
from positioning.simulation.fingerprint_loo import simulate

SETTINGS = {
    "points": 257,
    "access_points": 6,
    "access_point_cells": [3, 2],
    "size_m": [30.0, 25.5],
    "grid_m": 1.5,
    "corridors": 2,
    "corridor_width_m": 3.0,
    "room_m": [3.0, 7.5],
    "door_width_m": 0.9,
    "furniture_share": 0.3,
    "furniture_m": 0.9,
    "wall_slots": 96,
    "reference_dbm": -30.0,
    "path_loss_exponent": [1.8, 2.4],
    "wall_loss_db": [2.5, 4.5],
    "shadowing_db": 4.0,
    "shadowing_correlation_m": 4.0,
    "noise_db": 4.5,
    "floor_dbm": -93.0,
}


def rngs(seeds):
    return [stream(seed, "fingerprint_loo") for seed in seeds]


@pytest.fixture(scope="module")
def worlds():
    return simulate(SETTINGS, rngs(range(60)))


def test_shapes_are_fixed(worlds):
    assert {name: values.shape for name, values in worlds.observed.items()} == {
        "site.corner_m": (60, 2, 2),
        "site.access_point_m": (60, 6, 2),
        "site.wall_m": (60, 96, 2, 2),
        "survey.rss_dbm": (60, 257, 6),
        "survey.position_m": (60, 257, 2),
    }
    assert {name: values.shape for name, values in worlds.truth.items()} == {
        "truth.position_m": (60, 257, 2),
        "truth.field_dbm": (60, 257, 6),
        "truth.noise_db": (60,),
        "truth.floor_dbm": (60,),
    }


def test_places_are_different_grid_points_clear_of_walls(worlds):
    for place_m, wall_m in zip(
        worlds.observed["survey.position_m"], worlds.observed["site.wall_m"], strict=True
    ):
        assert len(np.unique(place_m, axis=0)) == 257
        np.testing.assert_allclose(place_m / 1.5 % 1, 0.5)
        assert (place_m > 0).all()
        assert (place_m < [30.0, 25.5]).all()
        present_m = wall_m[np.isfinite(wall_m).all(axis=(1, 2))]
        nearest = np.clip(place_m[:, None], present_m.min(axis=1), present_m.max(axis=1))
        assert np.linalg.norm(place_m[:, None] - nearest, axis=-1).min() > 0.74


def test_access_points_are_spread_over_the_floor(worlds):
    cell = np.floor(worlds.observed["site.access_point_m"] / [10.0, 12.75])
    np.testing.assert_array_equal(
        cell, np.broadcast_to([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]], cell.shape)
    )


def test_missing_walls_are_whole_rows_of_nan_at_the_end(worlds):
    missing = np.isnan(worlds.observed["site.wall_m"])
    np.testing.assert_array_equal(missing.any(axis=(2, 3)), missing.all(axis=(2, 3)))
    assert (np.diff(missing[:, :, 0, 0].astype(int), axis=1) >= 0).all()
    assert (~missing[:, :, 0, 0]).sum(axis=1).min() > 30


def test_worlds_differ_and_repeat_with_equal_generators(worlds):
    again = simulate(SETTINGS, rngs([3]))
    for part, repeated in zip(worlds, again, strict=True):
        for name in part:
            np.testing.assert_array_equal(part[name][3], repeated[name][0], err_msg=name)
    assert len({rss.tobytes() for rss in worlds.observed["survey.rss_dbm"]}) == 60
    assert len({wall.tobytes() for wall in worlds.observed["site.wall_m"]}) == 60


def test_a_world_does_not_depend_on_its_batch(worlds):
    for batch in ([7], [7, 1], [20, 30, 7]):
        alone = simulate(SETTINGS, rngs(batch))
        for part, other in zip(worlds, alone, strict=True):
            for name in part:
                assert part[name][7].tobytes() == other[name][batch.index(7)].tobytes(), name


def test_truth_stays_out_of_what_is_observed(worlds):
    assert not any(name.startswith("truth") for name in worlds.observed)
    field_dbm = worlds.truth["truth.field_dbm"]
    for name, values in worlds.observed.items():
        assert not np.isin(field_dbm, values).any(), name
    np.testing.assert_array_equal(worlds.observed["survey.position_m"], worlds.truth["truth.position_m"])


def test_readings_are_whole_and_above_the_floor(worlds):
    rss_dbm = worlds.observed["survey.rss_dbm"]
    heard = rss_dbm[np.isfinite(rss_dbm)]
    np.testing.assert_array_equal(heard, np.rint(heard))
    assert heard.min() >= -93.0
    # What is not heard is weak: rounding apart, at most by four and a half deviations of fading.
    assert worlds.truth["truth.field_dbm"][np.isnan(rss_dbm)].max() < -93.5 + 5 * 4.5
    assert (
        np.isnan(simulate({**SETTINGS, "floor_dbm": -60.0}, rngs([0])).observed["survey.rss_dbm"]).mean()
        > 0.2
    )


def test_fading_has_the_deviation_that_the_truth_states(worlds):
    field_dbm, rss_dbm = worlds.truth["truth.field_dbm"], worlds.observed["survey.rss_dbm"]
    fading_db = (rss_dbm - field_dbm)[field_dbm > -70.0]
    assert len(fading_db) > 20000
    np.testing.assert_allclose(fading_db.std(), np.sqrt(4.5**2 + 1 / 12), rtol=0.02)
    np.testing.assert_allclose(fading_db.mean(), 0.0, atol=0.12)
    assert (worlds.truth["truth.noise_db"] == 4.5).all()
    assert (worlds.truth["truth.floor_dbm"] == -93.0).all()


def test_noise_alone_changes_only_the_readings(worlds):
    quiet = simulate({**SETTINGS, "noise_db": 0.0, "floor_dbm": -1000.0}, rngs(range(5)))
    louder = simulate({**SETTINGS, "noise_db": 9.0, "floor_dbm": -1000.0}, rngs(range(5)))
    for name in ("site.corner_m", "site.access_point_m", "site.wall_m", "survey.position_m"):
        np.testing.assert_array_equal(quiet.observed[name], louder.observed[name])
        np.testing.assert_array_equal(quiet.observed[name], worlds.observed[name][:5])
    np.testing.assert_array_equal(quiet.truth["truth.field_dbm"], louder.truth["truth.field_dbm"])
    field_dbm = quiet.truth["truth.field_dbm"]
    np.testing.assert_array_equal(quiet.observed["survey.rss_dbm"], np.rint(field_dbm))
    # Common random numbers: twice the noise is twice the deviation, but for the rounding.
    middle = simulate({**SETTINGS, "floor_dbm": -1000.0}, rngs(range(5)))
    deviation_db = [world.observed["survey.rss_dbm"] - field_dbm for world in (middle, louder)]
    assert np.abs(2 * deviation_db[0] - deviation_db[1]).max() <= 1.5


def test_without_shadowing_the_field_is_path_loss_and_walls():
    fixed = {**SETTINGS, "path_loss_exponent": 2.0, "wall_loss_db": 3.0, "shadowing_db": 0.0}
    observed, truth = simulate(fixed, rngs([11, 12]))
    for world in range(2):
        place_m, access_point_m = observed["survey.position_m"][world], observed["site.access_point_m"][world]
        distance_m = np.linalg.norm(place_m[:, None] - access_point_m, axis=-1)
        walls = wall_crossings(place_m, access_point_m, observed["site.wall_m"][world])
        assert walls.max() >= 5
        expected = -30.0 - 20.0 * np.log10(np.maximum(distance_m, 1.0)) - 3.0 * walls
        np.testing.assert_allclose(truth["truth.field_dbm"][world], expected, rtol=1e-12)


def test_shadowing_has_its_deviation_and_falls_off_with_distance():
    bare = simulate({**SETTINGS, "shadowing_db": 0.0}, rngs(range(30)))
    full = simulate(SETTINGS, rngs(range(30)))
    shadowing_db = full.truth["truth.field_dbm"] - bare.truth["truth.field_dbm"]
    np.testing.assert_allclose(shadowing_db.std(), 4.0, rtol=0.05)
    place_m = full.observed["survey.position_m"]
    neighbours = np.abs(np.linalg.norm(place_m[:, :, None] - place_m[:, None], axis=-1) - 1.5) < 1e-6
    products = np.einsum("wna,wma->wnm", shadowing_db, shadowing_db)[neighbours] / 6
    np.testing.assert_allclose(products.mean(), 16.0 * np.exp(-1.5 / 4.0), rtol=0.1)


def test_exponent_and_wall_loss_are_drawn_for_each_world_within_their_limits():
    settings = {**SETTINGS, "shadowing_db": 0.0}
    observed, truth = simulate(settings, rngs(range(12)))
    found = []
    for world in range(12):
        place_m, access_point_m = observed["survey.position_m"][world], observed["site.access_point_m"][world]
        distance_m = np.linalg.norm(place_m[:, None] - access_point_m, axis=-1)
        walls = wall_crossings(place_m, access_point_m, observed["site.wall_m"][world])
        design = np.stack([-10 * np.log10(np.maximum(distance_m, 1.0)).ravel(), -walls.ravel()], axis=1)
        found.append(np.linalg.lstsq(design, truth["truth.field_dbm"][world].ravel() + 30.0)[0])
    exponent, wall_loss_db = np.array(found).T
    assert 1.8 <= exponent.min() < exponent.max() <= 2.4
    assert np.ptp(exponent) > 0.2
    assert 2.5 <= wall_loss_db.min() < wall_loss_db.max() <= 4.5
    assert np.ptp(wall_loss_db) > 0.6


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_every_setting_is_needed_and_named_when_missing(name):
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("noise_db", -1.0),
        ("noise_db", "4"),
        ("noise_db", float("nan")),
        ("noise_db", True),
        ("points", 256.5),
        ("points", 1),
        ("size_m", 30.0),
        ("size_m", "ab"),
        ("size_m", [30.0, 25.5, 3.0]),
        ("path_loss_exponent", [2.4, 1.8]),
        ("path_loss_exponent", -2.0),
        ("shadowing_correlation_m", 0.0),
        ("furniture_share", 1.1),
        ("access_point_cells", [2, 2]),
        ("access_point_cells", [1.5, 4]),
        ("wall_slots", 20),
    ],
)
def test_senseless_settings_are_named(name, value):
    with pytest.raises(InputError, match=f"setting {name}: "):
        simulate({**SETTINGS, name: value}, rngs([0]))


def test_no_generator_is_an_error():
    with pytest.raises(InputError, match="rngs"):
        simulate(SETTINGS, [])


def test_other_settings_are_left_alone():
    simulate({**SETTINGS, "k": 4}, rngs([0]))
