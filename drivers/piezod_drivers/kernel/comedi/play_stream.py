"""The bytes of a play, and of its record: what fits into the card's buffers is carried each cycle.

Nothing here needs numpy: it runs in the loop.
"""

from collections.abc import Iterator
from typing import Final

MOST_SCANS: Final = 2_000_000
"""Longest record, in scans; later scans are only counted."""


class OutStream:
    """The codes of a play in their order, without a copy of each cycle.

    Args:
        lead_in: Bytes that are played once.
        period: Bytes of one period.
        cycles: Number of periods.
    """

    def __init__(self, lead_in: bytes, period: bytes, cycles: int) -> None:
        self._parts = self._all(memoryview(lead_in), memoryview(period), cycles)
        self._rest = memoryview(b"")
        self.n_sent = 0
        """Number of bytes that the card's buffer has taken."""
        self.n_bytes = len(lead_in) + len(period) * cycles
        """Number of all bytes."""

    @property
    def complete(self) -> bool:
        """Whether all bytes were taken."""
        return self.n_sent == self.n_bytes

    def next(self) -> memoryview:
        """Return the next bytes, some of them; none at the end. Real-time safe."""
        while not self._rest:
            part = next(self._parts, None)
            if part is None:
                break
            self._rest = part
        return self._rest

    def took(self, n: int) -> None:
        """Note that the card has taken so many bytes of `next`. Real-time safe."""
        self._rest = self._rest[n:]
        self.n_sent += n

    @staticmethod
    def _all(lead_in: memoryview, period: memoryview, cycles: int) -> Iterator[memoryview]:
        yield lead_in
        for _ in range(cycles):
            yield period


class InStream:
    """The samples of a play.

    Args:
        scan_bytes: Number of bytes of a scan.
        n_scans: Number of scans that are to come.
    """

    def __init__(self, scan_bytes: int, n_scans: int) -> None:
        self._scan_bytes, self._n_scans = scan_bytes, n_scans
        self._chunks: list[bytes] = []
        self._n_kept = self.n_bytes = 0
        self.newest = b""
        """The last complete scan; empty before the first one."""
        self._tail = b""

    @property
    def complete(self) -> bool:
        """Whether all scans have come."""
        return self.n_bytes >= self._n_scans * self._scan_bytes

    def add(self, data: bytes) -> None:
        """Append samples. Real-time safe."""
        self.n_bytes += len(data)
        if self._n_kept < MOST_SCANS * self._scan_bytes:
            self._chunks.append(data)
            self._n_kept += len(data)
        self._tail = (self._tail + data)[-2 * self._scan_bytes :]
        whole = len(self._tail) - self.n_bytes % self._scan_bytes
        if whole >= self._scan_bytes:
            self.newest = self._tail[whole - self._scan_bytes : whole]

    def kept(self) -> bytes:
        """Return the bytes of all whole scans that were kept."""
        data = b"".join(self._chunks)[: MOST_SCANS * self._scan_bytes]
        return data[: len(data) // self._scan_bytes * self._scan_bytes]
