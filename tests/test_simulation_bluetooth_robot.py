"""The worlds of the Bluetooth study: what is fixed, what is random, what is hidden, what is calibrated."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.interpolate import RegularGridInterpolator

from positioning.errors import InputError
from positioning.geometry import wall_crossings
from positioning.seeds import stream
from positioning.simulation import bluetooth_scenario
from positioning.simulation.bluetooth_robot import simulate
from positioning.simulation.robot import draw_drive, meets_rectangle, random_drive

PAPER = yaml.safe_load((Path(__file__).parents[1] / "data/papers/bluetooth_robot.yaml").read_text("utf-8"))
SETTINGS, SCENARIO = (
    {name: setting["value"] for name, setting in PAPER["settings"][study].items()}
    for study in ("bluetooth_robot", "bluetooth_scenario")
)
WORLDS = 40
PATH = ("truth.position_m", "truth.heading_rad", "truth.distance_m", "truth.furniture_m")
COMMANDS = (
    "recording.time_s",
    "recording.turn_before_rad",
    "recording.advance_m",
    "recording.turn_after_rad",
    "recording.start_heading_rad",
)


def rngs(seeds):
    return [stream(seed, "bluetooth_robot") for seed in seeds]


def drawn(seeds=range(8), **changes):
    return simulate({**SETTINGS, **changes}, rngs(seeds))


@pytest.fixture(scope="module")
def worlds():
    return simulate(SETTINGS, rngs(range(WORLDS)))


@pytest.fixture(scope="module")
def quiet():
    """Worlds whose readings are the mean strength, but for rounding, by very many inquiries."""
    return drawn(range(2), inquiries=3000, iterations_most=5)


def law(truth, distance_m):
    """The tabulated law at distances [world, ...]."""
    rows = zip(distance_m, truth["truth.law_distance_m"], truth["truth.law_dbm"], strict=True)
    return np.stack([np.interp(d, at, level) for d, at, level in rows])


def field(truth):
    """The mean strength at the true places, from what the truth holds, by scipy's interpolation."""
    size = SETTINGS["size_m"]
    offsets = []
    for offset, place in zip(truth["truth.offset_dbm"], truth["truth.position_m"], strict=True):
        axes = [np.linspace(0, side, count) for side, count in zip(size, offset.shape[:2], strict=True)]
        offsets.append(RegularGridInterpolator(axes, offset)(place))
    return law(truth, truth["truth.distance_m"]) + np.stack(offsets)


def test_shapes_are_fixed(worlds):
    assert {name: values.shape[1:] for name, values in worlds.observed.items()} == {
        "site.corner_m": (2, 2),
        "site.access_point_m": (3, 2),
        "calibration.distance_m": (31,),
        "calibration.rss_dbm": (31,),
        "recording.time_s": (6, 60),
        "recording.rss_dbm": (6, 60, 3),
        "recording.turn_before_rad": (6, 60),
        "recording.advance_m": (6, 60),
        "recording.turn_after_rad": (6, 60),
        "recording.start_heading_rad": (6,),
        "static.time_s": (200,),
        "static.rss_dbm": (200,),
    }
    assert {name: values.shape[1:] for name, values in worlds.truth.items()} == {
        "truth.position_m": (6, 60, 2),
        "truth.heading_rad": (6, 60),
        "truth.distance_m": (6, 60, 3),
        "truth.law_distance_m": (1002,),
        "truth.law_dbm": (1002,),
        "truth.offset_dbm": (25, 33, 3),
        "truth.grid_m": (),
        "truth.deviation_db": (),
        "truth.furniture_m": (4, 2, 2),
        "truth.turn_noise_rad": (),
        "truth.advance_noise_m": (),
        "truth.drift_noise_rad_per_m": (),
    }
    for part in worlds:
        assert all(values.dtype == np.float64 and len(values) == WORLDS for values in part.values())


