"""The emulated LC.400: its registers, and the stages behind some of them."""

from collections.abc import Sequence
from struct import pack
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
from piezod_drivers.serial_line.npoint_lc400.emulation.wavetables import (
    MID_V,
    RANGE_UM,
    V_PER_PCT,
    Wavetables,
    position_counts,
)

_WORD_BYTES: Final = 4
_MOST_WORDS: Final = 1 << 20
"""Further words are not stored and read as 0; all wavetables and buffers have fewer."""
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
        self._setpoints = {codec.register_address(i + 1, Lc400Register.SETPOINT) for i in axes}
        self._loops = {codec.register_address(i + 1, Lc400Register.LOOP_INPUT): i for i in axes}
        for i in axes:
            self._words[codec.register_address(i + 1, Lc400Register.RANGE)] = RANGE_UM
            # The rig may already be driven, by an earlier emulator.
            counts = round((bench.drive_v(i) - MID_V) / V_PER_PCT / 100 * FULL_SCALE)
            counts = max(-HALF_SCALE, min(counts, HALF_SCALE))
            self._words[codec.register_address(i + 1, Lc400Register.SETPOINT)] = counts
            scale = codec.register_address(i + 1, Lc400Register.INVERSE_SCALE)
            self._words[scale] = int.from_bytes(pack("<f", 1.0), "little")
        name = f"LC400 {serial or '1.0'}".ljust(4 * codec.FIRMWARE_WORDS)[
            : 4 * codec.FIRMWARE_WORDS
        ]
        for i, word in enumerate(_words_of(name.encode("ascii", "replace"))):
            self._words[codec.FIRMWARE + _WORD_BYTES * i] = word
        self.wavetables = Wavetables(bench, self._words)

    def receive(self, data: bytes) -> list[bytes]:
        """Reply to every complete request, with all replies in one piece."""
        self.wavetables.advance()
        now_ns = self._bench.now_ns()
        if now_ns - self._got_ns > _INCOMPLETE_NS:
            self._got = b""
        self._got, self._got_ns = self._got + data, now_ns
        replies: list[bytes] = []
        while length := codec.request_length(self._got):
            frame, self._got = self._got[: abs(length)], self._got[abs(length) :]
            if length > 0:
                replies += self._execute(frame)
        self.wavetables.settle()
        return [b"".join(replies)] if replies else []

    def due(self) -> list[bytes]:
        """Return nothing: the controller only replies."""
        self.wavetables.advance()
        return []

    def _execute(self, frame: bytes) -> list[bytes]:
        try:
            request, address, value = codec.parse_request(frame)
        except Lc400FrameError:
            return []
        if request in {Lc400Request.READ, Lc400Request.READ_ARRAY}:
            # `WRITE_NEXT` would continue behind this word.
            self._next = address + _WORD_BYTES & 0xFFFFFFFF
        if request is Lc400Request.READ:
            return [codec.read_reply(address, self._read(address))]
        if request is Lc400Request.READ_ARRAY:
            n = value if value <= codec.MOST_WORDS else 0
            addresses = (address + _WORD_BYTES * i & 0xFFFFFFFF for i in range(n))
            return [codec.array_reply(address, [self._read(one) for one in addresses])]
        self._write(self._next if request is Lc400Request.WRITE_NEXT else address, value)
        return []

    def _read(self, address: int) -> int:
        if address in self._loops:
            return self.wavetables.loop_input(self._loops[address])
        axis = self._positions.get(address)
        if axis is None:
            return self._words.get(address, 0)
        return position_counts(self._bench.position_um(axis))

    def _write(self, address: int, value: int) -> None:
        # `WRITE_NEXT` continues behind the last written word.
        self._next = address + _WORD_BYTES & 0xFFFFFFFF
        if address in self._setpoints:
            value = max(-HALF_SCALE, min(value, HALF_SCALE))
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
