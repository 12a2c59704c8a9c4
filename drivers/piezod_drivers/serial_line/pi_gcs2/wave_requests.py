"""The exchanges with wave generators and data recorder, outside of the loop."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Final, NamedTuple, Protocol

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.player import Check, Comparison
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.gcs.syntax import ASK_ERROR, NUMBER
from piezod_drivers.serial_line.pi_gcs2.array_codec import array_length, array_rows

PER_LINE: Final = 20
"""Points in a command: at most 32 arguments, and 256 characters, in a line."""
TRIGGERS_PER_LINE: Final = 10
"""Points of pulses in a command, three arguments each."""
TRIGGER_MODE, BY_GENERATOR = 3, 4
"""Parameter of a digital output, and its value: it follows the wave generators."""
STEP, AXIS, BY_DISTANCE, START_THRESHOLD, STOP_THRESHOLD = 1, 2, 0, 8, 9
"""Parameters of an output that pulses by the position of an axis, and its mode."""
PER_REPLY: Final = 200
"""Points in a reply with many values."""
IS_PLAYING: Final = b"\x09"
"""Asks for the mask of the running generators."""
MASK: Final = r"((?:0[xX])?[0-9A-Fa-f]{1,8})\n"
_NEAR: Final = 2e-4
"""Largest difference between a value and its read-back: one digit, and a little."""
_SERVO_TIME, _WAVE_POINTS, _RECORD_POINTS = "E000200", "13000004", "16000200"
_RECORD_TABLES: Final = "16000300"
_WHOLE: Final = r"([0-9]{1,9})\n"


class PlayHost(Protocol):
    """What a player uses of the dialogue."""

    conversation: Conversation  #: Requests and replies.
    slow_ns: int  #: Longest wait for a reply outside of the loop, in ns.
    wiring: Wiring  #: The channels in use.
    numbers: Sequence[str]  #: Number of the generator and of the piezo channel of each output.

    def ask_slowly(self, request: bytes, reply: GcsReply) -> list[bytes]:
        """Send a request and return the values of its reply. Not real-time safe."""
        ...

    def sample(self, now_ns: int) -> Reading:
        """Read every position. Real-time safe."""
        ...

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the voltages. Real-time safe."""
        ...

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the range of each output, in V."""
        ...


class Memory(NamedTuple):
    """Sizes that a controller reports."""

    servo_ns: int  #: Time of a servo cycle, in ns.
    wave_points: int  #: Points of all waves together.
    record_points: int  #: Points of all tables of the recorder together.
    n_record_tables: int  #: Number of these tables.


class WaveRequests:
    """Asks and sets generators and recorder. Not real-time safe.

    Args:
        byte_ns: Time of a byte on the line, in ns.

    Raises:
        LineFault: If the controller refuses, or does not reply.
    """

    def __init__(self, host: PlayHost, byte_ns: int) -> None:
        self._host, self._byte_ns = host, byte_ns

    def memory(self, n_record_tables: int) -> Memory:
        """Ask for the sizes.

        Args:
            n_record_tables: Number of needed tables; fewer tables have more points each. A
                controller that refuses it keeps its own number.
        """
        with suppress(LineFault):
            self.do(f"SPA 1 0x{_RECORD_TABLES} {n_record_tables}\n".encode())
        tables = self._host.ask_slowly(b"TNR?\n", GcsReply(_WHOLE, whole=True))
        return Memory(
            round(self._parameter(_SERVO_TIME) * 1e9),
            int(self._parameter(_WAVE_POINTS)),
            int(self._parameter(_RECORD_POINTS)),
            int(tables[0]),
        )

    def has_generators(self) -> bool:
        """Return whether the controller has a wave generator for the first output."""
        number = self._host.numbers[0]
        # A query with a bare reply could be mistaken for that to `ERR?`, so the modes are asked.
        reply = GcsReply(f"{number}={MASK}")
        try:
            self._host.ask_slowly(f"WGO? {number}\n".encode(), reply)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.WRONG_REQUEST:
                raise
            return False
        return True

    def running(self) -> int:
        """Return the mask of the running generators."""
        return int(self._host.ask_slowly(IS_PLAYING, GcsReply(MASK, whole=True))[0], 16)

    def do(self, command: bytes) -> None:
        """Send commands without reply."""
        self._host.ask_slowly(command, GcsReply())

    def write_wave(self, number: str, values: Sequence[float], check: Check) -> list[float]:
        """Write a wave; return it as the controller holds it.

        Raises:
            DeviceError: If it holds other values.
        """
        texts = [f"{value:.4f}" for value in values]
        self.do(f"WCL {number}\n".encode())
        for first in range(0, len(texts), PER_LINE):
            check()
            part = texts[first : first + PER_LINE]
            append = "&" if first else "X"
            line = f"WAV {number} {append} PNT {first + 1} {len(part)} {' '.join(part)}\n"
            self.do(line.encode())
        held = [value for (value,) in self.read_array("GWD?", len(texts), [number], check)]
        for point, (text, value) in enumerate(zip(texts, held, strict=True)):
            if abs(float(text) - value) > _NEAR:
                what = f"wave {number} holds {value:g} at point {point} instead of {text}"
                raise DeviceError(what)
        return held

    def set_pulses(self, lines: int, high: Sequence[tuple[int, int]], check: Check) -> None:
        """Set at which points the digital outputs are high; at all others they are low.

        Args:
            lines: Number of outputs, which follow the wave generators from now on.
            high: Line and point, both from 1.
            check: Called between two exchanges.
        """
        self.do(b"TWC\n")
        for line in range(1, lines + 1):
            self.follow_generators(line)
        for first in range(0, len(high), TRIGGERS_PER_LINE):
            check()
            part = high[first : first + TRIGGERS_PER_LINE]
            self.do(f"TWS{''.join(f' {line} {point} 1' for line, point in part)}\n".encode())

    def follow_generators(self, line: int) -> None:
        """Let a digital output be high at points of the waves from now on."""
        self.do(follows_generators(line))

    def compare(self, own: Comparison, axis: str) -> None:
        """Let a digital output pulse by the position of an axis from now on."""
        values = (f"{abs(own.step):.6f}", f"{own.first:.6f}", f"{own.last:.6f}")
        pairs = zip((STEP, START_THRESHOLD, STOP_THRESHOLD), values, strict=True)
        settings = ((AXIS, axis), (TRIGGER_MODE, BY_DISTANCE), *pairs)
        self.do(f"CTO{''.join(f' {own.line} {key} {value}' for key, value in settings)}\n".encode())

    def record_length(self) -> int:
        """Return the number of recorded points."""
        (length,) = self._host.ask_slowly(b"DRL? 1\n", GcsReply(f"1={NUMBER}\n"))
        return int(float(length))

    def read_array(
        self, query: str, n_rows: int, tables: Sequence[str], check: Check
    ) -> list[list[float]]:
        """Return the first rows of some tables."""
        rows: list[list[float]] = []
        while len(rows) < n_rows:
            check()
            n = min(PER_REPLY, n_rows - len(rows))
            request = f"{query} {1 + len(rows)} {n} {' '.join(tables)}\n".encode() + ASK_ERROR
            # Twice the time of a long reply on a slow line.
            within_ns = self._host.slow_ns + 2 * n * (16 * len(tables) + 2) * self._byte_ns
            frame = self._host.conversation.ask(request, array_length, timeout_ns=within_ns)
            rows += array_rows(frame, n, len(tables))
        return rows

    def _parameter(self, number: str) -> float:
        reply = GcsReply(rf"1 0[xX]0{{0,4}}(?i:{number})={NUMBER}\n")
        return float(self._host.ask_slowly(f"SPA? 1 0x{number:0>8}\n".encode(), reply)[0])


def follows_generators(line: int) -> bytes:
    """Return the command that lets a digital output be high at points of the waves."""
    return f"CTO {line} {TRIGGER_MODE} {BY_GENERATOR}\n".encode()


def command(name: str, numbers: Sequence[str], values: Sequence[str]) -> bytes:
    """Return the command that sets a value for each generator."""
    pairs = (f" {number} {value}" for number, value in zip(numbers, values, strict=True))
    return f"{name}{''.join(pairs)}\n".encode()
