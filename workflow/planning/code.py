"""What the sources tell without being imported: which files a job runs, and what constructors take."""

import ast
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

LOCAL = ("algorithms", "positioning")
_IMPORT = re.compile(r"\bimport\b")
_QUOTES = ('"""', "'''")


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
    for node in _statements(_import_lines(source)):
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


def _import_lines(source: str) -> ast.Module:
    """Return the import statements of a file, in a twentieth of the time that parsing all of it takes.

    Statements are sought that have the word in their first line and stand by themselves, which lines of
    texts may do, too. A file that has the word in another way, after ``else:`` say, is parsed as a whole,
    and so is one in which a text or a line that goes on begins or ends beside it: without the rest it would
    swallow statements.
    """
    lines = Path(source).read_text(encoding="utf-8").splitlines()
    found = []
    for place, line in enumerate(lines):
        if _IMPORT.search(line):
            goes_on = any(part.endswith("\\") for part in lines[max(0, place - 1) : place + 1])
            if goes_on or any(quotes in line for quotes in _QUOTES):
                return _parsed(source)
            end = place
            while "(" in line and ")" not in lines[end] and end + 1 < len(lines):
                end += 1
            found.append("\n".join([line.strip(), *lines[place + 1 : end + 1]]))
    try:
        return ast.parse("\n".join(found))
    except SyntaxError:
        return _parsed(source)