def test_paths_stay_inside_and_out_of_furniture(worlds):
    place = worlds.truth["truth.position_m"]
    driven = np.isfinite(place)
    margin = SETTINGS["margin_m"]
    assert ((place >= margin) & (place <= np.array([6.0, 8.0]) - margin))[driven].all()
    np.testing.assert_array_equal(place[:, :, 0], np.broadcast_to(SETTINGS["start_m"], (WORLDS, 6, 2)))
    moves = np.stack([place[:, :, :-1], place[:, :, 1:]], axis=-2).reshape(-1, 2, 2)
    moves = moves[np.isfinite(moves).all(axis=(1, 2))]
    assert len(moves) > 2000
    for x0, y0, x1, y1 in SETTINGS["furniture_m"]:
        ring = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
        edges = np.stack([ring[:-1], ring[1:]], axis=1)
        assert wall_crossings(moves[:, None, 0], moves[:, None, 1], edges).sum() == 0
        assert not ((moves[:, 0] > [x0, y0]) & (moves[:, 0] < [x1, y1])).all(axis=-1).any()


def test_after_the_end_of_a_run_all_is_nan_and_before_nothing_is(worlds):
    time_s = worlds.observed["recording.time_s"]
    going = np.isfinite(time_s)
    assert (np.diff(going.astype(int), axis=-1) <= 0).all()
    assert going.sum(axis=-1).min() >= SETTINGS["iterations_least"]
    per_epoch = [(name, worlds.observed[name]) for name in (*COMMANDS[:-1], "recording.rss_dbm")]
    per_epoch += [(name, worlds.truth[name]) for name in PATH[:3]]
    for name, values in per_epoch:
        known = np.isfinite(values)
        np.testing.assert_array_equal(
            known,
            np.broadcast_to(going.reshape(*going.shape, *[1] * (values.ndim - 3)), known.shape),
            err_msg=name,
        )
    np.testing.assert_array_equal(time_s[going], np.broadcast_to(15.0 * np.arange(60), time_s.shape)[going])
    # The number of iterations is random, and the boundary ends most runs.
    lengths = going.sum(axis=-1)
    assert len(np.unique(lengths)) > 20
    assert (lengths < 60).mean() > 0.8


def test_commands_are_what_the_paper_says_and_the_motion_follows_them(worlds):
    before, advance, after = (
        worlds.observed[f"recording.{name}"] for name in ("turn_before_rad", "advance_m", "turn_after_rad")
    )
    for command in (before, advance, after):
        assert (command[:, :, 0] == 0).all()
    moved = np.isfinite(advance[:, :, 1:])
    step = advance[:, :, 1:][moved]
    assert 0.5 <= step.min() < 0.51
    assert 0.99 < step.max() <= 1.0
    for turns in (before[:, :, 1:][moved], after[:, :, 1:][moved]):
        quarters = turns / (np.pi / 2)
        np.testing.assert_allclose(quarters, np.rint(quarters), atol=1e-12)
        assert set(np.rint(quarters)) == {-1.0, 0.0, 1.0, 2.0}
    # A robot goes straight on unless the way was refused.
    assert (before[:, :, 1:][moved] == 0).mean() > 0.6
    start = worlds.observed["recording.start_heading_rad"]
    np.testing.assert_array_equal(start, worlds.truth["truth.heading_rad"][:, :, 0])
    assert len(np.unique(start)) == 4


def test_without_motion_noise_commands_give_the_path():
    silent = drawn(turn_noise_rad=0.0, advance_noise_m=0.0, drift_noise_rad_per_m=0.0)
    before, advance, after = (
        silent.observed[f"recording.{name}"] for name in ("turn_before_rad", "advance_m", "turn_after_rad")
    )
    heading = silent.observed["recording.start_heading_rad"][..., None] + np.cumsum(before + after, axis=-1)
    np.testing.assert_allclose(heading, silent.truth["truth.heading_rad"], atol=1e-9)
    way = heading - after
    moves = advance[..., None] * np.stack([np.cos(way), np.sin(way)], axis=-1)
    path = np.array(SETTINGS["start_m"])[:, None] + np.cumsum(moves, axis=-2)
    np.testing.assert_allclose(path, silent.truth["truth.position_m"], atol=1e-9)


