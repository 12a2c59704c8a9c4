"""The conversation with a sensor: its identity at opening, then its newest value."""

from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line
from piezod.devices.interface import NOT_TOLD, Capabilities, Identity, Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.micro_epsilon import codec, identity
from piezod_drivers.serial_line.micro_epsilon.options import MicroEpsilonOptions
from piezod_drivers.serial_line.micro_epsilon.profiles import UM_PER_MM

_MAKER: Final = "Micro-Epsilon"
_OPENING_NS: Final = 1_000_000_000
"""Longest time that a sensor may take for its identity, and for its first value."""
_READ_NS: Final = 20_000_000


class MicroEpsilonDialogue(BaseDialogue):
    """Implements `Dialogue` without outputs.

    The sensor sends by itself. A reading is the newest value that has come, with the instant of the
    call that found it. While no other value comes, it keeps this instant; after a time-out it
    becomes invalid.

    Args:
        wiring: The channels in use: the distance or none.
    """

    def __init__(self, options: MicroEpsilonOptions, wiring: Wiring, line: Line) -> None:
        self._conversation = Conversation(line, _OPENING_NS * 1e-9)
        super().__init__(wiring, line, self._conversation)
        self._options, self._inputs, self._line = options, wiring.inputs, line
        self._profile = options.profile
        self._timeout_ns = round(options.timeout_ms * 1e6)
        self._range_um = 0.0
        self._rest = b""
        self._synchronized = False
        self._sample_ns: int | None = None
        self._silent_since_ns: int | None = None
        self._position_um = nan

    def open(self) -> Identity:
        """Connect, identify the sensor if it answers commands, and wait for a value.

        Raises:
            DeviceUnavailableError: If the port is absent, or no values come.
            DeviceError: If it is another model, or its measuring range is unknown.
        """
        self._line.open()
        self._conversation.restart()
        sensor, got = (
            identity.SensorIdentity(self._options.model, NOT_TOLD, NOT_TOLD, 0.0),
            b"",
        )
        if self._profile.answers_commands:
            sensor, got = self._ask_identity()
        if not sensor.name.upper().startswith(self._options.model):
            where, wanted = self._line.where, self._options.model
            raise DeviceError(f"{where} leads to {sensor.name}, configured is {wanted}")
        range_mm = self._options.range_mm or sensor.range_mm
        # Counts are fractions of the measuring range, so without it there is no displacement.
        if self._profile.scaled and not range_mm:
            raise DeviceError(f"{self._line.where} reports no measuring range: set range_mm")
        self._range_um = range_mm * UM_PER_MM
        got = self._wait_for_value(got, _OPENING_NS)
        if codec.newest(got, self._profile.word_bytes).value is None:
            raise self._no_values_error()
        # The stream before the first request is no fault.
        self._conversation.forget_noticed()
        return Identity(_MAKER, sensor.name, sensor.serial, sensor.version)

    def capabilities(self) -> Capabilities:
        """Return the channel and the highest rate that the bit rate allows."""
        # 10 bits per byte: start bit, 8 data bits, stop bit.
        rate_hz = self._options.bits_per_s / (10 * self._profile.word_bytes)
        return Capabilities(self._inputs, (), False, rate_hz, quality=True)

    def activate(self) -> None:
        """Discard all pending values, and wait for a new one."""
        # A full buffer may be followed by more.
        while len(self._line.receive(0)) >= codec.MAX_BYTES:
            continue
        self._sample_ns = self._silent_since_ns = None
        self._synchronized, self._position_um, self._flags = False, nan, self._no_flags
        self._rest = self._wait_for_value(b"", self._timeout_ns)

    def sample(self, now_ns: int) -> Reading:
        """Return the newest value, in µm, and the instant it came. Real-time safe."""
        data = self._line.receive(0)
        # The kernel's buffer was full, so bytes were lost between two words.
        if len(data) >= codec.MAX_BYTES:
            self._noticed.add(DeviceFlag.BUS_OVERLOADED)
            self._rest, self._synchronized = b"", False
        count, self._rest, broken = codec.newest(self._rest + data, self._profile.word_bytes)
        # The first bytes after opening usually belong to a word that began earlier.
        if broken and self._synchronized:
            self._noticed.add(DeviceFlag.GARBAGE)
        if count is not None:
            self._synchronized = True
            self._sample_ns = self._silent_since_ns = now_ns
            self._position_um, flags = self._profile.read(count, self._range_um)
            self._flags = [flags] * len(self._inputs)
        else:
            self._check_silence(now_ns)
        t_ns = now_ns if self._sample_ns is None else self._sample_ns
        return t_ns, [self._position_um] * len(self._inputs)

    def _check_silence(self, now_ns: int) -> None:
        """Report a missing value once per time-out; the last value is then invalid."""
        if self._silent_since_ns is None:
            self._silent_since_ns = now_ns
        if now_ns - self._silent_since_ns > self._timeout_ns:
            self._silent_since_ns = now_ns
            self._position_um = nan
            self._noticed.add(DeviceFlag.LATE_REPLY)

    def _ask_identity(self) -> tuple[identity.SensorIdentity, bytes]:
        """Return the identity of the sensor, and the bytes that came with it.

        Raises:
            LineFault: If the sensor does not reply.
        """
        word_bytes = self._profile.word_bytes

        def length_of(got: bytes) -> int:
            return len(got) if identity.parse_identity(codec.text_of(got, word_bytes)) else 0

        with self._conversation.opening():
            frame = self._conversation.ask(
                identity.REQUEST, length_of, is_reply=lambda _frame: True
            )
        sensor = identity.parse_identity(codec.text_of(frame, word_bytes))
        assert sensor is not None  # noqa: S101 - `length_of` has found it
        return sensor, frame

    def _wait_for_value(self, got: bytes, within_ns: int) -> bytes:
        """Return all bytes as soon as a value is among them, or when the time is over."""
        end_ns = self._line.now_ns() + within_ns
        while codec.newest(got, self._profile.word_bytes).value is None:
            left_ns = end_ns - self._line.now_ns()
            if left_ns <= 0:
                break
            got = (got + self._line.receive(min(left_ns, _READ_NS)))[-codec.MAX_BYTES :]
        return got

    def _no_values_error(self) -> DeviceUnavailableError:
        return DeviceUnavailableError(
            f"no values come from {self._line.where}: set the sensor to output over RS-422 with "
            f"{self._options.bits_per_s} bit/s"
        )
