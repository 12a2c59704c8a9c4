"""What comes over the wire from a sensor: its newest value, and at first who it is."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.micro_epsilon import codec, identity
from piezod_drivers.serial_line.micro_epsilon.options import MicroEpsilonOptions
from piezod_drivers.serial_line.micro_epsilon.profiles import UM_PER_MM

_MAKER: Final = "Micro-Epsilon"
_OPENING_NS: Final = 1_000_000_000
"""How long a sensor may take to say who it is, and to send a first value."""
_WAIT_NS: Final = 20_000_000
_BEFORE_OPENING: Final = frozenset({DeviceFlag.GARBAGE, DeviceFlag.OUT_OF_ORDER})
"""A stream that was there before somebody listens is no fault."""
_NOT_TOLD: Final = "not told"


class MicroEpsilonDialogue:
    """Implements `Dialogue` without outputs.

    The sensor sends by itself. A reading is the newest value that has come, at the instant of the
    call that found it; as long as no other has come, it stays what it was, with its old instant,
    and is not valid any more after a time-out.

    Args:
        options: What a configuration says.
        wiring: The channels that are used: the distance or none.
        line: The line to the sensor.
    """

    def __init__(self, options: MicroEpsilonOptions, wiring: Wiring, line: Line) -> None:
        self._options, self._inputs, self._line = options, wiring.inputs, line
        self._profile = options.profile
        self._conversation = Conversation(line, _OPENING_NS * 1e-9)
        self._patience_ns = round(options.timeout_ms * 1e6)
        self._range_um = 0.0
        self._rest = b""
        self._in_step = False
        self._t_ns: int | None = None
        self._quiet_since_ns: int | None = None
        self._position_um, self._flags = nan, NO_FLAGS
        self._noticed: set[DeviceFlag] = set()

    def open(self) -> Identity:
        """Connect, ask who is there where that can be asked, and wait for a value.

        Raises:
            DeviceUnavailableError: If nobody is there, or sends values.
            DeviceError: If it is another model, or its measuring range is not known.
            LineFault: If nobody answers.
        """
        self._line.open()
        self._conversation.restart()
        told, got = identity.Info(self._options.model, _NOT_TOLD, _NOT_TOLD, 0.0), b""
        if self._profile.talks:
            told, got = self._ask_info()
        if not told.name.upper().startswith(self._options.model):
            where, wanted = self._line.where, self._options.model
            raise DeviceError(f"{where} leads to a {told.name}, the configuration says {wanted}")
        range_mm = self._options.range_mm or told.range_mm
        if self._profile.scaled and not range_mm:
            raise DeviceError(f"{self._line.where} tells no measuring range: set range_mm")
        self._range_um = range_mm * UM_PER_MM
        got = self._until_value(got, _OPENING_NS)
        if codec.newest(got, self._profile.word_bytes).value is None:
            raise self._silent()
        self._conversation.forget_noticed()
        return Identity(_MAKER, told.name, told.serial, told.version)

    def close(self) -> None:
        """Let go of the line. Never raises."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what it can do: as many values as the bit rate carries."""
        rate_hz = self._options.bits_per_s / (10 * self._profile.word_bytes)
        return Capabilities(self._inputs, (), False, rate_hz, quality=True)

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell nothing: it has no outputs."""
        return ()

    def activate(self) -> None:
        """Forget what has come until now, and wait for a value that is new.

        Raises:
            LineFault: If the line is gone.
        """
        while len(self._line.receive(0)) >= codec.MOST_BYTES:
            continue
        self._t_ns = self._quiet_since_ns = None
        self._in_step, self._position_um, self._flags = False, nan, NO_FLAGS
        self._rest = self._until_value(b"", self._patience_ns)

    def deactivate(self) -> None:
        """Do nothing."""

    def sample(self, now_ns: int) -> Reading:
        """Return the newest value, in µm, and the instant it came; may be called in the loop.

        Raises:
            LineFault: If the line is gone.
        """
        data = self._line.receive(0)
        if len(data) >= codec.MOST_BYTES:
            self._noticed.add(DeviceFlag.BUS_OVERLOADED)
            self._rest, self._in_step = b"", False
        count, self._rest, broken = codec.newest(self._rest + data, self._profile.word_bytes)
        if broken and self._in_step:
            self._noticed.add(DeviceFlag.GARBAGE)
        if count is not None:
            self._in_step = True
            self._t_ns = self._quiet_since_ns = now_ns
            self._position_um, self._flags = self._profile.read(count, self._range_um)
        else:
            self._note_silence(now_ns)
        t_ns = now_ns if self._t_ns is None else self._t_ns
        return t_ns, [self._position_um] * len(self._inputs)

    def put(self, values: Sequence[float]) -> None:
        """Do nothing: it has no outputs."""

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Tell nothing: it has no outputs."""
        return ()

    def flags(self) -> Sequence[Flags]:
        """Tell what the newest value says of itself; may be called in the loop."""
        return [self._flags] * len(self._inputs)

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong on the line without making an exchange fail; and forget it."""
        noticed, self._noticed = self._noticed, set()
        return noticed | self._conversation.take_noticed()

    def _note_silence(self, now_ns: int) -> None:
        """Tell, time-out after time-out, that nothing comes: the last value is not valid then."""
        if self._quiet_since_ns is None:
            self._quiet_since_ns = now_ns
        if now_ns - self._quiet_since_ns > self._patience_ns:
            self._quiet_since_ns = now_ns
            self._position_um = nan
            self._noticed.add(DeviceFlag.LATE_REPLY)

    def _ask_info(self) -> tuple[identity.Info, bytes]:
        """Return who the sensor is, and what came with it.

        Raises:
            LineFault: If nobody answers.
        """
        word_bytes = self._profile.word_bytes

        def length_of(got: bytes) -> int:
            return len(got) if identity.info_of(codec.text_of(got, word_bytes)) else 0

        frame = self._conversation.ask(identity.REQUEST, length_of, is_reply=lambda _frame: True)
        told = identity.info_of(codec.text_of(frame, word_bytes))
        assert told is not None  # noqa: S101 - that is how its end was found
        return told, frame

    def _until_value(self, got: bytes, within_ns: int) -> bytes:
        """Return what has come as soon as there is a value in it, or what came in that time."""
        end_ns = self._line.now_ns() + within_ns
        while codec.newest(got, self._profile.word_bytes).value is None:
            left_ns = end_ns - self._line.now_ns()
            if left_ns <= 0:
                break
            got = (got + self._line.receive(min(left_ns, _WAIT_NS)))[-codec.MOST_BYTES :]
        return got

    def _silent(self) -> DeviceUnavailableError:
        return DeviceUnavailableError(
            f"no values come from {self._line.where}: have the sensor output them at RS422, with "
            f"{self._options.bits_per_s} bit/s"
        )
