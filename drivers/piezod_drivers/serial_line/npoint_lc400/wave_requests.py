"""The exchanges with the wavetables and the recorder of an LC.400."""

from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.player import Check
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import HALF_SCALE, Lc400Register

PER_EXCHANGE: Final = 100
"""Points that are written, and words that are read, at a time."""
_FREEZE: Final = 0x7FFFFFFF
"""Clock cycles before the next point: a wavetable with this delay stands still."""
_NOT_RECORDED: Final = 0x7FFFFFFF
"""Is written where the last sample will be: no sample has this value."""
_SLACK_NS: Final = 250_000_000
_BITS: Final = 10
_BYTES_PER_POINT: Final = 10
"""Bytes of a point on the line: 6 to write it, 4 to read it."""
_NEAR: Final = 1049
"""Counts by which the loop input may differ from the command before a play, or from its second
reading: 0.1 % of the span."""
_POSSIBLE_SCALES: Final = (0.1, 10.0)


class PlayHost(Protocol):
    """What a player uses of the dialogue."""

    inputs: tuple[int, ...]  #: Numbers of the channels of the inputs.
    outputs: tuple[int, ...]  #: Numbers of the channels of the outputs.
    um_per_count: list[float]  #: Scale of each input, in µm.

    def ask_words(
        self, writes: bytes, poll: codec.Poll, timeout_ns: int | None = None
    ) -> tuple[int, ...]:
        """Write, then read words; return them. Real-time safe."""
        ...

    def ask_array(self, writes: bytes, address: int, n: int, timeout_ns: int) -> tuple[int, ...]:
        """Write, then read words one after the other; return them."""
        ...

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        ...

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the range of each output, in %."""
        ...


class WaveState(NamedTuple):
    """State of a play."""

    point: int  #: Index of the present point.
    active: bool  #: Whether all wavetables are played.
    commanded: bool  #: Whether a command is not 0.
    recording: bool  #: Whether the recorder records.


class WaveRequests:
    """Asks and sets wavetables and recorder.

    A wavetable seems to add to the command: others subtract it from their tables. If it replaces
    the command, nothing changes here, because the command is 0 during a play. Wavetables start and
    stop in one write together with it. The loop input is the value in force in both cases.

    All methods raise `LineFault` if the controller does not reply.

    Args:
        baud: Bits per second on the line.
    """

    def __init__(self, host: PlayHost, baud: int) -> None:
        self._host, self._baud = host, baud
        outputs = host.outputs
        # Twice: a flipped bit in a word cannot be detected otherwise.
        self._inputs_poll = codec.Poll(_addresses(outputs, Lc400Register.LOOP_INPUT) * 2)
        self._stopped_poll = codec.Poll(
            [
                *_addresses(outputs, Lc400Register.SETPOINT),
                *_addresses(outputs, Lc400Register.WAVE_ACTIVE),
                *_addresses(outputs, Lc400Register.WAVE_ENABLE),
            ]
        )
        self._state_poll = codec.Poll(
            [
                codec.RECORD_START,
                *_addresses(outputs[:1], Lc400Register.WAVE_INDEX),
                *_addresses(outputs, Lc400Register.WAVE_ACTIVE),
                *_addresses(outputs, Lc400Register.SETPOINT),
            ]
        )
        self._scales = [1.0] * len(outputs)

    def is_enabled(self) -> bool:
        """Return whether a wavetable of an output is enabled or active."""
        n = len(self._host.outputs)
        return any(self._host.ask_words(b"", self._stopped_poll)[n:])

    def read_scales(self) -> None:
        """Read the scales of the loop inputs.

        Raises:
            LineFault: If one is not possible.
        """
        scales = codec.Poll(_addresses(self._host.outputs, Lc400Register.INVERSE_SCALE) * 2)
        words = self._host.ask_words(b"", scales)
        n = len(self._host.outputs)
        found = list(map(codec.float_of, words[:n]))
        low, high = _POSSIBLE_SCALES
        if words[:n] != words[n:] or not all(low <= scale <= high for scale in found):
            raise LineFault(DeviceFlag.GARBAGE, f"the scales of the loop inputs are {found}")
        self._scales = found

    def check_commands(self) -> None:
        """Check that each loop input is the command, before a play.

        Raises:
            DeviceError: If one is not: an analog input adds to it, or its scale is another one.
        """
        channels = self._host.outputs
        poll = codec.Poll(_addresses(channels, Lc400Register.SETPOINT))
        commands = self._host.ask_words(b"", poll)
        for channel, found, command in zip(channels, self.loop_inputs(), commands, strict=True):
            if not abs(found - command) <= _NEAR:
                raise DeviceError(
                    f"the loop input of channel {channel} is {found:.0f} counts, its command "
                    f"{command}, allowed: a difference of {_NEAR}; remove its analog input"
                )

    def loop_inputs(self, writes: bytes = b"") -> list[float]:
        """Write, then return the loop inputs, in counts of the command. Real-time safe.

        Raises:
            LineFault: If two readings of one differ.
        """
        words, n = self._host.ask_words(writes, self._inputs_poll), len(self._host.outputs)
        if any(abs(a - b) > _NEAR for a, b in zip(words[:n], words[n:], strict=True)):
            raise LineFault(DeviceFlag.GARBAGE, f"the loop inputs are {words}, read twice")
        return self.commands_of(words[n:])

    def commands_of(self, words: Sequence[int]) -> list[float]:
        """Return loop inputs in counts of the command. Real-time safe."""
        return [word * scale for word, scale in zip(words, self._scales, strict=True)]

    def write_wave(self, channel: int, counts: Sequence[int], check: Check) -> None:
        """Write a wavetable, and read it back.

        Raises:
            DeviceError: If the controller holds other values.
        """
        begin = codec.wave_address(channel)
        for first in range(0, len(counts), PER_EXCHANGE):
            check()
            part = tuple(counts[first : first + PER_EXCHANGE])
            address = begin + 4 * first
            writes = codec.write_array(address, part)
            held = self._host.ask_array(writes, address, len(part), self._within_ns(len(part)))
            if held != part:
                k = next(i for i, value in enumerate(part) if held[i] != value)
                raise DeviceError(
                    f"the wavetable of channel {channel} holds {held[k]} at point {first + k} "
                    f"instead of {part[k]}"
                )

    def prepare(self, n_points: int, n_samples: int, factor: int) -> None:
        """Set up wavetables and recorder.

        Args:
            n_points: Points of a wavetable.
            n_samples: Samples to record.
            factor: Clock cycles for each point and sample.

        Raises:
            DeviceError: If the controller holds other values.
        """
        wanted = {codec.RECORD_COUNT: n_samples, codec.RECORD_DIVISOR: factor}
        for channel in self._host.outputs:
            for register, value in (
                (Lc400Register.WAVE_INDEX, 0),
                (Lc400Register.WAVE_DELAY, factor - 1),
                (Lc400Register.WAVE_LAST, n_points - 1),
            ):
                wanted[codec.register_address(channel, register)] = value
        recorded = _addresses(self._host.inputs, Lc400Register.POSITION)
        recorded += _addresses(self._host.outputs, Lc400Register.LOOP_INPUT)
        for buffer, address in enumerate(recorded):
            wanted[codec.record_pointer(buffer)] = address
            wanted[codec.record_buffer(buffer) + 4 * (n_samples - 1)] = _NOT_RECORDED
        writes = b"".join(codec.write(address, value) for address, value in wanted.items())
        held = self._host.ask_words(writes, codec.Poll(list(wanted)), self._within_ns(len(wanted)))
        if held != tuple(wanted.values()):
            raise DeviceError("the controller does not hold the settings of the wavetable")

    def start(self) -> WaveState:
        """Start all wavetables and the recorder in one write; the command becomes 0."""
        outputs = self._host.outputs
        writes = _write_all(outputs, Lc400Register.WAVE_ENABLE, [1] * len(outputs))
        writes += _write_all(outputs, Lc400Register.SETPOINT, [0] * len(outputs))
        writes += _write_all(outputs, Lc400Register.WAVE_ACTIVE, [1] * len(outputs))
        return self._state(writes + codec.write(codec.RECORD_START, 1))

    def state(self) -> WaveState:
        """Return the state. Real-time safe."""
        return self._state(b"")

    def stop(self) -> list[int]:
        """Stop all wavetables where they are; return the commands in force, in counts.

        The wavetables are made to stand still, and the loop inputs are read. Then one write ends
        them, and makes the loop inputs the commands. Real-time safe.

        Raises:
            LineFault: If a wavetable has not stopped.
        """
        outputs, n = self._host.outputs, len(self._host.outputs)
        freeze = _write_all(outputs, Lc400Register.WAVE_DELAY, [_FREEZE] * n)
        in_force = self.loop_inputs(freeze)
        counts = [max(-HALF_SCALE, min(round(each), HALF_SCALE)) for each in in_force]
        writes = _write_all(outputs, Lc400Register.WAVE_ACTIVE, [0] * n)
        writes += _write_all(outputs, Lc400Register.WAVE_ENABLE, [0] * n)
        writes += _write_all(outputs, Lc400Register.SETPOINT, counts)
        writes += _write_all(outputs, Lc400Register.WAVE_DELAY, [0] * n)
        held = self._host.ask_words(writes, self._stopped_poll)
        if held != (*counts, *[0] * (2 * n)):
            what = f"a wavetable was stopped, but its registers are {held}"
            raise LineFault(DeviceFlag.LOCAL_MODE, what)
        return counts

    def recorded(self, buffer: int, n_samples: int, check: Check) -> list[int]:
        """Return the samples of a buffer.

        Raises:
            DeviceError: If the recorder has not filled it.
        """
        samples: list[int] = []
        while len(samples) < n_samples:
            check()
            n = min(PER_EXCHANGE, n_samples - len(samples))
            address = codec.record_buffer(buffer) + 4 * len(samples)
            samples += self._host.ask_array(b"", address, n, self._within_ns(n))
        if samples[-1] == _NOT_RECORDED:
            raise DeviceError(f"the record is cut off: it has less than {n_samples} samples")
        return samples

    def _state(self, writes: bytes) -> WaveState:
        recording, point, *others = self._host.ask_words(writes, self._state_poll)
        n = len(self._host.outputs)
        return WaveState(point, all(others[:n]), any(others[n:]), bool(recording))

    def _within_ns(self, n_points: int) -> int:
        """Return the time-out of an exchange of many words, in ns: twice its time, and some."""
        return _SLACK_NS + 4 * n_points * _BYTES_PER_POINT * _BITS * NS_PER_S // self._baud


def _addresses(channels: Sequence[int], register: int) -> list[int]:
    return [codec.register_address(channel, register) for channel in channels]


def _write_all(channels: Sequence[int], register: int, values: Sequence[int]) -> bytes:
    addresses = _addresses(channels, register)
    return b"".join(map(codec.write, addresses, values))
