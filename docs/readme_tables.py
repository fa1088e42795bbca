"""Take the summary and the picture of a full build over into the README: ``python docs/readme_tables.py``."""

import sys
from pathlib import Path

from positioning.errors import InputError
from positioning.files import replacing, write_text

START, END = "<!-- summary:start -->", "<!-- summary:end -->"
SUMMARY = Path("reports/summary.md")
PICTURE = Path("results/figures/fingerprint_loo/table1.svg")
README = Path("README.md")
SHOWN = Path("docs/images/table1.svg")


def block(text: str) -> str:
    """Return what stands between the markers of a text, without surrounding blank lines.

    Raises
    ------
    InputError
        Unless both markers stand in the text once, in their order.
    """
    return _parts(text)[1].strip()


def with_block(text: str, content: str) -> str:
    """Return the text with ``content`` between its markers, and nothing else changed.

    Raises
    ------
    InputError
        Unless both markers stand in the text once, in their order.
    """
    before, _, after = _parts(text)
    return f"{before}{START}\n{content.strip()}\n{END}{after}"


def main(root: Path = Path()) -> None:
    """Replace the README's tables and its picture by those of the last full build.

    Parameters
    ----------
    root
        The project's folder.

    Raises
    ------
    InputError
        Where no full build was made; nothing is changed then.
    """
    for path in (SUMMARY, PICTURE):
        if not (root / path).is_file():
            raise InputError(str(path), "there is no such file", "Build the full report first, with `make`")
    picture = (root / PICTURE).read_bytes()
    summary = (root / SUMMARY).read_text(encoding="utf-8")
    readme = with_block((root / README).read_text(encoding="utf-8"), summary)
    with replacing(root / SHOWN) as temporary:
        temporary.write_bytes(picture)
    write_text(root / README, readme)


def _parts(text: str) -> tuple[str, str, str]:
    before, start, rest = text.partition(START)
    inside, end, after = rest.partition(END)
    if not (start and end) or START in rest or END in after:
        raise InputError(
            "README.md",
            "the two summary markers do not stand there once each, in order",
            f"Write {START} and {END}",
        )
    return before, inside, after


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"Error. {error}")
