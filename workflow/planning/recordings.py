"""Real recordings are not part of the repository: finds which are there, and says what is not."""

import csv
import sys
from dataclasses import replace
from pathlib import Path

from planning.config import Study

REGISTER = Path("data/sources.csv")


def files_of(source: str, realdata: Path) -> list[str]:
    """Return the files of a source: those in the register, else all that its folder holds."""
    with REGISTER.open(encoding="utf-8", newline="") as lines:
        files = [row["file"] for row in csv.DictReader(lines) if row["source"] == source]
    folder = realdata / source
    return [str(folder / file) for file in files] or sorted(str(p) for p in folder.glob("*") if p.is_file())


def drop_absent(studies: dict[str, Study], realdata: Path) -> dict[str, Study]:
    """Return the studies without recordings whose files are absent, saying so in one line each."""
    kept = {}
    for name, study in studies.items():
        present = {}
        for recording, options in study.recordings.items():
            files = files_of(options["source"], realdata)
            absent = [file for file in files if not Path(file).is_file()]
            if files and not absent:
                present[recording] = options
            else:
                missing = (absent or [realdata / options["source"]])[0]
                print(
                    f"{name}: recording {recording} is skipped, {missing} is absent;"
                    f" {REGISTER} tells where to get it, folders.realdata where it belongs",
                    file=sys.stderr,
                )
        if study.recordings and not present:
            continue
        kept[name] = replace(study, recordings=present)
    return kept