def free_drive(**noise):
    """Many drives in an arena without end or furniture."""
    draws = draw_drive(np.random.default_rng(5), runs=4000, epochs=3)
    quiet = {"turn_noise_rad": 0.0, "advance_noise_m": 0.0, "drift_noise_rad_per_m": 0.0}
    return random_drive(
        [0.0, 0.0],
        draws,
        size_m=(1e9, 1e9),
        margin_m=-1e9,
        furniture_m=[],
        advance_m=(0.5, 1.0),
        epochs_least=1,
        **{**quiet, **noise},
    )


@pytest.mark.parametrize("name", ["turn_noise_rad", "advance_noise_m", "drift_noise_rad_per_m"])
def test_motion_noise_has_the_deviation_that_is_set(name):
    drive = free_drive(**{name: 0.05})
    move = np.diff(drive.position_m, axis=1)
    advance = drive.advance_m[:, 1:]
    commanded = drive.turn_before_rad[:, 1:] + drive.turn_after_rad[:, 1:]
    turn_error = np.diff(drive.heading_rad, axis=1) - commanded
    way_error = (
        np.arctan2(move[..., 1], move[..., 0]) - drive.heading_rad[:, :-1] - drive.turn_before_rad[:, 1:]
    )
    way_error = np.angle(np.exp(1j * way_error))
    length_error = np.linalg.norm(move, axis=-1) - advance
    expected = {
        "turn_noise_rad": (0.05, 0.05 * np.sqrt(2), 0.0),
        "advance_noise_m": (0.0, 0.0, 0.05),
        # Half of the drift has happened half way along.
        "drift_noise_rad_per_m": (0.025, 0.05, 0.0),
    }[name]
    scale = advance if name == "drift_noise_rad_per_m" else 1.0
    for error, deviation in zip((way_error / scale, turn_error / scale, length_error), expected, strict=True):
        np.testing.assert_allclose(np.sqrt(np.mean(error**2)), deviation, rtol=0.03, atol=1e-9)
        np.testing.assert_allclose(error.mean(), 0.0, atol=4 * deviation / np.sqrt(error.size) + 1e-9)


def test_a_run_ends_where_the_next_way_leaves_the_arena():
    draws = draw_drive(np.random.default_rng(0), runs=500, epochs=30)
    common = {"furniture_m": [], "turn_noise_rad": 0.0, "advance_noise_m": 0.0, "drift_noise_rad_per_m": 0.0}
    small = random_drive(
        [2.0, 2.0], draws, size_m=(4.0, 4.0), margin_m=0.2, advance_m=(0.5, 1.0), epochs_least=1, **common
    )
    large = random_drive(
        [2.0, 2.0], draws, size_m=(1e9, 1e9), margin_m=-1e9, advance_m=(0.5, 1.0), epochs_least=1, **common
    )
    # Without furniture and least number, a robot in the small arena is the one in the large until it is out.
    out = ((large.position_m < 0.2) | (large.position_m > 3.8)).any(axis=-1)
    ended = np.maximum.accumulate(out, axis=-1)
    np.testing.assert_array_equal(np.isnan(small.heading_rad), ended)
    np.testing.assert_array_equal(small.position_m[~ended], large.position_m[~ended])


def test_a_robot_that_is_walled_in_is_an_error():
    ring = [[1.0, 1.0, 3.0, 1.4], [1.0, 2.6, 3.0, 3.0], [1.0, 1.4, 1.4, 2.6], [2.6, 1.4, 3.0, 2.6]]
    with pytest.raises(InputError, match=r"furniture_m: a robot at .* finds no way on"):
        drawn([0], furniture_m=ring, start_m=[[2.0, 2.0]], advance_m=0.9)


