"""The emulated LC.400: its registers, and the stages behind some of them."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import EmulatorPlugin
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import (
    FULL_SCALE,
    HALF_SCALE,
    Lc400FrameError,
    Lc400Register,
    Lc400Request,
)

RANGE_UM: Final = 30
"""Positions go from minus to plus half of this range."""
MID_UM: Final = 13.0
"""Displacement from rest at position 0, in µm."""
MID_V: Final = 75.0
V_PER_PCT: Final = 1.5
"""Commands of -50 % and 50 % drive 0 V and 150 V at the actuator."""
_WORD_BYTES: Final = 4
_MOST_WORDS: Final = 1 << 16
"""Further words are not stored and read as 0."""
_INCOMPLETE_NS: Final = 50_000_000
"""An incomplete request is dropped after this time; not confirmed."""


class Lc400:
    """A controller whose servos are off.

    Args:
        bench: The rig; its axes are the first channels.
        serial: Version in the firmware's name, "" for the usual one.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:
        self._bench = bench
        self._got, self._got_ns = b"", 0
        self._next = 0
        self._words: dict[int, int] = {}
        axes = range(bench.n_axes)
        self._positions = {codec.register_address(i + 1, Lc400Register.POSITION): i for i in axes}
        self._setpoints = {codec.register_address(i + 1, Lc400Register.SETPOINT): i for i in axes}
        for i in axes:
            self._words[codec.register_address(i + 1, Lc400Register.RANGE)] = RANGE_UM
            # The rig may already be driven, by an earlier emulator.
            counts = round((bench.drive_v(i) - MID_V) / V_PER_PCT / 100 * FULL_SCALE)
            self._words[codec.register_address(i + 1, Lc400Register.SETPOINT)] = counts
        name = f"LC400 {serial or '1.0'}".ljust(4 * codec.FIRMWARE_WORDS)[
            : 4 * codec.FIRMWARE_WORDS
        ]
        for i, word in enumerate(_words_of(name.encode("ascii", "replace"))):
            self._words[codec.FIRMWARE + _WORD_BYTES * i] = word

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete request, with all replies in one piece."""
        now_ns = self._bench.now_ns()
        if now_ns - self._got_ns > _INCOMPLETE_NS:
            self._got = b""
        self._got, self._got_ns = self._got + data, now_ns
        replies: list[bytes] = []
        while length := codec.request_length(self._got):
            frame, self._got = self._got[: abs(length)], self._got[abs(length) :]
            if length > 0:
                replies += self._execute(frame)
        return [b"".join(replies)] if replies else []

    def due(self) -> list[bytes]:
        """Return nothing: the controller only replies."""
        return []

    def _execute(self, frame: bytes) -> list[bytes]:
        try:
            request, address, value = codec.parse_request(frame)
        except Lc400FrameError:
            return []
        if request is Lc400Request.READ:
            return [codec.read_reply(address, self._read(address))]
        if request is Lc400Request.READ_ARRAY:
            n = value if value <= codec.MOST_WORDS else 0
            addresses = (address + _WORD_BYTES * i & 0xFFFFFFFF for i in range(n))
            return [codec.array_reply(address, [self._read(one) for one in addresses])]
        self._write(self._next if request is Lc400Request.WRITE_NEXT else address, value)
        return []

    def _read(self, address: int) -> int:
        axis = self._positions.get(address)
        if axis is None:
            return self._words.get(address, 0)
        position_um = self._bench.position_um(axis)
        if not isfinite(position_um):
            # A sensor without signal is at the end of its range.
            return HALF_SCALE
        counts = round((position_um - MID_UM) / RANGE_UM * FULL_SCALE)
        return max(-HALF_SCALE, min(counts, HALF_SCALE))

    def _write(self, address: int, value: int) -> None:
        # `WRITE_NEXT` continues behind the last written word.
        self._next = address + _WORD_BYTES & 0xFFFFFFFF
        axis = self._setpoints.get(address)
        if axis is not None:
            value = max(-HALF_SCALE, min(value, HALF_SCALE))
            self._bench.drive(axis, MID_V + value / FULL_SCALE * 100 * V_PER_PCT)
        if address in self._words or len(self._words) < _MOST_WORDS:
            self._words[address] = value


def _words_of(text: bytes) -> Sequence[int]:
    return [
        int.from_bytes(text[i : i + _WORD_BYTES], "little", signed=True)
        for i in range(0, len(text), _WORD_BYTES)
    ]


EMULATOR: Final = EmulatorPlugin(
    name="lc400",
    summary="nPoint LC.400 controller in open loop, 30 µm, 0 to 150 V",
    wire="serial",
    create=Lc400,
)
