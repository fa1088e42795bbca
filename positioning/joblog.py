"""A job's log: everything it prints, and why it failed, in one file that Snakemake shows."""

import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path

from positioning.errors import InputError


@contextmanager
def logging_to(path: str | Path) -> Iterator[None]:
    """Write what the block prints to a file; an error ends the process after it was written there.

    Wrong input is told in one line, without the trace of calls that a program's own fault deserves.
    """
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", encoding="utf-8") as log, redirect_stdout(log), redirect_stderr(log):
        try:
            yield
        except InputError as error:
            print(f"Error. {error}", file=log)
            sys.exit(1)
        except Exception:
            traceback.print_exc(file=log)
            sys.exit(1)
