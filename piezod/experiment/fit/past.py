"""What a stage did before a record began, as far as the record tells.

Hysteresis forgets: once a drive has been near both of its ends, nothing that was before matters.
Until then the memory may be wrong, unless the record begins at the lowest drive, as from rest.
"""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

NEAR = 0.05
"""Part of its range by which a drive may stay away from an end."""
LONGEST_SHARE = 0.2
"""Part of a record that may be given up; what takes longer than that is taken as it is."""


def with_past(record: Record) -> Record:
    """Return a record that leaves out what its past may change, and knows how it began.

    Args:
        record: A record as it was read.
    """
    drive = _share(record.drive_v)
    began_at_an_end = not NEAR <= float(_share(record.position_um)[0]) <= 1.0 - NEAR
    seen = replace(record, from_rest=began_at_an_end)
    if drive[0] <= NEAR:
        return seen
    low, high = drive <= NEAR, drive >= 1.0 - NEAR
    forgotten = max(int(np.argmax(low)), int(np.argmax(high)))
    if forgotten > LONGEST_SHARE * drive.size:
        return seen
    return seen.after(float(record.t_s[forgotten] - record.t_s[0]))


def _share(values: FloatArray) -> FloatArray:
    share: FloatArray = (values - values.min()) / np.ptp(values)
    return share
