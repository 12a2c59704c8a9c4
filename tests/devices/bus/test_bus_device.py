"""A device made of a dialogue: order of calls, faults as values, events reported once."""

import math
from collections.abc import Callable, Sequence

import pytest

from piezod.devices.bus.bus_device import LOSING, BusDevice, ExchangingBusDevice
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Amplifier, Capabilities, Exchanges, Identity, Sensor
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags, TellsStatus
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod.testing.driver_contract import checks_for

IDENTITY = Identity("Acme", "E1", "7", "1.0")


class FakeDialogue:
    """Implements `ExchangingDialogue`: a device with two outputs and an input for each.

    Attributes:
        fault: Raised by every exchange while it is not None.
    """

    def __init__(self, *, read_back: bool = True, holds: bool = True) -> None:
        self.fault: DeviceFlag | None = None
        self.identity = IDENTITY
        self.in_force_v: Sequence[float] = [0.0, 0.0]
        self.sampled: Sequence[float] = [1.0, 2.0]
        self.reported: Sequence[Flags] = [NO_FLAGS] * 4
        self.noticed: set[DeviceFlag] = set()
        self.mistake: Exception | None = None
        self.calls: list[str] = []
        self._read_back, self._holds = read_back, holds

    def open(self) -> Identity:
        self._called("open")
        if self.mistake is not None:
            raise self.mistake
        return self.identity

    def close(self) -> None:
        self.calls.append("close")

    def capabilities(self) -> Capabilities:
        return Capabilities(("x", "y"), ("x", "y"), self._read_back, 1000.0, self._holds)

    def ranges(self) -> Sequence[tuple[float, float]]:
        return [(-10.0, 100.0)] * 2

    def activate(self) -> None:
        self._called("activate")

    def deactivate(self) -> None:
        self._called("deactivate")

    def sample(self, now_ns: int) -> Reading:
        self._called("sample")
        return now_ns, self.sampled

    def put(self, values: Sequence[float]) -> None:
        self._called("put")
        self.in_force_v = list(values)

    def in_force(self, now_ns: int) -> Sequence[float]:
        self._called(f"in_force {now_ns}")
        return self.in_force_v

    def exchange(self, values: Sequence[float], now_ns: int) -> Reading:
        self._called("exchange")
        self.in_force_v = list(values)
        return now_ns, self.sampled

    def flags(self) -> Sequence[Flags]:
        return self.reported

    def take_noticed(self) -> set[DeviceFlag]:
        noticed, self.noticed = self.noticed, set()
        return noticed

    def _called(self, what: str) -> None:
        self.calls.append(what)
        if self.fault is not None:
            raise LineFault(self.fault, "it failed")


def active(dialogue: FakeDialogue) -> ExchangingBusDevice:
    """Return an open, active device."""
    device = ExchangingBusDevice("E1", dialogue)
    device.open()
    device.activate(0)
    return device


def flags_of_all(*flags: DeviceFlag) -> list[Flags]:
    """Return a status with these flags for every channel."""
    return [frozenset(flags)] * 4


@pytest.mark.parametrize("kind", [BusDevice, ExchangingBusDevice])
def test_device_keeps_the_contract(
    kind: Callable[[str, FakeDialogue], BusDevice], subtests: pytest.Subtests
) -> None:
    """A bus device passes every check of its roles."""

    def factory() -> BusDevice:
        return kind("E1", FakeDialogue())

    for check in checks_for(factory):
        with subtests.test(check.__name__):
            check(factory)


def test_device_plays_all_roles() -> None:
    """It is sensor and amplifier, with a status; only an exchanging one has the exchange."""
    device = active(FakeDialogue())

    assert isinstance(device, Sensor)
    assert isinstance(device, Amplifier)
    assert isinstance(device, TellsStatus)
    assert isinstance(device, Exchanges)
    assert not isinstance(BusDevice("E1", FakeDialogue()), Exchanges)