def test_meeting_a_rectangle_agrees_with_points_along_the_line():
    rng = np.random.default_rng(3)
    start, end = rng.uniform(0, 4, (2, 3000, 2))
    box = np.array([[[1.0, 1.5], [2.5, 2.0]], [[3.0, 0.5], [3.2, 3.5]]])
    along = start[:, None] + np.linspace(0, 1, 2001)[:, None] * (end - start)[:, None]
    inside = (
        ((along[:, :, None] >= box[:, 0]) & (along[:, :, None] <= box[:, 1])).all(axis=-1).any(axis=(1, 2))
    )
    found = meets_rectangle(start, end, box)
    assert (found >= inside).all()
    # Lines that only clip a corner slip between the points.
    assert (found != inside).mean() < 0.003
    cases = [
        ([0, 1.5], [4, 1.5], True),  # along an edge
        ([0, 1.4], [4, 1.4], False),
        ([1.0, 0], [1.0, 1.5], True),  # ends on a corner
        ([2, 1.75], [2, 1.75], True),  # a point
        ([0, 0], [0, 0], False),
        ([0, 1.75], [0.9, 1.75], False),
        ([2.6, 1.75], [4, 1.75], False),
    ]
    for first, last, meets in cases:
        assert meets_rectangle(first, last, box[:1]) == meets, (first, last)


def test_worlds_differ_repeat_and_do_not_depend_on_their_batch(worlds):
    for batch in ([7], [7, 1], [20, 30, 7]):
        alone = simulate(SETTINGS, rngs(batch))
        for part, other in zip(worlds, alone, strict=True):
            for name in part:
                assert part[name][7].tobytes() == other[name][batch.index(7)].tobytes(), name
    for name in ("recording.rss_dbm", "calibration.rss_dbm", "static.rss_dbm", "recording.advance_m"):
        assert len({values.tobytes() for values in worlds.observed[name]}) == WORLDS, name


def changed(first, second):
    """Names of the arrays that two draws do not share to the last bit."""
    return {
        name
        for one, other in zip(first, second, strict=True)
        for name in one
        if one[name].tobytes() != other[name].tobytes()
    }


READINGS = {"recording.rss_dbm", "calibration.rss_dbm", "static.rss_dbm"}


@pytest.mark.parametrize(
    ("name", "truths"),
    [
        ("shadowing_db", {"truth.offset_dbm"}),
        ("furniture_loss_db", {"truth.offset_dbm"}),
        ("fringe_db", {"truth.law_dbm"}),
        ("inquiry_noise_db", {"truth.deviation_db"}),
        ("reference_dbm", {"truth.law_dbm"}),
        ("shadowing_correlation_m", {"truth.offset_dbm"}),
    ],
)
def test_a_radio_setting_changes_only_what_it_must(name, truths):
    expected = truths | READINGS
    if name == "furniture_loss_db":
        expected -= {"calibration.rss_dbm", "static.rss_dbm"}  # taken over open floor
    if name == "shadowing_correlation_m":
        expected -= {"static.rss_dbm"}  # one place has no correlation
    assert changed(drawn(), drawn(**{name: SETTINGS[name] * 1.5})) == expected


def test_calibrated_settings_scale_common_draws():
    flat, low, high = (
        drawn(shadowing_db=value, furniture_loss_db=0.0).truth["truth.offset_dbm"]
        for value in (0.0, 2.0, 6.0)
    )
    assert (flat == 0).all()
    np.testing.assert_allclose(high, 3 * low, rtol=1e-12)
    flat, low, high = (drawn(fringe_db=value).truth["truth.law_dbm"] for value in (0.0, 2.0, 6.0))
    np.testing.assert_allclose(high - flat, 3 * (low - flat), atol=1e-9)


