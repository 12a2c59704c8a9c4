"""The conversation with a device whose frames are described by their signals."""

from collections.abc import Iterable, Sequence
from math import nan
from typing import Final

from piezod.devices.bus.base_dialogue import BaseDialogue
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Wiring
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceUnavailableError
from piezod_drivers.can_bus.conversation import CanConversation
from piezod_drivers.can_bus.dbc.codec import SignalReader
from piezod_drivers.can_bus.dbc.options import DbcOptions
from piezod_drivers.can_bus.dbc.used_signals import UsedSignals
from piezod_drivers.can_bus.frame import Frame
from piezod_drivers.can_bus.frame_bus import FrameBus
from piezod_drivers.can_bus.options import max_rate_hz

MS: Final = 1_000_000
_FIRST_FRAMES_NS: Final = 1_000_000_000
"""Longest time that the device may take for its first frames."""


class DbcDialogue(BaseDialogue):
    """Implements `devices.bus.dialogue.ExchangingDialogue` for described frames.

    With a request, one exchange is: the messages with outputs, the request, and its replies, which
    confirm the messages before it. Without a request, the device sends by itself; the latest frame
    of each message counts unless it is too old. Then only the controllers on the bus acknowledge a
    message with outputs, so its effect has to be read back.
    """

    def __init__(self, options: DbcOptions, wiring: Wiring, bus: FrameBus) -> None:
        timeout_ns = round(options.timeout_ms * MS)
        self._conversation = CanConversation(bus, timeout_ns, (), self._handle_frame)
        super().__init__(wiring, bus, self._conversation)
        self._options, self._bus = options, bus
        self._signals_or_none: UsedSignals | None = None
        self._latest: dict[int, tuple[int, bytes]] = {}
        self._read_ns: int | None = None

    def open(self) -> Identity:
        """Connect and wait until the device has sent or replied; outputs keep their values.

        Raises:
            DeviceUnavailableError: If it does neither.
            DeviceError: If a message would set an unused output that is not read back.
        """
        signals = self._signals_or_none = UsedSignals(self._options, self._wiring)
        self._latest.clear()
        self._noticed.clear()
        own = tuple(signals.sent)
        # The own identifiers, too: a frame with one of them shows that another program commands the
        # device.
        self._bus.open((*own, *signals.received))
        self._conversation.restart(own)
        try:
            self._ask((), None)
        except LineFault as fault:
            if fault.flag is not DeviceFlag.LATE_REPLY:
                raise
            self._wait_for_first(fault)
        file = self._options.dbc
        about = "the configuration" if file is None else file.name
        return Identity("frames described by", about, self._bus.where, "unknown version")

    def capabilities(self) -> Capabilities:
        """Return the channels and the highest rate that the bus allows."""
        return Capabilities(
            self._wiring.inputs,
            self._wiring.outputs,
            self._signals.reads_back,
            max_rate_hz(self._options.bus, self._signals.sizes),
            holds=True,
        )

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the described range of each output, in its unit."""
        return self._signals.ranges

    def activate(self) -> None:
        """Prepare to hold the unused outputs that the messages in use also set.

        Raises:
            DeviceError: If one of them is out of the range that can be set.
            LineFault: If the device does not report their values, or the bus fails.
        """
        # No message with outputs is sent before the first setpoint: only that takes control.
        if held_outputs := self._signals.held_outputs:
            self._ask((), None)
            values = [
                (held.target, held.held_value(self._value(held.read_back))) for held in held_outputs
            ]
            for (identifier, signal), value in values:
                self._signals.sent[identifier].put(signal, value)

    def sample(self, now_ns: int) -> Reading:
        """Read the inputs. Real-time safe."""
        self._ask((), now_ns)
        return self._reading(now_ns)

    def put(self, values: Sequence[float]) -> None:
        """Set the outputs. Real-time safe."""
        frames = self._command_frames(values)
        if self._signals.request is None:
            self._conversation.read_pending()
            for frame in frames:
                self._conversation.tell(frame)
        else:
            self._ask(frames, None)

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        """Set the outputs and read the inputs. Real-time safe."""
        self._ask(self._command_frames(values), now_ns)
        return self._reading(now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the reported value of each output. Real-time safe."""
        # The exchange of this cycle has read them already, if the instants are equal.
        if self._read_ns != now_ns:
            self._ask((), now_ns)
        return [nan if place is None else self._value(place) for place in self._signals.read_backs]

    def flags(self) -> Sequence[Flags]:
        """Return the faults whose signals are not 0, for every channel. Real-time safe."""
        latest, found = self._latest, NO_FLAGS
        for flag, identifier, reader in self._signals.flags:
            # A message with flags may come less often than the inputs; until then it reports no
            # fault.
            if identifier in latest and reader.raw(latest[identifier][1]):
                found |= {flag}
        return [found] * (len(self._wiring.inputs) + len(self._wiring.outputs))

    @property
    def _signals(self) -> UsedSignals:
        assert self._signals_or_none is not None  # noqa: S101 - a `BusDevice` opens it first
        return self._signals_or_none

    def _command_frames(self, values: Sequence[float]) -> list[Frame]:
        signals = self._signals
        sent = signals.sent
        for (identifier, signal), value in zip(signals.driven_signals, values, strict=True):
            sent[identifier].put(signal, value)
        return [sent[identifier].next() for identifier in signals.driven_messages]

    def _ask(self, frames: Iterable[Frame], now_ns: int | None) -> None:
        signals = self._signals
        if signals.request is None or not signals.answers:
            # Pending error frames concern frames that were sent before.
            self._conversation.read_pending()
            for frame in frames:
                self._conversation.tell(frame)
            self._require_latest()
        else:
            request = signals.sent[signals.request].next()
            tagged = signals.tagged
            got = self._conversation.ask(
                (*frames, request), signals.answers, self._is_answer, tagged=tagged
            )
            arrived_ns = self._bus.now_ns()
            for identifier, data in got.items():
                self._latest[identifier] = arrived_ns, data
        self._read_ns = now_ns

    def _is_answer(self, frame: Frame) -> bool:
        """Return whether a frame answers the last request.

        Raises:
            LineFault: If the frame is invalid.
        """
        signals = self._signals
        received = signals.received[frame.id]
        received.require_valid(frame)
        assert signals.request is not None  # noqa: S101 - a reply has a request
        if not received.answers_request(frame, signals.sent[signals.request].count):
            return False
        return received.is_newer(frame)

    def _handle_frame(self, frame: Frame) -> None:
        """Process a frame that the device has sent by itself."""
        received = self._signals.received.get(frame.id)
        if received is None:
            return
        try:
            received.require_valid(frame)
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
        for identifier in self._signals.answers:
            if identifier not in latest or latest[identifier][0] < oldest_ns:
                what = f"no frame 0x{identifier:X} for {self._options.max_age_ms:g} ms"
                raise LineFault(DeviceFlag.LATE_REPLY, what)

    def _wait_for_first(self, fault: LineFault) -> None:
        """Wait until every message has come once, if the device sends by itself.

        Raises:
            DeviceUnavailableError: If one is missing.
        """
        sends_by_itself = self._signals.request is None
        end_ns = self._bus.now_ns() + _FIRST_FRAMES_NS
        while sends_by_itself and (left_ns := end_ns - self._bus.now_ns()) > 0:
            frame = self._bus.receive(left_ns)
            if frame is not None:
                self._handle_frame(frame)
            if self._signals.answers <= self._latest.keys():
                return
        what = f"{self._bus.where}: {fault}: check the device, the bit rate and both terminations"
        raise DeviceUnavailableError(what) from fault

    def _reading(self, now_ns: int) -> Reading:
        inputs = self._signals.inputs
        if self._signals.request is not None:
            return now_ns, [self._value(place) for place in inputs]
        # The sample is as old as the oldest of its inputs.
        arrived_ns = min((self._latest[identifier][0] for identifier, _ in inputs), default=0)
        # Frames are dated by the bus's clock, samples by the caller's: only their difference is
        # used.
        age_ns = max(self._bus.now_ns() - arrived_ns, 0)
        return now_ns - age_ns, [self._value(place) for place in inputs]

    def _value(self, place: tuple[int, SignalReader]) -> float:
        identifier, reader = place
        found = self._latest.get(identifier)
        return nan if found is None else reader.value(found[1])
