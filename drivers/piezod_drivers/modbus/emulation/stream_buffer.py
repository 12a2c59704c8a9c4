"""The samples of an emulated LabJack's stream that wait to be sent, and their packets."""

from collections import deque
from collections.abc import Sequence
from struct import Struct
from typing import Final

from piezod_drivers.modbus.emulation.unit import FEEDBACK
from piezod_drivers.modbus.profiles.labjack_stream import (
    COMPLETE,
    LOST,
    RECOVERED,
    RECOVERING,
    SKIPPED_TOO_MANY,
)

_HEADER: Final = Struct(">HHHBBBBHHH")
"""Number, protocol, bytes that follow, unit, function, type, reserved, backlog, status, extra."""
_COUNTED: Final = 10
"""Bytes of the header that its length counts."""
_TYPE: Final = 16
_MOST: Final = 0xFFFF


class StreamBuffer:
    """The samples that wait, and the scans that were lost because there was no room.

    When it is full, scans are lost until half of it is free. One scan of 0xFFFF then stands for
    them, and its packet has their number.

    Args:
        capacity: Number of samples for which there is room.
        per_packet: Number of samples in a packet.
    """

    def __init__(self, capacity: int, per_packet: int) -> None:
        self._capacity, self._per_packet = capacity, per_packet
        self._samples: deque[int] = deque()
        self._taken = self._number = self._skipped = 0
        self._gaps: deque[tuple[int, int]] = deque()
        self._end = self._n_in_scan = 0

    def add(self, scan: Sequence[int]) -> None:
        """Store the samples of a scan, or lose them."""
        free, self._n_in_scan = self._capacity - len(self._samples), len(scan)
        if self._skipped and free >= max(self._capacity // 2, 2 * len(scan)):
            self._note_gap(len(scan))
            free -= len(scan)
        if self._skipped or free < len(scan):
            self._skipped += 1
            return
        self._samples.extend(scan)

    def end(self, status: int) -> None:
        """Send what is left, the last packet with this status; nothing is added any more."""
        if self._skipped:
            self._note_gap(self._n_in_scan)
        self._end = status

    def packet(self) -> bytes:
        """Return the next packet; nothing if none is complete."""
        n_samples = min(self._per_packet, len(self._samples))
        if n_samples < self._per_packet and not self._end:
            return b""
        samples = [self._samples.popleft() for _ in range(n_samples)]
        status, extra = self._status_of(n_samples)
        self._taken += n_samples
        backlog = min(2 * len(self._samples), _MOST)
        body = Struct(f">{n_samples}H").pack(*samples)
        length = _COUNTED + len(body)
        head = (self._number, 0, length, 1, FEEDBACK, _TYPE, 0, backlog, status, extra)
        self._number = (self._number + 1) & _MOST
        return _HEADER.pack(*head) + body

    def _note_gap(self, n_samples: int) -> None:
        # Place of the first sample of the gap, counted from the start of the stream.
        self._gaps.append((self._taken + len(self._samples), self._skipped))
        self._samples.extend([LOST] * n_samples)
        self._skipped = 0

    def _status_of(self, n_samples: int) -> tuple[int, int]:
        """Return status and extra of the next packet; the samples are taken already."""
        if self._gaps and self._gaps[0][0] < self._taken + n_samples:
            _, skipped = self._gaps.popleft()
            return (RECOVERED, skipped) if skipped <= _MOST else (SKIPPED_TOO_MANY, _MOST)
        if self._end and not self._samples:
            status, self._end = self._end, 0
            return status, n_samples if status == COMPLETE else 0
        return (RECOVERING, 0) if self._skipped else (0, 0)