def test_law_is_path_loss_with_a_fringe_of_its_amplitude_and_period(worlds):
    distance, level = worlds.truth["truth.law_distance_m"], worlds.truth["truth.law_dbm"]
    np.testing.assert_allclose(distance, np.broadcast_to(np.arange(1002) * 0.01, distance.shape), atol=1e-12)
    assert distance.max() >= np.hypot(6, 8)
    assert (level[:, :11] == level[:, :1]).all()
    fringe = (level - (-50.0 - 20.0 * np.log10(np.maximum(distance, 0.1))))[:, 10:]
    np.testing.assert_allclose(fringe[:, 150:], fringe[:, :-150], atol=1e-9)  # a period of 1.5 m
    np.testing.assert_allclose(np.abs(fringe).max(axis=1), 3.0, rtol=1e-3)
    np.testing.assert_allclose(fringe[:, :150].mean(axis=1), 0.0, atol=1e-9)
    # The phase is each world's own.
    assert np.ptp(np.argmax(fringe[:, :150], axis=1)) > 100


def test_law_and_interpolated_offsets_are_the_mean_of_the_readings(quiet):
    expected = field(quiet.truth)
    deviation = quiet.truth["truth.deviation_db"][0]
    np.testing.assert_allclose(quiet.observed["recording.rss_dbm"], expected, atol=6 * deviation)
    assert 6 * deviation < 0.25
    assert np.ptp(expected) > 10


def test_readings_scatter_about_the_field_as_the_truth_states(worlds):
    going = np.isfinite(worlds.observed["recording.time_s"])
    place = np.where(np.isfinite(worlds.truth["truth.position_m"]), worlds.truth["truth.position_m"], 1.0)
    distance = np.linalg.norm(place[..., None, :] - np.array(SETTINGS["beacons_m"]), axis=-1)
    expected = field({**worlds.truth, "truth.position_m": place, "truth.distance_m": distance})
    noise = (worlds.observed["recording.rss_dbm"] - expected)[going]
    assert noise.size > 8000
    np.testing.assert_allclose(noise.std(), worlds.truth["truth.deviation_db"][0], rtol=0.03)
    np.testing.assert_allclose(noise.mean(), 0.0, atol=0.04)
    # Beacons and epochs are independent.
    np.testing.assert_allclose(np.corrcoef(noise.T) - np.eye(3), 0.0, atol=0.07)
    # A mean of five whole numbers.
    fifths = 5 * worlds.observed["recording.rss_dbm"][going]
    np.testing.assert_allclose(fifths, np.rint(fifths), atol=1e-9)


def test_distances_are_those_of_the_true_places(worlds):
    place = worlds.truth["truth.position_m"][..., None, :]
    np.testing.assert_allclose(
        worlds.truth["truth.distance_m"],
        np.hypot(*np.moveaxis(place - np.array(SETTINGS["beacons_m"]), -1, 0)),
    )


def test_furniture_costs_its_loss_for_each_edge_on_the_line():
    offset = drawn([0], shadowing_db=0.0, furniture_loss_db=1.5).truth["truth.offset_dbm"][0]
    assert set(np.unique(offset / 1.5)) <= {0.0, -1.0, -2.0, -3.0, -4.0, -5.0, -6.0}
    # From (5.75, 1.25) straight to the left through the first desk, then free to beacon 1 at (1.72, 0.35).
    assert offset[23, 5, 0] == -3.0
    # A place inside of a desk has one edge before it.
    assert offset[19, 5, 0] == -1.5
    # Left of all furniture the beacons 2 and 3 are in free view.
    assert (offset[8:13, 20:30, 1] == 0).all()
    bare = drawn([0], shadowing_db=0.0, furniture_m=[]).truth
    assert (bare["truth.offset_dbm"] == 0).all()
    assert bare["truth.furniture_m"].shape == (1, 0, 2, 2)


def test_shadowing_has_its_deviation_falls_off_and_is_each_beacons_own():
    short = {"shadowing_db": 3.0, "furniture_loss_db": 0.0, "iterations_most": 5}
    offset = drawn(range(200), **short).truth["truth.offset_dbm"]
    np.testing.assert_allclose(offset.std(), 3.0, rtol=0.03)
    for lag in (1, 4, 8):
        for pair in (
            (offset[:, lag:], offset[:, :-lag]),
            (offset[:, :, lag:], offset[:, :, :-lag]),
        ):
            np.testing.assert_allclose(
                np.mean(pair[0] * pair[1]) / np.mean(offset**2), np.exp(-0.25 * lag), atol=0.05
            )
    for first, second in ((0, 1), (0, 2), (1, 2)):
        np.testing.assert_allclose(np.mean(offset[..., first] * offset[..., second]) / 9.0, 0.0, atol=0.06)


