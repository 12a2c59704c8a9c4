"""Treats the unknown past of a stage before its record.

Hysteresis forgets: after a drive has been near both of its ends, nothing before it matters. Until
then the memory may be wrong, unless the record starts at the lowest drive, as from rest.
"""

from dataclasses import replace

import numpy as np

from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

END_SHARE = 0.05
"""A drive within this share of its range from an end is at that end."""
MAX_DROPPED_SHARE = 0.2
"""Largest share of a record that may be dropped; if more is affected, all of it counts."""


def mark_unknown_past(record: Record) -> Record:
    """Return a record whose start counts only if its past is known, and note how it starts."""
    drive = _share(record.drive_v)
    starts_at_an_end = not END_SHARE <= float(_share(record.position_um)[0]) <= 1.0 - END_SHARE
    marked = replace(record, from_rest=starts_at_an_end)
    if drive[0] <= END_SHARE:
        return marked
    low, high = drive <= END_SHARE, drive >= 1.0 - END_SHARE
    memory_known_at = max(int(np.argmax(low)), int(np.argmax(high)))
    if memory_known_at > MAX_DROPPED_SHARE * drive.size:
        return marked
    return marked.after(float(record.t_s[memory_known_at] - record.t_s[0]))


def _share(values: FloatArray) -> FloatArray:
    share: FloatArray = (values - values.min()) / np.ptp(values)
    return share
