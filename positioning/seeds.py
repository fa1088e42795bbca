"""Random streams: every world and every algorithm has one of its own, by name.

A stream depends on names and on the world's seed alone, so no result depends on the number of
worlds in a batch, on the order of jobs, or on which other algorithms run.
"""

from zlib import crc32

import numpy as np


def stream(seed: int, *names: str) -> np.random.Generator:
    """Return a fresh generator for the world ``seed`` and the purpose that ``names`` spell out.

    Parameters
    ----------
    seed
        The world's seed, not negative.
    names
        What the stream is for: the study, and for an algorithm the name of its file or class.
    """
    return np.random.default_rng([seed, *(crc32(name.encode()) for name in names)])
