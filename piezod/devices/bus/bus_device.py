"""A device on a wire: it enforces the order of calls and turns every wire fault into a value."""

from collections.abc import Callable, Iterable, Sequence
from math import isfinite, nan
from typing import TypeVar, TypeVarTuple

from piezod.devices.bus.dialogue import Dialogue, ExchangingDialogue, Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Capabilities, Identity, Sample, is_same
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.errors import DeviceError, DeviceUnavailableError

AnswerT = TypeVar("AnswerT")
Given = TypeVarTuple("Given")

LOSING = frozenset(
    {
        DeviceFlag.DISCONNECTED,
        DeviceFlag.HALF_OPEN,
        DeviceFlag.BUS_OFF,
        DeviceFlag.PARTIAL_WRITE,  # the device would read the next request as the end of this one
    }
)
"""After one of these no exchange is tried until the device is opened again."""


class BusDevice:
    """Implements `Sensor`, `Amplifier` and `TellsStatus` over a dialogue.

    A lost device stays lost until it is closed and opened again: samples are invalid, writes are
    refused and read-back values are NaN. Opening takes time, so it is not done in the loop. If
    maker, model or serial number differ after opening it again, the status reports `OTHER_DEVICE`
    while the device is open.

    Args:
        name: Name in messages, for example "E-816".
        dialogue: Exchanges of the protocol.
    """

    def __init__(self, name: str, dialogue: Dialogue) -> None:
        self._name, self._dialogue = name, dialogue
        self._able: Capabilities | None = None
        self._active = False
        self._events: set[DeviceFlag] = set()
        self._ranges: Sequence[tuple[float, float]] = ()
        self._written: Sequence[float] = ()
        self._no_flags: Sequence[Flags] = ()
        self._first_identity: Identity | None = None
        self._lasting_flags = NO_FLAGS
        self.lost = ""
        """Reason of the loss, for people; empty if the device is connected."""
        self.last_fault = ""
        """Text of the last failed exchange, for people; empty if none has failed since opening."""
        self.exchanges = 0
        """Number of exchanges, also those that failed."""
        self.exchange_faults = dict.fromkeys(DeviceFlag, 0)
        """Number of faults of exchanges, by flag."""

    def open(self) -> Identity:
        """Connect and return the identity; outputs stay as they are.

        Raises:
            DeviceUnavailableError: If it is absent, held by another program, or does not answer.
            DeviceError: If it is already open, or its answer violates its protocol.
        """
        if self._able is not None:
            raise DeviceError(f"{self._name} is already open")
        try:
            identity = self._dialogue.open()
            able, self._ranges = self._dialogue.capabilities(), self._dialogue.ranges()
        except LineFault as fault:
            self._dialogue.close()
            raise DeviceUnavailableError(f"{self._name}: {fault}") from fault
        except BaseException:
            self._dialogue.close()
            raise
        self._able = able._replace(ranges=tuple(self._ranges))
        self._written = [nan] * len(able.outputs)  # not known before the first write
        # The identity of the first opening is kept for the life of this object.
        self._first_identity = self._first_identity or identity
        same = is_same(identity, self._first_identity)
        self._lasting_flags = NO_FLAGS if same else frozenset({DeviceFlag.OTHER_DEVICE})
        self._no_flags = [NO_FLAGS] * (len(able.inputs) + len(able.outputs))
        self.lost = self.last_fault = ""
        self._events = set()
        return identity

    def capabilities(self) -> Capabilities:
        """Return the capabilities of the device."""
        return self._require_open()

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface's
        """Take control of the outputs, at their present values.

        Raises:
            DeviceError: If it is not open, or refuses control.
        """
        self._require_open()
        if self._active:
            return
        if self.lost:
            raise DeviceUnavailableError(f"{self._name} cannot be activated: {self.lost}")
        try:
            self._dialogue.activate()
        except LineFault as fault:
            self._note_fault(fault)
            raise DeviceUnavailableError(f"{self._name} cannot be activated: {fault}") from fault
        self._active = True

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the interface's
        """Release control; outputs that do not hold go to rest in any case. Never raises."""
        able = self._able
        rests = able is not None and bool(able.outputs) and not able.holds
        if self._active or (rests and not self._lasting_flags):  # nothing is sent to another device
            self._release_control()

    def close(self) -> None:
        """Release control, if it was taken, and disconnect. Never raises."""
        # Only if it is active: outputs that another program left in place are not ours to change.
        if self._active:
            self._release_control()
        if self._able is not None:
            self._able = None
            self._dialogue.close()

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return a sample of each input, invalid ones after a fault. Real-time safe."""
        if not self._active or self._able is None:
            raise DeviceError(f"{self._name} is not active")
        return self._samples(self._try(self._dialogue.sample, now_ns), now_ns)

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:  # noqa: ARG002 - the interface's
        """Set every output; all values are accepted or none. Real-time safe."""
        if not self._accepts(drive_v):
            return False
        return self._note_set(drive_v, self._try(self._set, drive_v))

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back value of each output, NaN after a fault. Real-time safe."""
        able = self._require_open()
        if not able.read_back:
            # A lost device may have been switched off, so the written value need not be in force.
            return [nan] * len(able.outputs) if self.lost else self._written
        values = self._try(self._dialogue.in_force, now_ns)
        return [nan] * len(able.outputs) if values is None else values

    def status(self, now_ns: int) -> Sequence[Flags]:  # noqa: ARG002 - the interface's
        """Return the flags of each channel. Real-time safe.

        A flag of an exchange is reported once, by the next call; a lasting flag while it lasts.
        """
        self._require_open()
        if noticed := self._dialogue.take_noticed():
            self._events |= noticed
            self._count_faults(noticed)
        flags = self._dialogue.flags() if self._active and not self.lost else self._no_flags
        if not self._events and not self._lasting_flags:
            return flags
        events = self._lasting_flags.union(self._events)
        if self.lost:
            self._events &= LOSING  # these last until the device is opened again
        else:
            self._events.clear()
        # A fault of the wire affects every channel of the device.
        return [channel | events for channel in flags]

    def _release_control(self) -> None:
        self._active = False  # first: a failed request must not be repeated by `close`
        self._try(self._dialogue.deactivate)

    def _samples(self, reading: Reading | None, now_ns: int) -> list[Sample]:
        if reading is None:
            n_inputs = len(self._require_open().inputs)
            return [Sample(now_ns, nan, False)] * n_inputs
        t_ns, values = reading
        # value - value is 0 only for finite values: one test for NaN and infinities.
        return [Sample(t_ns, value, value - value == 0.0) for value in values]

    def _accepts(self, values: Sequence[float]) -> bool:
        ranges = self._ranges
        if not self._active or len(values) != len(ranges):
            return False
        for value, (low, high) in zip(values, ranges, strict=True):
            # Compared in this way a NaN is refused; an infinite range still needs `isfinite`.
            if not (low <= value <= high and isfinite(value)):
                return False
        return True

    def _set(self, values: Sequence[float]) -> bool:
        self._dialogue.put(values)
        return True

    def _note_set(self, values: Sequence[float], answer: object) -> bool:
        if answer is None:
            return False
        self._written = list(values)
        return True

    def _try(self, exchange: Callable[[*Given], AnswerT], *given: *Given) -> AnswerT | None:
        """Return the result of an exchange; None if it fails or the device is lost."""
        if self.lost:
            return None
        self.exchanges += 1
        try:
            return exchange(*given)
        except LineFault as fault:
            self._note_fault(fault)
            return None

    def _note_fault(self, fault: LineFault) -> None:
        self._events.add(fault.flag)
        self._count_faults((fault.flag,))
        self.last_fault = str(fault)
        if fault.flag in LOSING:
            self.lost = str(fault)

    def _count_faults(self, flags: Iterable[DeviceFlag]) -> None:
        for flag in flags:
            self.exchange_faults[flag] += 1

    def _require_open(self) -> Capabilities:
        if self._able is None:
            raise DeviceError(f"{self._name} is not open")
        return self._able


class ExchangingBusDevice(BusDevice):
    """A `BusDevice` that also implements `Exchanges`.

    Args:
        name: Name in messages.
        dialogue: Exchanges of the protocol.
    """

    def __init__(self, name: str, dialogue: ExchangingDialogue) -> None:
        super().__init__(name, dialogue)
        self._exchanging = dialogue

    def exchange(self, drive_v: Sequence[float], now_ns: int) -> tuple[bool, Sequence[Sample]]:
        """Set every output and return a sample of each input. Real-time safe."""
        if not self._accepts(drive_v):
            return False, self.read(now_ns)  # the loop needs its samples in any case
        reading = self._try(self._exchanging.exchange, drive_v, now_ns)
        return self._note_set(drive_v, reading), self._samples(reading, now_ns)
