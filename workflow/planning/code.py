"""Which source files a job runs: the walk over local imports that keeps results from going stale."""

import ast
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path

LOCAL = ("algorithms", "positioning")


def code_of(*sources: str) -> list[str]:
    """Return the given source files and every local module that they import, however deep.

    Only files inside the project count; installed libraries are pinned by the lock file. The walk
    reads import statements, so a module that is imported by a computed name must be given.

    Parameters
    ----------
    sources
        Paths relative to the project's folder.
    """
    found: dict[str, None] = {}
    waiting = list(sources)
    while waiting:
        source = waiting.pop()
        if source not in found:
            found[source] = None
            waiting.extend(_imports(source))
    return sorted(found)


@cache
def _imports(source: str) -> tuple[str, ...]:
    files: list[str] = []
    for node in ast.walk(ast.parse(Path(source).read_text(encoding="utf-8"), source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            if name.split(".")[0] in LOCAL:
                files.extend(_files(name))
    return tuple(files)


def _files(module: str) -> list[str]:
    """Return the file of a module and the package files that importing it runs on the way."""
    parts = module.split(".")
    packages = [Path(*parts[:depth], "__init__.py") for depth in range(1, len(parts) + 1)]
    return [str(path) for path in (*packages, Path(*parts).with_suffix(".py")) if path.is_file()]


def constructor_parameters(source: str, class_name: str) -> list[str] | None:
    """Return the keyword-only parameters of a class's constructor without importing it.

    None where the class writes no constructor of its own: then only the import can tell.
    """
    for node in ast.parse(Path(source).read_text(encoding="utf-8"), source).body:
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            for item in node.body:
                if isinstance(item, ast.FunctionDef) and item.name == "__init__":
                    return [argument.arg for argument in item.args.kwonlyargs]
    return None


def first_line(source: str, class_name: str) -> str:
    """Return the first line of a class's docstring without importing it; empty where there is none."""
    for node in ast.parse(Path(source).read_text(encoding="utf-8"), source).body:
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            return (ast.get_docstring(node) or "").partition("\n")[0]
    return ""


@cache
def missing_of_library(dotted: str) -> tuple[str, tuple[str, ...]] | None:
    """Say which part of a library's dotted name does not exist, without importing the library.

    Parameters
    ----------
    dotted
        The name of a class, ``sklearn.svm.SVR``.

    Returns
    -------
    tuple or None
        The part, and the names that stand in its place; None where all exist, or where only the import can
        tell.
    """
    *modules, name = dotted.split(".")
    spec = find_spec(modules[0])
    for depth in range(1, len(modules)):
        if spec is None:
            return ".".join(modules[:depth]), ()
        if spec.submodule_search_locations is None:
            return None
        spec = PathFinder.find_spec(".".join(modules[: depth + 1]), spec.submodule_search_locations)
    if spec is None:
        return ".".join(modules), ()
    names = _names(spec.origin) if spec.origin and spec.origin.endswith(".py") else None
    return (dotted, names) if names is not None and name not in names else None


def _names(source: str) -> tuple[str, ...] | None:
    """Return the names that a module defines or imports; None where it has others, too."""
    names: list[str] = []
    for node in ast.walk(ast.parse(Path(source).read_text(encoding="utf-8"), source)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names.extend(alias.asname or alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ClassDef | ast.FunctionDef):
            names.append(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append(node.id)
    return None if {"*", "__getattr__"} & set(names) else tuple(names)
