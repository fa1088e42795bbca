"""Real recordings are not part of the repository: finds which are there, and says what is not."""

import csv
import sys
from dataclasses import replace
from pathlib import Path

from planning.study import Study

REGISTER = Path("data/sources.csv")


def files_of(source: str, realdata: Path) -> list[str]:
    """Return the files of a source: those in the register, else all that its folder holds."""
    with REGISTER.open(encoding="utf-8", newline="") as lines:
        files = [row["file"] for row in csv.DictReader(lines) if row["source"] == source]
    folder = realdata / source
    return [str(folder / file) for file in files] or sorted(str(p) for p in folder.glob("*") if p.is_file())


def registered_sources() -> set[str]:
    """Return the sources that the register knows."""
    with REGISTER.open(encoding="utf-8", newline="") as lines:
        return {row["source"] for row in csv.DictReader(lines)}


def drop_absent(studies: dict[str, Study], realdata: Path) -> dict[str, Study]:
    """Return the studies without recordings whose files are absent, with one line on each study."""
    kept = {}
    for name, study in studies.items():
        present, missing = {}, {}
        for recording, options in study.recordings.items():
            files = files_of(options["source"], realdata)
            absent = [file for file in files if not Path(file).is_file()]
            if files and not absent:
                present[recording] = options
            else:
                missing[recording] = (absent or [str(realdata / options["source"])])[0]
        if missing:
            first = next(iter(missing))
            registered = study.recordings[first]["source"] in registered_sources()
            cure = (
                f"{REGISTER} tells where to get it" if registered else "make this folder or correct `source`"
            )
            print(
                f"{name}: {', '.join(missing)} skipped, {missing[first]} is absent; {cure};"
                " folders.realdata names the folder above it",
                file=sys.stderr,
            )
        if present or not study.recordings:
            kept[name] = replace(study, recordings=present)
    return kept
