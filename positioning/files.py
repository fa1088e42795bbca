"""Reading and writing the project's files: whole or not at all, and never a pickle.

Every file is written under a temporary name beside its place and then renamed, so that a reader
meets either the old file, the new one, or none.

Stacks of worlds (``observed.npz``, ``truth.npz``) and estimates are NumPy archives whose names are
paths: ``<family>/<type>.<field>``, for example ``building/survey.rss_dbm`` with a world axis in front.
"""

import json
import os
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from positioning.errors import InputError

Tree = dict[str, dict[str, NDArray[np.generic]]]


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Give a temporary path to write to, which takes the name ``path`` when the block ends well.

    The temporary file lies in the same folder, because a rename is whole only within one file
    system, and keeps the ending, because writers choose the format by it.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    temporary = target.with_name(f".tmp-{os.getpid()}-{target.name}")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write text as UTF-8."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_json(path: str | Path, value: object) -> None:
    """Write JSON with sorted keys, so that equal values give equal bytes."""
    write_text(path, json.dumps(value, indent=2, sort_keys=True, ensure_ascii=False) + "\n")


def read_json(path: str | Path) -> Any:
    """Read JSON.

    Raises
    ------
    InputError
        For a file that is not whole.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise _damaged(path, error) from error


def read_yaml(path: str | Path) -> Any:
    """Read YAML with the safe loader.

    Raises
    ------
    InputError
        For text that is no YAML.
    """
    import yaml

    try:
        # The loader in C is as safe and much faster, but not everywhere built.
        loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        return yaml.load(Path(path).read_text(encoding="utf-8"), Loader=loader)
    except yaml.YAMLError as error:
        raise InputError(str(path), f"it is no valid YAML ({error})", "Correct the line named") from error


def write_tree(path: str | Path, tree: Mapping[str, Mapping[str, NDArray[np.generic]]]) -> None:
    """Write arrays named ``<branch>/<name>`` as one NumPy archive, as ``numpy.savez`` does."""
    # Stored as it is: noise hardly compresses, and packing and unpacking took longer than many an algorithm.
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
        for branch, arrays in tree.items():
            for name, value in arrays.items():
                with archive.open(f"{branch}/{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, np.asanyarray(value), allow_pickle=False)


def read_tree(path: str | Path, only: Collection[str] | None = None) -> Tree:
    """Read arrays named ``<branch>/<name>``; a name may itself hold slashes only in its branch.

    Parameters
    ----------
    path
        The archive.
    only
        Names of the arrays that are read; None: all of them.

    Raises
    ------
    InputError
        For a file that is not whole, or that is no such archive.
    """
    tree: Tree = {}
    try:
        with np.load(path, allow_pickle=False) as archive:
            for key in archive.files:
                branch, _, name = key.rpartition("/")
                if only is None or name in only:
                    tree.setdefault(branch, {})[name] = archive[key]
    except (zipfile.BadZipFile, ValueError, EOFError, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise _damaged(path, error) from error
    return tree


def write_errors(
    path: str | Path, columns: Mapping[str, NDArray[np.generic]], skipped: Mapping[str, str]
) -> None:
    """Write raw errors as Parquet; ``skipped`` maps a family to the reason why nothing ran on it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table(dict(columns)).replace_schema_metadata(
        {"skipped": json.dumps(dict(skipped), sort_keys=True)}
    )
    with replacing(path) as temporary:
        pq.write_table(table, temporary)


def read_errors(path: str | Path) -> tuple[dict[str, NDArray[np.generic]], dict[str, str]]:
    """Read what `write_errors` wrote: the columns, and the families that were skipped with reasons.

    Raises
    ------
    InputError
        For a file that is not whole.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowInvalid, OSError) as error:
        if isinstance(error, FileNotFoundError):
            raise
        raise _damaged(path, error) from error
    # Few families have many samples: each word is made once.
    family = table["family"].combine_chunks().dictionary_encode()
    words = np.asarray(family.dictionary.to_pylist(), dtype=np.str_)
    columns = {
        name: words[family.indices.to_numpy()] if name == "family" else table[name].to_numpy()
        for name in table.column_names
    }
    return columns, json.loads((table.schema.metadata or {}).get(b"skipped", b"{}"))


def _damaged(path: str | Path, error: Exception) -> InputError:
    return InputError(
        str(path),
        f"the file is damaged or cut short ({type(error).__name__}: {error})".rstrip(".)") + ")",
        "Delete it and call snakemake again: only this file and what depends on it is made anew",
    )
