"""Files are whole or absent, and damaged ones say so."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from positioning import files
from positioning.errors import InputError
from positioning.joblog import logging_to


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    target = tmp_path / "a" / "x.txt"
    files.write_text(target, "old")
    with pytest.raises(ZeroDivisionError), files.replacing(target) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise ZeroDivisionError
    assert target.read_text() == "old"
    assert [p.name for p in target.parent.iterdir()] == ["x.txt"]


arrays = hnp.arrays(
    dtype=st.sampled_from([np.float64, np.int32, np.bool_]), shape=hnp.array_shapes(max_dims=3, max_side=4)
)


@given(
    tree=st.dictionaries(
        st.sampled_from(["a", "b/0", "c"]), st.dictionaries(st.sampled_from(["x", "y.z"]), arrays, min_size=1)
    )
)
@settings(max_examples=25, deadline=None)
def test_trees_come_back(tmp_path_factory: pytest.TempPathFactory, tree: files.Tree) -> None:
    path = tmp_path_factory.mktemp("tree") / "t.npz"
    files.write_tree(path, tree)
    back = files.read_tree(path)
    assert back.keys() == tree.keys()
    for branch, values in tree.items():
        assert back[branch].keys() == values.keys()
        for name, value in values.items():
            assert back[branch][name].dtype == value.dtype
            np.testing.assert_array_equal(back[branch][name], value)
    some = {branch: {"x": values["x"]} for branch, values in tree.items() if "x" in values}
    np.testing.assert_equal(files.read_tree(path, only=["x"]), some)


def test_equal_trees_are_equal_bytes(tmp_path: Path) -> None:
    for name in ("a.npz", "b.npz"):
        files.write_tree(tmp_path / name, {"f": {"x": np.arange(5.0)}})
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_errors_come_back_with_reasons(tmp_path: Path) -> None:
    columns = {
        "family": np.array(["f", "f"]),
        "world": np.array([0, 1], np.int32),
        "error_m": np.array([1.0, 2.0]),
    }
    files.write_errors(tmp_path / "e.parquet", columns, {"g": "no walls"})
    back, skipped = files.read_errors(tmp_path / "e.parquet")
    assert skipped == {"g": "no walls"}
    assert back["family"].tolist() == ["f", "f"]
    np.testing.assert_array_equal(back["error_m"], columns["error_m"])


@pytest.mark.parametrize("cut", [0, 10, 100])
@pytest.mark.parametrize("kind", ["npz", "parquet", "json"])
def test_a_truncated_file_is_named_with_the_cure(tmp_path: Path, kind: str, cut: int) -> None:
    path = tmp_path / f"x.{kind}"
    if kind == "npz":
        files.write_tree(path, {"f": {"x": np.arange(100.0)}})
        read = files.read_tree
    elif kind == "parquet":
        files.write_errors(path, {"family": np.array(["f"]), "error_m": np.array([1.0])}, {})
        read = files.read_errors  # type: ignore[assignment]
    else:
        files.write_json(path, {"a": list(range(100))})
        read = files.read_json
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError, match=r"(?s)x\..*damaged.*Delete it"):
        read(path)


def test_a_missing_file_stays_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        files.read_tree(tmp_path / "none.npz")


def test_an_archive_with_a_pickle_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", **{"f/x": np.array([{"a": 1}], dtype=object)})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="damaged"):
        files.read_tree(tmp_path / "p.npz")


def test_wrong_yaml_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("a: [1,\nb: 2", encoding="utf-8")
    with pytest.raises(InputError, match=r"a\.yaml"):
        files.read_yaml(tmp_path / "a.yaml")


def test_wrong_input_is_one_line_in_the_log_and_faults_have_their_trace(tmp_path: Path) -> None:
    with pytest.raises(SystemExit), logging_to(tmp_path / "a" / "log"):
        raise InputError("key x", "it is wrong", "Correct it")
    assert (tmp_path / "a/log").read_text() == "Error. key x: it is wrong. Correct it.\n"
    with pytest.raises(SystemExit), logging_to(tmp_path / "log"):  # noqa: PT012
        print("before")
        raise KeyError("y")
    text = (tmp_path / "log").read_text()
    assert text.startswith("before\nTraceback")
    assert "KeyError: 'y'" in text