@pytest.mark.parametrize(
    ("mistake", "raised"),
    [
        (LineFault(DeviceFlag.LATE_REPLY, "silence"), DeviceUnavailableError),
        (DeviceError("gibberish"), DeviceError),
        (ValueError("a mistake of the driver"), ValueError),
    ],
)
def test_opening_that_fails_lets_go(mistake: Exception, raised: type[Exception]) -> None:
    """After any error the line is closed, and the device can be opened later."""
    dialogue = FakeDialogue()
    device = BusDevice("E1", dialogue)
    dialogue.mistake = mistake
    with pytest.raises(raised):
        device.open()
    assert dialogue.calls == ["open", "close"]
    dialogue.mistake = None
    assert device.open() == IDENTITY


def test_activation_that_fails() -> None:
    """The message states device and reason, and the device refuses writes."""
    dialogue = FakeDialogue()
    device = BusDevice("E1", dialogue)
    device.open()
    dialogue.fault = DeviceFlag.LATE_REPLY
    with pytest.raises(DeviceUnavailableError, match="E1 cannot be activated: it failed"):
        device.activate(0)
    dialogue.fault = None

    assert not device.write([1.0, 1.0], 0)
    assert device.status(0) == flags_of_all(DeviceFlag.LATE_REPLY)


CALLS: list[Callable[[ExchangingBusDevice], object]] = [
    lambda device: [sample.valid for sample in device.read(5)] == [True, True],
    lambda device: device.write([1.0, 2.0], 5),
    lambda device: all(map(math.isfinite, device.read_back(5))),
    lambda device: device.exchange([1.0, 2.0], 5)[0],
]


@pytest.mark.parametrize("flag", list(DeviceFlag))
@pytest.mark.parametrize("call", CALLS)
def test_fault_is_a_value_and_reported_once(
    flag: DeviceFlag, call: Callable[[ExchangingBusDevice], object]
) -> None:
    """The status has the flag once, or until the device is opened again."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    assert call(device)
    dialogue.fault = flag
    assert not call(device)
    first = device.status(5)
    dialogue.fault = None
    second = device.status(6)
    works_again = bool(call(device))

    assert first == flags_of_all(flag)
    assert second == flags_of_all(*{flag} & LOSING)
    assert works_again == (flag not in LOSING)


def test_exchanges_and_their_faults_are_counted() -> None:
    """Each exchange counts, each of its faults by flag, and no call of a lost device."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    device.read(0)
    dialogue.noticed = {DeviceFlag.GARBAGE}
    device.status(0)
    for flag in (DeviceFlag.GARBAGE, DeviceFlag.DISCONNECTED):
        dialogue.fault = flag
        device.read(1)
    device.read(2)

    assert device.exchanges == 3
    assert {flag: n for flag, n in device.exchange_faults.items() if n} == {
        DeviceFlag.GARBAGE: 2,
        DeviceFlag.DISCONNECTED: 1,
    }


