"""Files of pose graphs: by hand, there and back, and every error with file and line number."""

import os
from pathlib import Path

import numpy as np
import pytest

from positioning.errors import InputError
from positioning.posegraph.g2o import read, write
from positioning.posegraph.graph import PoseGraph

CHECKOUT = Path(__file__).parents[1]
REALDATA = Path(os.environ.get("REPOSITION_REALDATA", CHECKOUT.parent / "shared" / "realdata"))
GRAPHS = REALDATA / "pose_graphs"
needs_graphs = pytest.mark.skipif(
    not GRAPHS.is_dir(), reason=f"no recordings in {GRAPHS} (REPOSITION_REALDATA)"
)

LINES = """\
# three poses
VERTEX_SE2 7 0 0 0
VERTEX_SE2 3 1.0 0 1.5707963267948966
VERTEX_SE2 9 1.0 2.0 0.5

EDGE_SE2 7 3 1 0 1.5707963267948966 4 0.5 0.25 9 0.125 25
EDGE_SE2 3 9 2 0 0 1 0 0 1 0 1
EDGE_SE2 9 7 0 0 0 1 0 0 1 0 1
EDGE_NEAR 7 9 0.5
"""


def given(folder: Path, text: str) -> Path:
    path = folder / "graph.g2o"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_by_hand(tmp_path: Path) -> None:
    graph = read(given(tmp_path, LINES))
    np.testing.assert_array_equal(graph.pose[:, 2], [0, np.pi / 2, 0.5])
    assert graph.motion_from.tolist() == [0, 1, 2]
    assert graph.motion_to.tolist() == [1, 2, 0]
    assert graph.loop is not None
    assert graph.loop.tolist() == [False, False, True]
    assert graph.fixed.tolist() == [True, False, False]
    assert (graph.near_from.tolist(), graph.near_to.tolist()) == ([0], [2])
    assert graph.near_weight is not None
    assert graph.near_weight.tolist() == [0.5]
    # The second pose looks along y of the first: its forward is the first one's left.
    expected = [[9, -0.5, -0.125], [-0.5, 4, 0.25], [-0.125, 0.25, 25]]
    np.testing.assert_allclose(graph.motion_information[0], expected, atol=1e-12)


def test_fixed_poses(tmp_path: Path) -> None:
    graph = read(given(tmp_path, LINES + "FIX 3 9\n"))
    assert graph.fixed.tolist() == [False, True, True]


def test_the_order_of_toro(tmp_path: Path) -> None:
    graph = read(given(tmp_path, "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 11 12 22 33 13 23\n"))
    expected = [[11, 12, 13], [12, 22, 23], [13, 23, 33]]
    with pytest.raises(InputError, match="semi-definite"):
        graph = read(given(tmp_path, "VERTEX2 0 0 0 0\nVERTEX2 1 1 0 0\nEDGE2 0 1 1 0 0 1 2 1 1 0 0\n"))
    np.testing.assert_array_equal(graph.motion_information[0], expected)


