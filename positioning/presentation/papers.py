"""What the papers report, as pages and tables need it."""

from collections.abc import Iterable, Mapping
from typing import Any

from positioning.files import read_yaml


def read_papers(files: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the papers of ``data/papers`` by their keys, in the order of the files."""
    return {paper["key"]: paper for paper in map(read_yaml, files)}


def kinds_of(papers: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Return the kind of each claim of some papers, such as ``value`` or ``ordering``, by its id."""
    return {claim["id"]: claim["kind"] for paper in papers for claim in paper.get("claims", [])}
