"""The conversation with an LC.400: commands in open loop and positions, in one exchange."""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.conversation import Conversation
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import NOT_TOLD, Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, SATURATED, DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import FULL_SCALE, HALF_SCALE, Lc400Register
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from piezod_drivers.serial_line.npoint_lc400.player import Lc400Player

HALF_PCT: Final = 50.0
"""Outputs go from minus to plus this value, in % of the command's span."""
_RANGE_IN_UM: Final = 0
_SERVO_OFF: Final = 0
_LOCAL: Final = frozenset({DeviceFlag.LOCAL_MODE})


class Lc400Dialogue(BaseDialogue):
    """Implements `ExchangingDialogue`.

    Each exchange reads command and servo state of every output and the position of every input. A
    write has no reply; the command that is read in the same exchange verifies it. The tag of an
    exchange makes late replies harmless.

    Args:
        wiring: The channels in use: "1", "2", "3".

    Attributes:
        inputs: Numbers of the channels of the inputs.
        outputs: Numbers of the channels of the outputs.
        um_per_count: Scale of each input, in µm; empty before `open`.
        player: Plays tables on the outputs.
    """

    def __init__(self, options: Lc400Options, wiring: Wiring, line: Line) -> None:
        self._conversation = Conversation(line, options.timeout_ms * 1e-3)
        super().__init__(wiring, line, self._conversation)
        self._options, self._line = options, line
        self.outputs, self.inputs = _numbers(wiring.outputs), _numbers(wiring.inputs)
        # The servo state is read with each command: another program may switch a servo on.
        watched = (Lc400Register.SETPOINT, Lc400Register.SERVO)
        addresses = [
            codec.register_address(i, register) for i in self.outputs for register in watched
        ]
        addresses += [codec.register_address(i, Lc400Register.POSITION) for i in self.inputs]
        self._poll = codec.Poll(addresses)
        self._number = 0
        self.um_per_count: list[float] = []
        self._setpoints: tuple[int, ...] = ()
        self._ranges = [(-HALF_PCT, HALF_PCT)] * len(self.outputs)
        self.player = Lc400Player(self, options.baud)

    def open(self) -> Identity:
        """Connect, and read firmware and ranges.

        Raises:
            DeviceError: If the range of a stage is not reported in µm.
        """
        self._line.open()
        self._conversation.restart()
        self._forget_in_force()
        self.player.forget()
        request = codec.read_array(codec.FIRMWARE, codec.FIRMWARE_WORDS)
        length_of = codec.array_length(codec.FIRMWARE, codec.FIRMWARE_WORDS)
        with self._conversation.opening():
            frame = self._conversation.ask(request, length_of, is_reply=lambda _frame: True)
        firmware = codec.text_of(frame)
        self._conversation.forget_noticed()
        self.um_per_count = [self._range_um(i) / FULL_SCALE for i in self.inputs]
        ranges = " ".join(f"{scale * FULL_SCALE:g}" for scale in self.um_per_count)
        # There is no serial number: the ranges at least distinguish stages of different range.
        serial = f"ranges {ranges} µm" if ranges else NOT_TOLD
        return Identity("nPoint", "LC.400", serial, firmware or NOT_TOLD)

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate that the bit rate allows."""
        n = 1 + 2 * len(self.outputs) + len(self.inputs)
        # Bytes of a cycle: 6 + 10 for each word that is read, and 10 for each write; 10 bits per
        # byte.
        rate_hz = self._options.baud / (10 * (16 * n + 10 * len(self.outputs)))
        return Capabilities(*self._wiring, True, rate_hz, holds=True, quality=True)

    def activate(self) -> None:
        """Take control of outputs that are in open loop already; stop a wavetable that is enabled.

        Raises:
            DeviceError: If a servo is on. Its present output cannot be read, so switching the servo
                off would make the output jump.
        """
        self._exchange(b"")
        for i, flags in zip(self._wiring.outputs, self._flags[len(self.inputs) :], strict=True):
            if flags:
                what = f"the servo of channel {i} is on, and its output would jump"
                raise DeviceError(f"{what}: switch it off at rest, with the maker's program")
        if self.player.stop_found():
            self._exchange(b"")

    def sample(self, now_ns: int) -> Reading:
        """Read every input, in µm; NaN at the ends of the range. Real-time safe."""
        reading = now_ns, self._exchange(b"")
        self._keep_in_force(self._commands_pct(), now_ns)
        return reading

    def put(self, values: Sequence[float]) -> None:
        """Set every output, in %. Real-time safe.

        Raises:
            LineFault: If the exchange fails, or reads other commands than these.
        """
        self._set(values)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set every output and read every input. Real-time safe.

        Raises:
            LineFault: If the exchange fails, or reads other commands than these.
        """
        reading = now_ns, self._set(values)
        self._keep_in_force(self._commands_pct(), now_ns)
        return reading

    def ask_words(
        self, writes: bytes, poll: codec.Poll, timeout_ns: int | None = None
    ) -> tuple[int, ...]:
        """Write, then read words; return them. Real-time safe.

        Args:
            writes: Requests without a reply.
            poll: The words.
            timeout_ns: Time-out in ns, if it differs from the usual one.
        """
        self._forget_in_force()
        self._number = number = (self._number + 1) % codec.TAGS
        frame = self._conversation.ask(
            writes + poll.request(number),
            poll.length_of,
            lambda got: codec.has_tag(got, number),
            timeout_ns,
        )
        return poll.values(frame)

    def ask_array(self, writes: bytes, address: int, n: int, timeout_ns: int) -> tuple[int, ...]:
        """Write, then read words one after the other; return them."""
        self._forget_in_force()
        request, length_of = codec.read_array(address, n), codec.array_length(address, n)
        frame = self._conversation.ask(writes + request, length_of, lambda _frame: True, timeout_ns)
        return codec.array_words(frame)

    def _ask_in_force(self) -> list[float]:
        self._exchange(b"")
        return self._commands_pct()

    def _commands_pct(self) -> list[float]:
        """Return the commands that were read last, in %."""
        return [setpoint / FULL_SCALE * 100.0 for setpoint in self._setpoints]

    def _set(self, values: Sequence[float]) -> list[float]:
        counts = tuple(round(value / 100.0 * FULL_SCALE) for value in values)
        writes = b"".join(
            codec.write(codec.register_address(i, Lc400Register.SETPOINT), count)
            for i, count in zip(self.outputs, counts, strict=True)
        )
        positions_um = self._exchange(writes)
        # A lost write and one by another program look the same: the command is not the one that was
        # set.
        if self._setpoints != counts:
            what = f"set to {counts}, reads back {self._setpoints}: another program sets it"
            raise LineFault(DeviceFlag.LOCAL_MODE, what)
        return positions_um

    def _exchange(self, writes: bytes) -> list[float]:
        """Write, then read everything; return the positions, in µm."""
        words = self.ask_words(writes, self._poll)
        after = 2 * len(self.outputs)
        self._setpoints, positions = words[:after:2], words[after:]
        servos = words[1:after:2]
        saturated = [abs(position) >= HALF_SCALE for position in positions]
        # Nearly always none: spares the construction of new lists.
        if any(servos) or any(saturated):
            self._flags = [SATURATED if ends else NO_FLAGS for ends in saturated] + [
                NO_FLAGS if servo == _SERVO_OFF else _LOCAL for servo in servos
            ]
        else:
            self._flags = self._no_flags
        return [
            nan if ends else position * scale
            for position, ends, scale in zip(positions, saturated, self.um_per_count, strict=True)
        ]

    def _range_um(self, channel: int) -> float:
        """Return the range of a stage, in µm.

        Raises:
            DeviceError: If it is not reported in µm.
        """
        if self._options.range_um is not None:
            return self._options.range_um
        wanted = [
            codec.register_address(channel, one)
            for one in (Lc400Register.RANGE_TYPE, Lc400Register.RANGE)
        ]
        kind, size = self.ask_words(b"", codec.Poll(wanted))
        if kind != _RANGE_IN_UM or size <= 0:
            where, what = self._line.where, f"range {size} of kind {kind}"
            raise DeviceError(f"{where} reports {what} for channel {channel}: set range_um")
        return float(size)


def _numbers(channels: Sequence[str]) -> tuple[int, ...]:
    return tuple(map(int, channels))
