"""Walks of the library that are to be aligned: steps that are counted, the files, and the aligned walks."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.alignment.aligned_graph_slam import AlignedGraphSlam
from algorithms.alignment.control_rigid import ControlRigid
from algorithms.alignment.dead_reckoning import DeadReckoning
from algorithms.alignment.graph_slam import GraphSlam
from algorithms.alignment.ransac_alignment import RansacAlignment
from positioning.errors import InputError
from positioning.model import Array, Truth, Walks, world
from positioning.recordings.phone_wifi_imu_library import SENSOR_HZ, dead_reckoned, load
from positioning.tasks.alignment import score

CHECKOUT = Path(__file__).parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
LIBRARY = REALDATA / "phone_wifi_imu_library"
needs_library = pytest.mark.skipif(
    not LIBRARY.is_dir(), reason=f"no recordings in {LIBRARY} (REPOSITION_REALDATA)"
)
STEP_M, STEPS_A_SECOND = 0.5, 1.6


def walked(turn_rad_per_s: float, duration_s: float = 20.0, held: Rotation | None = None) -> Array:
    """Return inertial readings of a walk at a constant rate of turn, the phone held somehow."""
    time_s = np.arange(int(duration_s * SENSOR_HZ)) / SENSOR_HZ
    force = np.zeros((len(time_s), 3))
    force[:, 2] = 9.1 - 1.5 * np.cos(2 * np.pi * STEPS_A_SECOND * time_s)
    rate = np.tile([0.0, 0.0, turn_rad_per_s], (len(time_s), 1))
    held = Rotation.identity() if held is None else held
    return np.concatenate([held.apply(force), held.apply(rate)], axis=-1)


@pytest.mark.parametrize("held", [None, Rotation.from_euler("xyz", [35, -20, 70], degrees=True)])
def test_steps_are_counted_and_turns_are_summed_however_the_phone_is_held(held: Rotation | None) -> None:
    position_m, heading_rad = dead_reckoned(walked(0.0, held=held), STEP_M)
    assert np.abs(heading_rad).max() < 1e-9
    assert position_m[-1] == pytest.approx([32 * STEP_M, 0.0])
    # A quarter of a circle each five seconds to the left: the walk is back where it began.
    position_m, heading_rad = dead_reckoned(walked(np.pi / 10, held=held), STEP_M)
    assert heading_rad[-1] == pytest.approx(2 * np.pi, abs=0.01)
    radius_m = STEP_M * STEPS_A_SECOND / (np.pi / 10)
    assert position_m[:, 1].max() == pytest.approx(2 * radius_m, rel=0.05)
    assert np.linalg.norm(position_m[-1]) < STEP_M


def test_a_quiet_phone_makes_no_step() -> None:
    quiet = walked(0.0)
    quiet[:, :3] = [0.0, 0.0, 9.1]
    position_m, _ = dead_reckoned(quiet, STEP_M)
    assert not position_m.any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"walks": "final3"}, ["option walks", "final3"]),
        ({"walks": []}, ["option walks", "an empty list"]),
        ({"walks": "final1", "run": 1}, ["option run", "together"]),
        ({"walks": "final1", "step_m": 0.0}, ["option step_m", "0.0"]),
        ({"walks": "final1"}, ["train_final1"]),
    ],
)
def test_wrong_options_and_missing_files_are_named(tmp_path: Path, options: dict, words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, **options)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("content", ["1,2,3\n" * 100, "1,2,3,4,5,6,7,8,nan\n" * 100, "a,b\n"])
def test_a_broken_inertial_file_is_named(tmp_path: Path, content: str) -> None:
    folder = tmp_path / "train_final1"
    folder.mkdir()
    scan = ",".join(["-60"] * 22 + ["1.0", "2.0"])
    (folder / "rss1.txt").write_text(f"{scan}\n{scan}\n", encoding="utf-8")
    (folder / "sens1.txt").write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=r"sens1\.txt"):
        load(tmp_path, walks="final1")


@needs_library
def test_walks_of_the_library_are_aligned_by_their_scans() -> None:
    worlds = load(LIBRARY, walks=["final1", "final2"])
    walks, truth = Walks.from_arrays(worlds.observed), Truth.from_arrays(worlds.truth)
    assert walks is not None
    assert walks.rss_dbm.shape == (1, 8, 267, 22)
    assert np.isfinite(walks.time_s).sum() == 729 + 682
    np.testing.assert_array_equal(np.isfinite(walks.time_s), np.isfinite(truth.path_m[..., 0]))
    np.testing.assert_array_equal(np.isfinite(walks.time_s), np.isfinite(truth.heading_rad))
    one = Walks.from_arrays(world(worlds.observed, 0))
    mean_m = {}
    for name, algorithm in (
        ("alone", DeadReckoning()),
        ("rigid", ControlRigid(truth=Truth.from_arrays(world(worlds.truth, 0)))),
        ("aligned", AlignedGraphSlam()),
    ):
        answer = algorithm.align(one, np.random.default_rng(0))
        estimates = {"position_m": answer.position_m[None], "heading_rad": answer.heading_rad[None]}
        mean_m[name] = float(np.nanmean(score(estimates, worlds.truth)["error_m"]))
    # Walks laid on the truth show what dead reckoning is worth; those laid upon each other lie between.
    assert mean_m["rigid"] < 4
    assert mean_m["rigid"] < mean_m["aligned"] < 0.5 * mean_m["alone"]


@needs_library
@pytest.mark.parametrize(("name", "scans"), [("final1", 729), ("final2", 682)])
def test_walks_of_one_collection_share_little_and_still_come_together(name: str, scans: int) -> None:
    worlds = load(LIBRARY, walks=name)
    one = Walks.from_arrays(world(worlds.observed, 0))
    truth = Truth.from_arrays(world(worlds.truth, 0))
    assert one is not None
    assert len(one.time_s) == 4
    assert np.isfinite(one.time_s).sum() == scans
    # A scan each second: a window of ten scans is half as long as in the simulated studies.
    assert np.nanmedian(np.diff(one.time_s, axis=-1)) == pytest.approx(1.0, abs=0.05)
    answers = {
        "alone": DeadReckoning().align(one, np.random.default_rng(0)),
        "rigid": ControlRigid(truth=truth).align(one, np.random.default_rng(0)),
        "printed": GraphSlam().align(one, np.random.default_rng(0)),
        "free": GraphSlam(frame="free").align(one, np.random.default_rng(0)),
        "ransac": RansacAlignment().align(one, np.random.default_rng(0)),
    }
    mean_m = {}
    for row, answer in answers.items():
        estimates = {"position_m": answer.position_m[None], "heading_rad": answer.heading_rad[None]}
        mean_m[row] = float(np.nanmean(score(estimates, worlds.truth)["error_m"]))
    assert np.sum(answers["ransac"].extra["aligned"]) < 3
    for row in ("printed", "free"):
        assert answers[row].extra["connected"].all()
        assert mean_m["rigid"] < mean_m[row] < 0.7 * mean_m["alone"]