def test_calibration_follows_the_law_with_shadowing_of_its_own():
    count = 150
    silent = {"inquiry_noise_db": 0.0, "inquiries": 1, "furniture_loss_db": 0.0}
    seeds = range(count)
    settings = {**silent, "iterations_most": 5, "shadowing_db": 20.0}
    observed, truth = simulate({**SETTINGS, **settings}, rngs(seeds))
    np.testing.assert_allclose(
        observed["calibration.distance_m"], np.tile(np.arange(0.25, 7.8, 0.25), (count, 1))
    )
    shadow = observed["calibration.rss_dbm"] - law(truth, observed["calibration.distance_m"])
    np.testing.assert_allclose(shadow.std(), 20.0, rtol=0.06)
    for lag in (1, 4):
        np.testing.assert_allclose(
            np.mean(shadow[:, lag:] * shadow[:, :-lag]) / 400.0, np.exp(-0.25 * lag), atol=0.06
        )
    # Nothing of the field that is tested, along any line, is in it: no correlation beyond chance.
    field_dbm = truth["truth.offset_dbm"].reshape(count, -1)
    correlation = (shadow - shadow.mean(0)).T @ (field_dbm - field_dbm.mean(0)) / count
    correlation /= np.outer(shadow.std(0), field_dbm.std(0))
    np.testing.assert_allclose(correlation.std(), 1 / np.sqrt(count), rtol=0.1)
    assert np.abs(correlation).max() < 0.5
    # The static series stands at the law's level at 3 m, with one draw of its own.
    static = observed["static.rss_dbm"] - law(truth, np.full((count, 1), 3.0))
    assert (np.ptp(static, axis=1) == 0).all()
    np.testing.assert_allclose(static[:, 0].std(), 20.0, rtol=0.2)
    own = [np.corrcoef(static[:, 0], other)[0, 1] for other in (*shadow.T, *field_dbm.T[::50])]
    assert np.abs(own).max() < 0.35


def test_static_series_are_single_inquiries(worlds):
    rss, at = worlds.observed["static.rss_dbm"], worlds.observed["static.time_s"]
    np.testing.assert_array_equal(rss, np.rint(rss))
    np.testing.assert_array_equal(at, np.broadcast_to(3.0 * np.arange(200), at.shape))
    np.testing.assert_allclose((rss - rss.mean(axis=1, keepdims=True)).std(), np.sqrt(4 + 1 / 12), rtol=0.03)


def test_truth_stays_out_of_what_is_observed(worlds):
    assert not any(name.startswith("truth") for name in worlds.observed)
    for name in ("truth.position_m", "truth.distance_m", "truth.law_dbm"):
        hidden = worlds.truth[name]
        hidden = hidden[:, :, 1:] if name != "truth.law_dbm" else hidden
        for seen in worlds.observed.values():
            assert not np.isin(hidden[np.isfinite(hidden)], seen).any(), name


