"""The samples of a LabJack's stream as they come, and the record that they become."""

from collections.abc import Sequence
from typing import Final

from piezod_drivers.modbus.profiles.labjack_stream import (
    COMPLETE,
    ERRORS,
    FULL,
    OVERLAP,
    RECOVERED,
    RECOVERING,
    SKIPPED_TOO_MANY,
    InputScale,
)
from piezod_drivers.modbus.stream_codec import Packet, take_packet, volts

MOST_SCANS: Final = 1 << 22
"""Number of scans that are kept; later ones are only counted."""
_FAILURES: Final = {
    OVERLAP: "a scan began before the one before it had ended: choose a longer interval",
    SKIPPED_TOO_MANY: "more scans were lost than the device can count",
    FULL: "the device's buffer was full: the network or this computer is too slow",
}


class StreamRecord:
    """Collects the packets of one stream.

    Args:
        n_inputs: Number of samples in a scan.
        n_scans: Number of scans of the whole stream.

    Attributes:
        n_scans: Number of scans of the whole stream.
        kept: Samples of each packet, and the number of lost scans for which one scan of it stands.
        n_scans_done: Number of scans so far, the lost ones included.
        complete: Whether the device has reported the last scan.
        failure: Why the stream has failed; empty if it has not.
        first: Codes of the first scan; empty before it.
        newest: Codes of the newest scan; empty before the first.
    """

    def __init__(self, n_inputs: int, n_scans: int) -> None:
        self.n_scans = n_scans
        self._scan_bytes = 2 * n_inputs
        self._got = b""
        self._number = 0
        self.kept: list[tuple[bytes, int]] = []
        self.n_scans_done = 0
        self.complete = False
        self.failure = ""
        self.first: Sequence[int] = ()
        self.newest: Sequence[int] = ()

    def add(self, data: bytes) -> None:
        """Take received bytes. Real-time safe."""
        self._got += data
        while not self.failure:
            try:
                packet, self._got = take_packet(self._got)
            except ValueError as error:
                self.failure = str(error)
                return
            if packet is None:
                return
            self._add_packet(packet)

    def first_v(self, scales: Sequence[InputScale]) -> list[float]:
        """Return the voltages of the first scan, in V; empty before it. Real-time safe."""
        return [volts(code, scale) for code, scale in zip(self.first, scales, strict=False)]

    def newest_v(self, scales: Sequence[InputScale]) -> list[float]:
        """Return the voltages of the newest scan, in V; empty before the first. Real-time safe."""
        return [volts(code, scale) for code, scale in zip(self.newest, scales, strict=False)]

    def _add_packet(self, packet: Packet) -> None:
        number, status, extra, samples = packet
        if number != self._number:
            self.failure = f"packet {number} of the stream came instead of packet {self._number}"
            return
        self._number = (self._number + 1) & 0xFFFF
        if status in _FAILURES:
            self.failure = f"status {status}: {_FAILURES[status]}"
            return
        if status not in {0, RECOVERING, RECOVERED, COMPLETE}:
            self.failure = f"status {status}: {ERRORS.get(status, 'unknown to piezod')}"
            return
        # A last packet may be filled up behind its last scan.
        left = max(self.n_scans - self.n_scans_done, 0) * self._scan_bytes
        samples = samples[: min(len(samples), left)]
        if len(samples) % self._scan_bytes:
            self.failure = f"a packet of {len(samples)} bytes ends within a scan"
            return
        self._keep(samples, extra if status == RECOVERED else 0)
        self.complete |= status == COMPLETE

    def _keep(self, samples: bytes, n_lost: int) -> None:
        n_scans = len(samples) // self._scan_bytes
        if self.n_scans_done < MOST_SCANS:
            room = (MOST_SCANS - self.n_scans_done) * self._scan_bytes
            self.kept.append((samples[:room], n_lost))
        # One scan of the packet stands for all lost ones.
        self.n_scans_done += n_scans + max(n_lost - 1, 0)
        if samples:
            self.newest = self._codes(samples[-self._scan_bytes :])
            self.first = self.first or self._codes(samples[: self._scan_bytes])

    @staticmethod
    def _codes(scan: bytes) -> list[int]:
        return [int.from_bytes(scan[i : i + 2], "big") for i in range(0, len(scan), 2)]
