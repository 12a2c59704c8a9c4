"""The compiled firmware on an emulated processor, cycle by cycle: `firmware/player/emulated`."""

import ctypes
from collections.abc import Callable
from ctypes import CFUNCTYPE, POINTER, c_char_p, c_int, c_uint, c_uint64, c_void_p
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final

from piezod.errors import DeviceUnavailableError
from piezod_drivers.serial_line.piezo_board.emulation.build import Built

CLOCK_HZ: Final = 16_000_000
_MOST_BYTES: Final = 65_536

Drive = Callable[[int, int, int], None]
"""Is called when the DAC sets an output: channel, code, cycle."""
Sense = Callable[[int, int], int]
"""Returns the code of an input when the ADC converts: channel, cycle."""
_DRIVE: Final = CFUNCTYPE(None, c_int, c_uint, c_uint64)
_SENSE: Final = CFUNCTYPE(c_uint, c_int, c_uint64)


class Seen(ctypes.Structure):
    """What the converters and the lines have seen since `Processor.forget`."""

    _fields_: ClassVar = [
        (name, c_uint64)
        for name in ("points", "lines", "frames", "bad_frames", "sets", "shortest", "longest")
    ]
    points: int  #: Pulses of the lines.
    lines: int
    frames: int
    bad_frames: int  #: Frames that the DAC has not understood, and two ADCs that speak at a time.
    sets: int  #: Times that an output was set.
    shortest: int  #: Cycles between two points of a play.
    longest: int


class Processor:
    """An ATmega1284P with the firmware, and the converters beside it.

    Args:
        built: The compiled board.
        name: Name that is stored in the processor; "" for none.
        drive: Is called when an output is set.
        sense: Returns the code of an input.

    Raises:
        DeviceUnavailableError: If it cannot be loaded.
    """

    def __init__(self, built: Built, name: str, drive: Drive, sense: Sense) -> None:
        self._library = library = _load(built.board)
        self._callbacks = _DRIVE(drive), _SENSE(sense)  # kept as long as they may be called
        self._buffer = ctypes.create_string_buffer(_MOST_BYTES)
        firmware = str(built.firmware).encode()
        self._board = library.board_new(firmware, name.encode(), *self._callbacks)
        if not self._board:
            raise DeviceUnavailableError(f"simavr cannot load {built.firmware}")

    def __del__(self) -> None:
        """Free the memory of the processor."""
        if getattr(self, "_board", None):
            self._library.board_free(self._board)

    @property
    def cycle(self) -> int:
        """Present cycle."""
        return int(self._library.board_cycle(self._board))

    @property
    def plays(self) -> bool:
        """Whether the line that tells of a play is high."""
        return bool(self._library.board_plays(self._board))

    @property
    def seen(self) -> Seen:
        """What the converters and the lines have seen."""
        seen = self._library.board_seen(self._board)
        assert isinstance(seen, Seen)  # noqa: S101 - for the type checker
        return seen

    def forget(self) -> None:
        """Count anew."""
        self._library.board_forget(self._board)

    def run(self, until: int, *, until_idle: bool = False) -> None:
        """Run until a cycle, or until the firmware has taken all bytes and sleeps.

        Raises:
            DeviceUnavailableError: If the firmware has crashed, or sleeps for ever.
        """
        if not self._library.board_run(self._board, until, int(until_idle)):
            what = "crashed, or sleeps without interrupts"
            raise DeviceUnavailableError(f"the firmware has {what}, at cycle {self.cycle}")

    def feed(self, data: bytes) -> None:
        """Put bytes on the line to the board."""
        self._library.board_feed(self._board, data, len(data))

    def take(self) -> bytes:
        """Return the bytes that the board has sent."""
        n = self._library.board_take(self._board, self._buffer, _MOST_BYTES)
        return self._buffer.raw[:n]

    def reset(self) -> None:
        """Reset the processor; the converters keep their values."""
        self._library.board_reset(self._board)

    def edge(self) -> None:
        """Give an edge at the trigger input."""
        self._library.board_edge(self._board)

    def camera(self, first: int, every: int, edges: int) -> None:
        """Give edges at the trigger input: the first one at a cycle, the others so many later."""
        self._library.board_camera(self._board, first, every, edges)


@cache
def _load(path: Path) -> Any:
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise DeviceUnavailableError(f"the emulated board cannot be loaded: {error}") from error
    library.board_new.restype = c_void_p
    library.board_new.argtypes = [c_char_p, c_char_p, _DRIVE, _SENSE]
    library.board_cycle.restype = c_uint64
    library.board_seen.restype = Seen
    library.board_run.argtypes = [c_void_p, c_uint64, c_int]
    library.board_camera.argtypes = [c_void_p, c_uint64, c_uint64, c_uint]
    library.board_feed.argtypes = [c_void_p, c_char_p, c_uint]
    library.board_take.argtypes = [c_void_p, POINTER(ctypes.c_char), c_uint]
    for name in ("free", "reset", "forget", "edge", "plays", "cycle", "seen"):
        getattr(library, f"board_{name}").argtypes = [c_void_p]
    return library