@pytest.mark.parametrize("name", sorted(SETTINGS))
def test_every_setting_is_needed_and_named_when_missing(name):
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        simulate({key: value for key, value in SETTINGS.items() if key != name}, rngs([0]))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size_m", [6.0]),
        ("size_m", [6.0, 0.0]),
        ("size_m", [6.0, -8.0]),
        ("beacons_m", [[1.0, 1.0], [2.0, 2.0]]),
        ("beacons_m", [[1.0, 1.0], [2.0, 2.0], [1.0, 1.0]]),
        ("beacons_m", [[1.0, 1.0], [2.0, 2.0], [1.0, float("nan")]]),
        ("beacons_m", [[1.0, 1.0], [2.0, 2.0], 3.0]),
        ("beacons_m", "abc"),
        ("start_m", []),
        ("start_m", [[0.1, 4.0]]),
        ("start_m", [[7.0, 4.0]]),
        ("start_m", [[4.5, 1.2]]),
        ("furniture_m", 3.0),
        ("furniture_m", [[1.0, 1.0, 2.0]]),
        ("furniture_m", [[2.0, 1.0, 1.0, 2.0]]),
        ("furniture_m", [[5.0, 1.0, 7.0, 2.0]]),
        ("furniture_m", [[-1.0, 1.0, 1.0, 2.0]]),
        ("advance_m", [1.0, 0.5]),
        ("advance_m", -0.5),
        ("advance_m", 0.0),
        ("margin_m", -0.1),
        ("margin_m", 3.0),
        ("iterations_least", 0),
        ("iterations_least", 2.5),
        ("iterations_most", 4),
        ("inquiries", 0),
        ("reference_dbm", float("inf")),
        ("path_loss_exponent", -1.0),
        ("fringe_db", -1.0),
        ("fringe_period_m", 0.0),
        ("shadowing_db", -1.0),
        ("shadowing_db", True),
        ("shadowing_correlation_m", 0.0),
        ("furniture_loss_db", -1.0),
        ("inquiry_noise_db", "2"),
        ("inquiry_noise_db", -2.0),
        ("calibration_nearest_m", 0.0),
        ("calibration_farthest_m", 0.25),
        ("calibration_farthest_m", 7.8),
        ("calibration_step_m", 0.0),
        ("static_distance_m", 0.0),
        ("static_inquiries", 0),
        ("inquiry_s", 0.0),
        ("turn_noise_rad", -0.1),
        ("advance_noise_m", -0.1),
        ("drift_noise_rad_per_m", -0.1),
        ("grid_m", 0.0),
        ("grid_m", 0.35),
        ("grid_m", 0.05),
        ("grid_m", 50.0),
    ],
)
def test_senseless_settings_are_named(name, value):
    with pytest.raises(InputError, match=rf"setting {name}(\[\d\])?: "):
        simulate({**SETTINGS, name: value}, rngs([0]))


def test_no_generator_is_an_error_and_other_settings_are_left_alone():
    for study, settings in ((simulate, SETTINGS), (bluetooth_scenario.simulate, SCENARIO)):
        with pytest.raises(InputError, match="rngs"):
            study(settings, [])
    assert changed(drawn([0]), drawn([0], particles=500)) == set()


def test_the_scenario_is_the_printed_one_in_every_world():
    observed, truth = bluetooth_scenario.simulate(SCENARIO, rngs(range(3)))
    assert {name: values.shape for name, values in {**observed, **truth}.items()} == {
        "site.corner_m": (3, 2, 2),
        "site.access_point_m": (3, 3, 2),
        "recording.time_s": (3, 1),
        "recording.range_m": (3, 1, 3),
        "truth.position_m": (3, 1, 2),
    }
    for world in range(3):
        np.testing.assert_array_equal(observed["recording.range_m"][world], [[0.752835, 4.4, 3.07207]])
        np.testing.assert_array_equal(
            observed["site.access_point_m"][world], [[1.72, 0.35], [1.79, 5.63], [3.05, 2.61]]
        )
        np.testing.assert_array_equal(truth["truth.position_m"][world], [[1.05, 0.79]])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("range_m", [0.7, 4.4]),
        ("range_m", [0.7, 4.4, 0.0]),
        ("range_m", [0.7, 4.4, -3.0]),
        ("position_m", 1.0),
        ("beacons_m", [[1.0, 2.0]]),
    ],
)
def test_a_senseless_scenario_is_named(name, value):
    with pytest.raises(InputError, match=f"setting {name}"):
        bluetooth_scenario.simulate({**SCENARIO, name: value}, rngs([0]))
    with pytest.raises(InputError, match=f"setting {name}: it is missing"):
        bluetooth_scenario.simulate({k: v for k, v in SCENARIO.items() if k != name}, rngs([0]))
