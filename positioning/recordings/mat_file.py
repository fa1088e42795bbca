"""Files of MATLAB, for the adapters."""

from pathlib import Path
from typing import Any

from scipy.io import loadmat


def read_mat(path: str | Path, *, squeeze: bool = False) -> dict[str, Any]:
    """Return the variables of a MATLAB file by name; a struct has its fields as attributes.

    Parameters
    ----------
    path
        The file.
    squeeze
        Whether to leave out axes of length one, of which MATLAB gives every number two.

    Raises
    ------
    ValueError
        For a file that SciPy cannot read: damaged, none of MATLAB, or one of its version 7.3.
    """
    try:
        found: dict[str, Any] = loadmat(path, squeeze_me=squeeze, struct_as_record=False)
    except NotImplementedError as error:
        raise ValueError("it is a file of MATLAB's version 7.3; older ones are read") from error
    # A damaged file makes SciPy fail in many ways, down to its decompressor.
    except Exception as error:
        raise ValueError(str(error) or type(error).__name__) from error
    return found