def _statements(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield all statements, however deep; expressions, most of a tree, hold no imports."""
    waiting = [tree]
    while waiting:
        node = waiting.pop()
        yield node
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            inside = getattr(node, part, None)
            if isinstance(inside, list):
                waiting.extend(inside)


def _files(module: str) -> list[str]:
    """Return the file of a module and the package files that importing it runs on the way."""
    parts = module.split(".")
    packages = [Path(*parts[:depth], "__init__.py") for depth in range(1, len(parts) + 1)]
    return [str(path) for path in (*packages, Path(*parts).with_suffix(".py")) if path.is_file()]


@dataclass(frozen=True)
class Choice:
    """One kind of value that an annotation allows.

    Attributes
    ----------
    kind
        "float", "int", "bool", "str", "None", "value" for one of a `Literal`, or "tuple".
    value
        That of a `Literal`.
    items
        What each member of a tuple may be; the last of them repeats where ``repeats``.
    """

    kind: str
    value: Any = None
    items: tuple["Choices", ...] = ()
    repeats: bool = False


Choices = tuple[Choice, ...] | None
"""What a parameter may be; None where its annotation does not tell, or tells of objects."""


def constructor_parameters(source: str, class_name: str) -> list[str] | None:
    """Return the keyword-only parameters of a class's constructor without importing it.

    The constructor may be that of a base class. None where only the import can tell.
    """
    found = constructor_choices(source, class_name)
    return None if found is None else list(found)


def constructor_choices(source: str, class_name: str) -> dict[str, Choices] | None:
    """Return what each keyword-only parameter of a class's constructor may be, without importing it.

    Annotations are read: numbers, words, truth values, None, `Literal`, tuples and unions of these, also
    where a name stands for them, in this file or in a local one from which it is imported.

    Parameters
    ----------
    source
        The file.
    class_name
        The class; its constructor may be that of a base class.

    Returns
    -------
    dict or None
        None where only the import can tell.
    """
    family = _family(source, class_name)
    for file, node in family:
        if node is None:
            return None
        for item in node.body:
            if isinstance(item, ast.FunctionDef) and item.name == "__init__":
                return {arg.arg: _choices(arg.annotation, file) for arg in item.args.kwonlyargs}
        if node.decorator_list:
            return None
    return {} if family else None


def constructor_defaults(source: str, class_name: str) -> dict[str, Any]:
    """Return the defaults of a class's constructor as far as they are literals, without importing it."""
    for _, node in _family(source, class_name):
        for item in [] if node is None else node.body:
            if isinstance(item, ast.FunctionDef) and item.name == "__init__":
                found = {}
                for argument, default in zip(item.args.kwonlyargs, item.args.kw_defaults, strict=True):
                    with suppress(ValueError):
                        if default is not None:
                            found[argument.arg] = ast.literal_eval(default)
                return found
    return {}


class Keyword(NamedTuple):
    """A keyword-only parameter: what it may be, and whether it must be given."""

    choices: Choices
    needed: bool


def keywords(source: str, function: str) -> dict[str, Keyword] | None:
    """Return the keyword-only parameters of a function of a module without importing it.

    Parameters
    ----------
    source
        The file.
    function
        Its name; it stands on the level of the module.

    Returns
    -------
    dict or None
        None where only the import can tell: it is imported or made there, or takes any name.
    """
    for item in _parsed(source).body:
        if isinstance(item, ast.FunctionDef) and item.name == function and item.args.kwarg is None:
            pairs = zip(item.args.kwonlyargs, item.args.kw_defaults, strict=True)
            return {arg.arg: Keyword(_choices(arg.annotation, source), own is None) for arg, own in pairs}
    return None


def methods(source: str, class_name: str) -> set[str] | None:
    """Return the methods of a class and of its base classes, without importing it.

    None where only the import can tell.
    """
    family = _family(source, class_name)
    if not family or any(node is None for _, node in family):
        return None
    return {
        item.name
        for _, node in family
        if node is not None
        for item in node.body
        if isinstance(item, ast.FunctionDef)
    }


def declares(source: str, class_name: str, attribute: str) -> bool:
    """Tell whether a class, or a local base class of it, sets an attribute to True in its body."""
    return any(
        isinstance(item, ast.Assign)
        and any(isinstance(target, ast.Name) and target.id == attribute for target in item.targets)
        and isinstance(item.value, ast.Constant)
        and item.value.value is True
        for _, node in _family(source, class_name)
        if node is not None
        for item in node.body
    )


def fits(value: Any, choices: Choices) -> bool:
    """Tell whether a value, as YAML gives it, is one of those that a parameter may be."""
    return choices is None or any(_is(value, choice) for choice in choices)


def _is(value: Any, choice: Choice) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if choice.kind == "tuple":
        items = choice.items
        if not isinstance(value, list | tuple):
            return False
        if choice.repeats:
            return all(fits(part, items[0]) for part in value)
        return len(value) == len(items) and all(
            fits(part, item) for part, item in zip(value, items, strict=True)
        )
    if choice.kind == "value":
        return type(value) is type(choice.value) and value == choice.value
    return {
        "float": number,
        "int": number and isinstance(value, int),
        "bool": isinstance(value, bool),
        "str": isinstance(value, str),
        "None": value is None,
    }[choice.kind]


def _choices(node: ast.expr | None, source: str) -> Choices:
    """Return what an annotation allows."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        left, right = _choices(node.left, source), _choices(node.right, source)
        return None if left is None or right is None else left + right
    if isinstance(node, ast.Constant) and node.value is None:
        return (Choice("None"),)
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        inside = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if node.value.id == "Literal":
            if all(isinstance(item, ast.Constant) for item in inside):
                return tuple(Choice("value", item.value) for item in inside if isinstance(item, ast.Constant))
        elif node.value.id == "tuple":
            repeats = isinstance(inside[-1], ast.Constant) and inside[-1].value is ...
            own = inside[:-1] if repeats else inside
            return (Choice("tuple", items=tuple(_choices(item, source) for item in own), repeats=repeats),)
    if isinstance(node, ast.Name):
        if node.id in ("float", "int", "bool", "str"):
            return (Choice(node.id),)
        return _named(node.id, source)
    return None


def _named(name: str, source: str) -> Choices:
    """Return what a name of a type stands for; None for a class, or where the source does not tell."""
    for node in _parsed(source).body:
        if isinstance(node, ast.Assign) and any(
            isinstance(t, ast.Name) and t.id == name for t in node.targets
        ):
            return _choices(node.value, source)
    origin = _origin(name, source)
    return None if origin is None else _named(*origin)


def _origin(name: str, source: str) -> tuple[str, str] | None:
    """Return the name and the file that a name is imported from, where that file is local."""
    for node in _parsed(source).body:
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == name and node.module.split(".")[0] in LOCAL:
                    module = Path(*node.module.split(".")).with_suffix(".py")
                    for folder in Path(source).parents:
                        if (folder / module).is_file():
                            return alias.name, str(folder / module)
    return None


def _family(source: str, class_name: str) -> list[tuple[str, ast.ClassDef | None]]:
    """Return a class with its file, then its base classes, depth first; None for one that is not local."""
    for node in _parsed(source).body:
        if isinstance(node, ast.ClassDef) and node.name == class_name:
            found: list[tuple[str, ast.ClassDef | None]] = [(source, node)]
            for base in node.bases:
                found += _family(source, base.id) if isinstance(base, ast.Name) else [(source, None)]
            return found
    origin = _origin(class_name, source)
    return [(source, None)] if origin is None else _family(origin[1], origin[0])


@cache
def _parsed(source: str) -> ast.Module:
    return ast.parse(Path(source).read_text(encoding="utf-8"), source)


def first_line(source: str, class_name: str) -> str:
    """Return the first line of a class's docstring without importing it; empty where there is none."""
    for node in _parsed(source).body:
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
