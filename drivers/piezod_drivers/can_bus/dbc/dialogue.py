"""What goes over the bus to a device whose frames are described by their signals."""

from collections.abc import Iterable, Sequence
from math import nan
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.conversation import CanCycle
from piezod_drivers.can_bus.dbc.codec import SignalReader
from piezod_drivers.can_bus.dbc.options import DbcOptions
from piezod_drivers.can_bus.dbc.used_signals import UsedSignals
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.options import highest_rate_hz

MS: Final = 1_000_000
_FIRST_NS: Final = 1_000_000_000
"""How long the device may take for its first frames."""


class DbcDialogue:
    """Implements `devices.bus.dialogue.ExchangingDialogue` for described frames.

    With a request, one exchange is: the messages that drive, the request, and the answers to it,
    which acknowledge what was sent before. Without one, the device sends by itself; the latest of
    each message counts as long as it is not too old, and a message that drives is acknowledged by
    nobody but the controllers on the bus: compare what is read back.

    Args:
        options: What a configuration says.
        wiring: The channels that are used.
        bus: The bus.
    """

    def __init__(self, options: DbcOptions, wiring: Wiring, bus: FrameBus) -> None:
        self._options, self._wiring, self._bus = options, wiring, bus
        self._described: UsedSignals | None = None
        self._cycle = CanCycle(bus, round(options.timeout_ms * MS), (), self._take)
        self._latest: dict[int, tuple[int, bytes]] = {}
        self._noticed: set[DeviceFlag] = set()
        self._asked_ns: int | None = None

    def open(self) -> Identity:
        """Connect, and wait until the device has sent or answered; its outputs stay as they are.

        Raises:
            DeviceUnavailableError: If it does neither.
            DeviceError: If an output that is not used would be set too, and cannot be read back.
            LineFault: If the bus fails.
        """
        described = self._described = UsedSignals(self._options, self._wiring)
        self._latest.clear()
        self._noticed.clear()
        own = tuple(described.sent)
        self._bus.open((*own, *described.received))
        self._cycle = CanCycle(self._bus, round(self._options.timeout_ms * MS), own, self._take)
        try:
            self._ask((), None)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            self._wait_for_first(fault)
        file = self._options.dbc
        about = "the configuration" if file is None else file.name
        return Identity("frames described by", about, self._bus.where, "unknown version")

    def close(self) -> None:
        """Let go of the bus; outputs stay as they are. Never raises."""
        self._bus.close()

    def capabilities(self) -> Capabilities:
        """Tell what the device can do."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            self._frames.reads_back,
            highest_rate_hz(self._options.bus, self._frames.sizes),
            holds=True,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Tell the ranges of the outputs, as described."""
        return self._frames.ranges

    def activate(self) -> None:
        """Take over the outputs that are not used, but sent; the first of these takes control.

        Raises:
            DeviceError: If one of them is where it cannot be held.
            LineFault: If the device does not tell where they are, or the bus fails.
        """
        if fills := self._frames.fills:
            self._ask((), None)
            held = [(fill.place, fill.held(self._value(fill.back))) for fill in fills]
            for (identifier, signal), value in held:
                self._frames.sent[identifier].put(signal, value)

    def deactivate(self) -> None:
        """Do nothing: outputs hold."""

    def sample(self, now_ns: int) -> Reading:
        """Take the inputs; may be called in the loop.

        Raises:
            LineFault: If the device does not answer or send in time, or the bus fails.
        """
        self._ask((), now_ns)
        return self._reading(now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set the outputs; may be called in the loop.

        Raises:
            LineFault: As `sample`.
        """
        frames = self._drive(values)
        if self._frames.request is None:
            self._cycle.catch_up()
            for frame in frames:
                self._cycle.tell(frame)
        else:
            self._ask(frames, None)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set the outputs and take the inputs; may be called in the loop.

        Raises:
            LineFault: As `sample`.
        """
        self._ask(self._drive(values), now_ns)
        return self._reading(now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Tell what the device says is in force; may be called in the loop.

        Raises:
            LineFault: As `sample`.
        """
        if self._asked_ns != now_ns:
            self._ask((), now_ns)
        return [self._value(place) for place in self._frames.backs]

    def flags(self) -> Sequence[Flags]:
        """Tell which of the signals for flags are not 0, of every channel."""
        latest, told = self._latest, NO_FLAGS
        for flag, identifier, reader in self._frames.flags:
            if identifier in latest and reader.raw(latest[identifier][1]):
                told |= {flag}
        return [told] * (len(self._wiring.inputs) + len(self._wiring.outputs))

    def take_noticed(self) -> set[DeviceFlag]:
        """Return what went wrong without making an exchange fail."""
        noticed = self._cycle.take_noticed()
        if self._noticed:
            noticed = noticed | self._noticed
            self._noticed.clear()
        return noticed

    @property
    def _frames(self) -> UsedSignals:
        assert self._described is not None  # noqa: S101 - a bus device opens it first
        return self._described

    def _drive(self, values: Sequence[float]) -> list[Frame]:
        described = self._frames
        sent = described.sent
        for (identifier, signal), value in zip(described.drives, values, strict=True):
            sent[identifier].put(signal, value)
        return [sent[identifier].next() for identifier in described.driving]

    def _ask(self, frames: Iterable[Frame], now_ns: int | None) -> None:
        described = self._frames
        if described.request is None or not described.answers:
            self._cycle.catch_up()  # what the bus says of frames sent before is among it
            for frame in frames:
                self._cycle.tell(frame)
            self._require_latest()
        else:
            asking = described.sent[described.request].next()
            tagged = described.tagged
            got = self._cycle.ask((*frames, asking), described.answers, self._check, tagged=tagged)
            arrived_ns = self._bus.now_ns()
            for identifier, data in got.items():
                self._latest[identifier] = arrived_ns, data
        self._asked_ns = now_ns

    def _check(self, frame: Frame) -> bool:
        """Tell whether a frame answers the last request.

        Raises:
            LineFault: If it is not sound.
        """
        described = self._frames
        received = described.received[frame.id]
        received.require_sound(frame)
        assert described.request is not None  # noqa: S101 - who asks has a request
        if not received.repeats(frame, described.sent[described.request].count):
            return False
        return received.is_newer(frame)

    def _take(self, frame: Frame) -> None:
        """Take what the device has sent by itself."""
        received = self._frames.received.get(frame.id)
        if received is None:
            return
        try:
            received.require_sound(frame)
        except LineFault as fault:
            self._noticed.add(fault.flag)
            return
        if received.is_newer(frame):
            self._latest[frame.id] = self._bus.now_ns(), frame.data
        else:
            self._noticed.add(DeviceFlag.OUT_OF_ORDER)

    def _require_latest(self) -> None:
        latest = self._latest
        oldest_ns = self._bus.now_ns() - round(self._options.max_age_ms * MS)
        for identifier in self._frames.answers:
            if identifier not in latest or latest[identifier][0] < oldest_ns:
                what = f"frame 0x{identifier:X} has not come for {self._options.max_age_ms:g} ms"
                raise LineFault(DeviceFlag.LATE_REPLY, what)

    def _wait_for_first(self, fault: LineFault) -> None:
        """Wait until everything has come once, where the device sends by itself.

        Raises:
            DeviceUnavailableError: If it does not.
        """
        waited = self._frames.request is None
        end_ns = self._bus.now_ns() + _FIRST_NS
        while waited and (left_ns := end_ns - self._bus.now_ns()) > 0:
            frame = self._bus.receive(left_ns)
            if frame is not None:
                self._take(frame)
            if self._frames.answers <= self._latest.keys():
                return
        what = f"{self._bus.where}: {fault}: check the device, the bit rate and both terminations"
        raise DeviceUnavailableError(what) from fault

    def _reading(self, now_ns: int) -> Reading:
        inputs = self._frames.inputs
        if self._frames.request is not None:
            return now_ns, [self._value(place) for place in inputs]
        arrived_ns = min((self._latest[identifier][0] for identifier, _ in inputs), default=0)
        age_ns = max(self._bus.now_ns() - arrived_ns, 0)
        return now_ns - age_ns, [self._value(place) for place in inputs]

    def _value(self, place: tuple[int, SignalReader]) -> float:
        identifier, reader = place
        found = self._latest.get(identifier)
        return nan if found is None else reader.value(found[1])