def test_there_and_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 3, 3))
    graph = PoseGraph(
        pose=rng.normal(size=(7, 3)),
        motion_from=np.arange(6),
        motion_to=np.arange(1, 7),
        motion=rng.normal(size=(6, 3)),
        motion_information=root @ root.swapaxes(-1, -2),
        near_from=np.array([0, 1]),
        near_to=np.array([4, 5]),
        near_weight=np.array([0.1, 2.0]),
        fixed=np.arange(7) == 2,
    )
    write(tmp_path / "there.g2o", graph)
    back = read(tmp_path / "there.g2o")
    for name in (
        "pose",
        "motion_from",
        "motion_to",
        "motion",
        "near_from",
        "near_to",
        "near_weight",
        "fixed",
    ):
        np.testing.assert_array_equal(getattr(back, name), getattr(graph, name), err_msg=name)
    np.testing.assert_allclose(back.motion_information, graph.motion_information, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("number", "line", "message"),
    [
        (2, "VERTEX_SE2 7 0 0", "3 values, not 4"),
        (3, "VERTEX_SE2 7 0 0 0", "pose 7 stands here a second time"),
        (4, "VERTEX_SE2 9 nan 0 0", "not all finite"),
        (4, "VERTEX_SE2 9 one 0 0", "not all finite"),
        (4, "VERTEX_SE2 9.5 0 0 0", "no numbers of poses"),
        (6, "EDGE_SE2 7 3 1 0 0 4 0 0 9 0", "10 values, not 11"),
        (6, "EDGE_SE2 7 4 1 0 0 4 0 0 9 0 1", "pose 4 stands nowhere"),
        (6, "EDGE_SE2 7 7 1 0 0 4 0 0 9 0 1", "pose 7 to itself"),
        (6, "EDGE_SE2 7 3 1 0 inf 4 0 0 9 0 1", "not all finite"),
        (7, "EDGE_SE3 7 3", "'EDGE_SE3' is none of"),
        (9, "EDGE_NEAR 7 9", "2 values, not 3"),
        (6, "EDGE_SE2 7 3 1 0 0 1 2 0 1 0 1", "information is not positive semi-definite"),
        (7, "EDGE2 3 9 2 0 0 1 0 1 -1 0 0", "information is not positive semi-definite"),
        (9, "EDGE_NEAR 7 9 -0.5", "the weight -0.5 is negative"),
    ],
)
def test_a_broken_line(tmp_path: Path, number: int, line: str, message: str) -> None:
    lines = LINES.splitlines()
    lines[number - 1] = line
    path = given(tmp_path, "\n".join(lines))
    with pytest.raises(InputError) as error:
        read(path)
    assert error.value.thing == f"{path}, line {number}"
    assert message in str(error.value)


def test_a_pair_that_stands_twice(tmp_path: Path) -> None:
    path = given(tmp_path, LINES + "EDGE_NEAR 3 7 1\nEDGE_NEAR 9 7 1\n")
    with pytest.raises(InputError) as error:
        read(path)
    assert error.value.thing == f"{path}, line 11"
    assert "stands in line 9 already" in str(error.value)


def test_marks_of_encodings_and_parameters_of_sensors_are_skipped(tmp_path: Path) -> None:
    plain = read(given(tmp_path, LINES))
    path = tmp_path / "marked.g2o"
    path.write_text("PARAMS_SE2OFFSET 0 0 0 0\n" + LINES, encoding="utf-8-sig")
    assert path.read_bytes().startswith(b"\xef\xbb\xbfPARAMS_")
    np.testing.assert_array_equal(read(path).pose, plain.pose)


def test_the_example_of_the_guide_closes_its_square(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    guide = (CHECKOUT / "docs/add-an-algorithm.md").read_text(encoding="utf-8")
    part = guide.partition("\n## Pose graphs and .g2o from Python\n")[2].partition("\n## ")[0]
    monkeypatch.chdir(tmp_path)
    exec(part.partition("```python\n")[2].partition("```")[0], {})
    corner_m = read("solved.g2o").pose[:, :2]
    np.testing.assert_allclose(corner_m, [[0, 0], [9, 0], [9, 9], [0, 9]], atol=0.01)


def test_files_that_hold_no_graph(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no pose"):
        read(given(tmp_path, "\n# nothing\n"))
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "absent.g2o")
    (tmp_path / "binary.g2o").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "binary.g2o")


@needs_graphs
@pytest.mark.parametrize(
    ("name", "poses", "edges", "loops"), [("intel.g2o", 1228, 1483, 256), ("M3500.txt", 3500, 5453, 1954)]
)
def test_published_graphs(tmp_path: Path, name: str, poses: int, edges: int, loops: int) -> None:
    graph = read(GRAPHS / name)
    assert (len(graph.pose), len(graph.motion)) == (poses, edges)
    assert graph.loop is not None
    assert graph.loop.sum() == loops
    write(tmp_path / "again.g2o", graph)
    again = read(tmp_path / "again.g2o")
    np.testing.assert_array_equal(again.motion, graph.motion)
    np.testing.assert_allclose(again.motion_information, graph.motion_information, rtol=1e-9, atol=1e-6)