def test_lost_device_has_no_exchange_until_it_is_opened_again() -> None:
    """Closing it sends nothing, and it can be opened and used again."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    dialogue.fault = DeviceFlag.DISCONNECTED
    device.read(0)
    dialogue.calls.clear()
    device.read(1)
    device.write([1.0, 1.0], 1)
    device.deactivate(1)
    with pytest.raises(DeviceUnavailableError, match="it failed"):
        device.activate(1)
    device.close()
    tried = dialogue.calls.copy()
    dialogue.fault = None
    device.open()
    device.activate(2)

    assert tried == ["close"]
    assert device.write([1.0, 1.0], 2)
    assert device.status(2) == flags_of_all()


@pytest.mark.parametrize("holds", [True, False])
def test_outputs_that_do_not_hold_go_to_rest_without_activation(*, holds: bool) -> None:
    """Deactivation leaves the outputs safe, in whatever state they were found."""
    dialogue = FakeDialogue(holds=holds)
    device = ExchangingBusDevice("E1", dialogue)
    device.open()
    device.deactivate(0)
    device.close()
    device.deactivate(1)

    rests = [] if holds else ["deactivate"]
    assert dialogue.calls == ["open", *rests, "close"]


def test_another_device_is_not_brought_to_rest() -> None:
    """Nothing is sent to a device other than the first one."""
    dialogue = FakeDialogue(holds=False)
    device = ExchangingBusDevice("E1", dialogue)
    device.open()
    device.close()
    dialogue.identity = dialogue.identity._replace(serial="another")
    device.open()
    device.deactivate(0)
    device.close()

    assert dialogue.calls == ["open", "close"] * 2


@pytest.mark.parametrize("read_back", [True, False])
def test_voltage_of_a_lost_device_is_unknown(read_back: bool) -> None:
    """This holds for devices with and without read-back."""
    dialogue = FakeDialogue(read_back=read_back)
    device = active(dialogue)
    assert device.write([1.0, 1.0], 0)
    dialogue.fault = DeviceFlag.DISCONNECTED
    device.read(1)

    assert all(map(math.isnan, device.read_back(1)))


def test_events_and_lasting_flags_are_reported_together() -> None:
    """Events of the line appear once for all channels, flags of the device while they last."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    hot = frozenset({DeviceFlag.OVER_TEMPERATURE})
    dialogue.reported = [NO_FLAGS, NO_FLAGS, hot, NO_FLAGS]
    dialogue.noticed = {DeviceFlag.GARBAGE}
    garbage = frozenset({DeviceFlag.GARBAGE})

    assert device.status(0) == [garbage, garbage, garbage | hot, garbage]
    assert device.status(1) == dialogue.reported
    device.deactivate(2)
    assert device.status(2) == flags_of_all()


def test_events_are_kept_until_the_status_is_read() -> None:
    """All failures between two reads of the status are reported."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    for flag in (DeviceFlag.GARBAGE, DeviceFlag.BUSY):
        dialogue.fault = flag
        device.read(0)
    dialogue.fault = None
    device.read(0)

    assert device.status(0) == flags_of_all(DeviceFlag.GARBAGE, DeviceFlag.BUSY)


@pytest.mark.parametrize("changed", ["maker", "model", "serial"])
def test_another_device_is_reported_while_it_is_open(changed: str) -> None:
    """The identity must be that of the first device, without firmware and missing parts."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    device.close()
    dialogue.identity = IDENTITY._replace(**{changed: "other"})
    device.open()
    others = [device.status(0), device.status(1)]
    device.close()
    dialogue.identity = IDENTITY._replace(firmware="2.0")
    device.open()

    assert others == [flags_of_all(DeviceFlag.OTHER_DEVICE)] * 2
    assert device.status(2) == flags_of_all()
    device.close()
    dialogue.identity = IDENTITY._replace(**{changed: "not told"})
    device.open()
    assert device.status(3) == flags_of_all()


@pytest.mark.parametrize("values", [[1.0], [1.0] * 3, [math.nan, 1.0], [1.0, 100.1], [-10.1, 0.0]])
def test_invalid_values_are_not_sent(values: list[float]) -> None:
    """Write and exchange refuse them as a whole; the exchange still reads."""
    dialogue = FakeDialogue()
    device = active(dialogue)
    dialogue.calls.clear()
    taken, samples = device.exchange(values, 3)

    assert not device.write(values, 3)
    assert (taken, [sample.valid for sample in samples]) == (False, [True, True])
    assert dialogue.calls == ["sample"]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_sample_that_is_not_finite_is_invalid(bad: float) -> None:
    """The other inputs are not affected."""
    dialogue = FakeDialogue()
    dialogue.sampled = [bad, 2.0]

    assert [sample.valid for sample in active(dialogue).read(0)] == [False, True]


def test_without_read_back_the_last_value_is_returned() -> None:
    """Before the first write the value is NaN."""
    dialogue = FakeDialogue(read_back=False)
    device = active(dialogue)
    before = device.read_back(0)
    device.write([1.0, 2.0], 0)
    dialogue.fault = DeviceFlag.LATE_REPLY
    device.write([3.0, 3.0], 0)

    assert all(map(math.isnan, before))
    assert device.read_back(0) == [1.0, 2.0]
