"""The records around the pulse of a line, for a recording that waits for it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from piezod.daemon.stores.recorded_files import RecordSource
from piezod.telemetry.arrays import Records
from piezod.units import s_to_ns


class Trigger(NamedTuple):
    """What starts and ends a recording."""

    line: str  #: Name of the line whose rising edge starts it.
    bit: int  #: Its bit in the records.
    before_s: float  #: Time before the edge that is recorded, too, in s.
    #: Time after which it ends, in s; None for the falling edge of the line.
    duration_s: float | None


class EdgeSource:
    """Implements `RecordSource` for the records from some time before a rising edge to the end.

    Args:
        reader: Reads the records from now on.
        last: Returns the newest records, at most a given number, oldest first.
        trigger: What starts and ends it.
        rate_hz: Cycles per second.
    """

    def __init__(
        self,
        reader: RecordSource,
        last: Callable[[int], Records],
        trigger: Trigger,
        rate_hz: float,
    ) -> None:
        self._reader, self._last, self._trigger = reader, last, trigger
        self._kept = round((trigger.before_s + 1.0) * rate_hz)  # a second for what has come since
        self._high: bool | None = None
        self._found: Records | None = None
        self.edge_ns = 0
        """Instant of the first cycle in which the line was high, in ns."""
        self.ended = False
        """Whether the last record was read."""

    def seek(self, limit: int) -> bool:
        """Look through new records, at most `limit`; return whether the edge is among them."""
        records, _ = self._reader.read(limit)
        if not len(records):
            return False
        high = self._levels(records)
        before = high[0] if self._high is None else self._high
        rising = np.flatnonzero(high & ~np.concatenate(([before], high[:-1])))
        self._high = bool(high[-1])
        if not rising.size:
            return False
        self.edge_ns = int(records["t_ns"][rising[0]])
        older = self._last(self._kept + len(records))
        found = np.concatenate((older[older["seq"] < records["seq"][0]], records))
        self._found = found[found["t_ns"] >= self.edge_ns - s_to_ns(self._trigger.before_s)]
        return True

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, and the number of lost ones."""
        if self._found is not None:
            (records, lost), self._found = (self._found, 0), None
        else:
            records, lost = self._reader.read(0 if self.ended else limit)
        if self._trigger.duration_s is None:
            ends = (records["t_ns"] > self.edge_ns) & ~self._levels(records)
        else:
            ends = records["t_ns"] >= self.edge_ns + s_to_ns(self._trigger.duration_s)
        if ends.any():
            self.ended, records = True, records[: int(np.argmax(ends)) + 1]
        return records, lost

    def _levels(self, records: Records) -> NDArray[np.bool_]:
        levels: NDArray[np.bool_] = (records["lines"] >> self._trigger.bit & 1).astype(bool)
        return levels
