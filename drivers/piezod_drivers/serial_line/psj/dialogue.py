"""What is said to an amplifier of piezosystem jena."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import Line, LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjModel
from piezod_drivers.serial_line.psj.reading_age import Freshness
from piezod_drivers.serial_line.psj.session import PsjSession
from piezod_drivers.serial_line.psj.setup import identity_of, limits_of
from piezod_drivers.serial_line.psj.takeover import take_over

STATUS_NS: Final = 100_000_000
"""The status is asked for this often, after a setpoint or a sample."""
BITS_PER_BYTE: Final = 10
STATUS_BYTES: Final = 24
"""What asking for the status costs at most, both ways."""
_NOTHING: Final[tuple[int, Sequence[float]]] = (-1, ())
"""Of no instant: what was told is not in force any more."""


class PsjDialogue:
    """Implements `Dialogue`; the amplifier is driven in open loop, in V.

    Outputs hold their voltage when control ends: nothing is given back to the front panel, whose
    knob may stand elsewhere. A model that does not acknowledge a setpoint is read after it.

    Args:
        line: The line, not open.
        model: Which model it is.
        wiring: Which channels are used.
        range_v: Lowest and highest voltage, in V.
        timeout_s: How long to wait for a reply, in s.
        remote: Whether an NV40 is under remote control, as the configuration says.
    """

    def __init__(
        self,
        line: Line,
        model: PsjModel,
        wiring: Wiring,
        range_v: tuple[float, float],
        timeout_s: float,
        *,
        remote: bool = False,
    ) -> None:
        self._line, self._model, self._wiring, self._range_v = line, model, wiring, range_v
        self._talk, self._remote = PsjSession(line, model, timeout_s), remote
        self._inputs = [int(name[2:]) for name in wiring.inputs]
        self._outputs = [int(name[2:]) for name in wiring.outputs]
        self._all = [int(name[2:]) for name in wiring.channels]
        self._reads_back = model.tells_setpoint or model.reads == "voltage"
        self._ranges: list[tuple[float, float]] = []
        self._fresh: list[Freshness] = []
        self._flags: dict[int, Flags] = {}
        self._status_ns, self._status_turn = 0, 0
        self._noticed: set[DeviceFlag] = set()
        self._told_v = _NOTHING

    def open(self) -> Identity:
        """Connect and ask who is there; the outputs stay as they are."""
        self._line.open()
        self._talk.restart()
        identity = identity_of(self._talk, self._model, self._line.where)
        self._ranges = [
            limits_of(self._talk, self._model, channel, self._range_v) for channel in self._outputs
        ]
        self._flags = dict.fromkeys(self._all, NO_FLAGS)
        self._fresh = [Freshness(round(self._model.refresh_s * 1e9)) for _ in self._inputs]
        self._talk.forget_noticed()
        return identity

    def close(self) -> None:
        """Let go of the line; the outputs hold."""
        self._line.close()

    def capabilities(self) -> Capabilities:
        """Tell what it can do; the rate is what the bytes of a cycle allow at this baud rate."""
        return Capabilities(
            inputs=self._wiring.inputs,
            outputs=self._wiring.outputs,
            read_back=self._reads_back,
            max_rate_hz=self._model.baud / BITS_PER_BYTE / (self._bytes() + STATUS_BYTES),
            holds=True,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the voltages of each output: as configured, narrowed by what the device says."""
        return self._ranges

    def activate(self) -> None:
        """See that the outputs can be driven from where they are; see `takeover`.

        Raises:
            DeviceError: If that is not possible without a jump.
        """
        take_over(self._model, self._outputs, self._talk, remote=self._remote)
        for _ in self._all:
            self._look_after(at_once=True)
        self._talk.forget_noticed()

    def deactivate(self) -> None:
        """Do nothing: the outputs hold."""

    def sample(self, now_ns: int) -> Reading:
        """Read every input, in µm; with the instant at which a slow one has changed last."""
        values, t_ns = [], now_ns
        for channel, fresh in zip(self._inputs, self._fresh, strict=True):
            value = codec.number(self._talk.value(self._model.read, channel))
            values.append(value)
            t_ns = min(t_ns, fresh.taken_ns(value, now_ns))
        self._look_after()
        return t_ns, values

    def put(self, values: Sequence[float]) -> None:
        """Set every output, in V; each is acknowledged, or read where it is not.

        What an NV40/1 reads is measured, and follows the setpoint later: that it does is watched
        by whoever reads back.
        """
        self._told_v = _NOTHING
        model = self._model
        for channel, value in zip(self._outputs, values, strict=True):
            if model.acknowledges:
                self._talk.ask(model.set, channel, value)
            else:
                self._talk.tell(model.set, channel, value)
                codec.number(self._talk.value(model.read, channel))
        self._look_after()

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Tell the setpoints, or the voltages, in V; asked once for an instant."""
        if self._told_v[0] != now_ns:
            name = self._model.set if self._model.tells_setpoint else self._model.read
            told = [codec.number(self._talk.value(name, channel)) for channel in self._outputs]
            self._told_v = now_ns, told
        return self._told_v[1]

    def flags(self) -> Sequence[Flags]:
        """Tell what the status said last, of each channel."""
        return [self._flags[channel] for channel in (*self._inputs, *self._outputs)]

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail."""
        noticed, self._noticed = self._noticed | self._talk.take_noticed(), set()
        return noticed

    def _bytes(self) -> int:
        """Return how many bytes a cycle has at most, both ways, but for the status."""
        model = self._model
        setpoint = len(codec.command(model, model.set, 0, -100.0)) + len(b"\x13\x11")
        asked = len(codec.command(model, model.read, 0))
        answer = asked + len(b"\x13,-100.0000\r\n\x11")
        n_reads = len(self._inputs)
        if self._reads_back or not model.acknowledges:
            n_reads += len(self._outputs)
        return len(self._outputs) * setpoint + n_reads * (asked + answer)

    def _look_after(self, *, at_once: bool = False) -> None:
        """Ask for a status that is due: of one channel at a time, and never before a setpoint."""
        now_ns, model = self._line.now_ns(), self._model
        turns = len(self._all) if model.status_per_channel else 1
        if not model.status or not (at_once or now_ns - self._status_ns >= STATUS_NS // turns):
            return
        self._status_ns = now_ns
        try:
            self._ask_status()
        except LineFault as fault:
            if fault.flag in LOSING:
                raise
            self._noticed.add(fault.flag)

    def _ask_status(self) -> None:
        model = self._model
        if not model.status_per_channel:
            words = self._talk.values(model.status, None, model.channels)
            for channel in self._all:
                status = codec.word(words[channel], 16)
                self._flags[channel] = codec.flags_of(status, model.status_bits)
            return
        channel = self._all[self._status_turn]
        self._status_turn = (self._status_turn + 1) % len(self._all)
        status = codec.word(self._talk.value(model.status, channel), 10)
        self._flags[channel] = codec.flags_of(status, model.status_bits)
