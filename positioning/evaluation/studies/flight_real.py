"""What is looked at in a recorded drive whose GPS is cut out: the errors in the outage.

See Mirzababaei & Akbari, section 3; the paper has no recording, and prints no figure of a flight.
"""

from collections.abc import Mapping

import pandas as pd

from positioning.evaluation.studies.sar_flight import of_outage, outage
from positioning.evaluation.tracks import answers, lines, table
from positioning.files import Tree


def measures(estimates: Mapping[str, Tree], worlds: Mapping[str, Tree]) -> pd.DataFrame:
    """Return the errors in the outage of every row and recording, columns ``MEASURES``.

    See Mirzababaei & Akbari, section 3. They are those of `sar_flight.of_outage`, against the reference of
    the recording; a recording without an outage has none.

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
    return table(parts)
