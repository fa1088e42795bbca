"""What is looked at in a recorded drive whose GPS is cut out: errors in the outage, innovations of GPS.

See Mirzababaei & Akbari, section 3; the paper has no recording, and prints no figure of a flight.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from positioning.evaluation.studies.sar_flight import of_outage, outage
from positioning.evaluation.tracks import answers, lines, table
from positioning.files import Tree


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return what is looked at of every row and recording, columns ``MEASURES``.

    See Mirzababaei & Akbari, section 3. The errors in the outage are those of `sar_flight.of_outage`, against
    the reference of the recording; a recording without an outage has none. ``nis_gps`` is the normalised
    innovation squared of GPS per degree of freedom, of rows that use it: 1 where the filter's deviations of
    GPS are right, less where they are too large.

    Parameters
    ----------
    estimates
        Archives of all rows by path; the row is the name of the folder.
    worlds
        Archives of the recordings by path, ``.../<batch>/<side>.npz``.
    """
    parts = []
    for answer in answers(estimates, worlds):
        if "recording.gps_outage_s" in answer.observed:
            _, error_m, inside = outage(answer)
            parts.append(lines(answer, of_outage(answer, error_m, inside)))
        if "extra_nis_gps" in answer.estimates:
            nis = np.asarray(answer.estimates["extra_nis_gps"], dtype=float)
            parts.append(lines(answer, [("nis_gps", nis)]))
    return table(parts)
