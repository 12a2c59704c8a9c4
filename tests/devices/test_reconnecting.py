"""A lost device, and its reconnection by a thread."""

from collections.abc import Iterator
from math import isnan

import pytest

from piezod.devices.channels import Channels
from piezod.devices.interface import Sample
from piezod.devices.reconnecting import (
    SILENT_CYCLES,
    SILENT_NS,
    CanBeLost,
    ReconnectingDevice,
)
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod.devices.wiring import ChannelPair
from piezod.devices.wrapper import CombinedExchange
from piezod.errors import DeviceError, DeviceUnavailableError
from tests.daemon.waiting import eventually
from tests.devices.fake_link import OTHER, WHO, FakeLink

AWAY = frozenset({DeviceFlag.HALF_OPEN})


@pytest.fixture
def link() -> FakeLink:
    """Return an open, active device."""
    link = FakeLink()
    link.open()
    link.activate(0)
    return link


@pytest.fixture
def reconnecting(link: FakeLink) -> Iterator[ReconnectingDevice]:
    """Return a reconnecting device whose thread waits only briefly."""
    reconnecting = ReconnectingDevice(link, WHO, first_wait_s=0.0005, longest_wait_s=0.001)
    reconnecting.thread.start()
    yield reconnecting
    reconnecting.close()
    assert not reconnecting.thread.is_alive()


def test_calls_are_forwarded_while_the_device_is_connected(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """This holds for every role, and events are reported once."""
    link.noticed(DeviceFlag.GARBAGE)

    assert reconnecting.read(7) == [Sample(7, 1.0, True)]
    assert reconnecting.write([2.0], 7)
    assert reconnecting.read_back(7) == [2.0]
    assert reconnecting.exchange([3.0], 8) == (True, [Sample(8, 1.0, True)])
    assert reconnecting.status(8) == [frozenset({DeviceFlag.GARBAGE})] * 2
    assert reconnecting.status(8) == [NO_FLAGS] * 2
    assert reconnecting.capabilities() == link.capabilities()
    assert isinstance(link, CanBeLost)


@pytest.mark.parametrize("call", ["read", "write", "read_back", "exchange"])
def test_a_device_can_be_lost_in_any_call_and_is_opened_again(
    link: FakeLink, reconnecting: ReconnectingDevice, call: str
) -> None:
    """While it is lost every call returns at once without data; then it is active again."""
    link.noticed(DeviceFlag.GARBAGE)
    link.pulled = True
    getattr(reconnecting, call)(*([[2.0], 50] if call in {"write", "exchange"} else [50]))

    assert not reconnecting.there
    assert reconnecting.status(50) == [AWAY | {DeviceFlag.GARBAGE}] * 2
    assert reconnecting.status(51) == [AWAY] * 2
    assert [sample.valid for sample in reconnecting.read(51)] == [False]
    assert not reconnecting.write([2.0], 51)
    assert reconnecting.exchange([2.0], 51)[0] is False
    assert all(map(isnan, reconnecting.read_back(51)))
    eventually(lambda: reconnecting.absent)
    assert reconnecting.absent == "nobody there"

    reconnecting.read(60)
    link.pulled = False
    eventually(lambda: reconnecting.there)
    assert link.done[-1] == "activate 60"
    assert "write 51" not in link.done
    assert reconnecting.read(61) == [Sample(61, 1.0, True)]
    assert reconnecting.status(61) == [NO_FLAGS] * 2
    assert reconnecting.absent == ""


def test_a_device_may_be_lost_again(link: FakeLink, reconnecting: ReconnectingDevice) -> None:
    """Each loss is followed by a reconnection."""
    for now_ns in (1, 2, 3):
        link.pulled = True
        reconnecting.read(now_ns)
        link.pulled = False
        eventually(lambda: reconnecting.there)

    assert link.done.count("activate 3") == 1


def test_another_device_is_not_used_instead_of_the_lost_one(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """It is closed again without a write; the right device is used once it is connected."""
    link.pulled = True
    reconnecting.read(1)
    link.who, link.pulled = OTHER, False
    eventually(lambda: reconnecting.absent.startswith("another device"))

    assert reconnecting.absent == (
        "another device was found: maker stage 2 1.0, expected: maker stage 1 1.0"
    )
    reconnecting.status(2)
    eventually(lambda: DeviceFlag.OTHER_DEVICE in reconnecting.status(2)[0])
    assert not reconnecting.there
    assert "activate 1" not in link.done
    link.who = WHO
    eventually(lambda: reconnecting.there)


@pytest.mark.fault("B14")
def test_a_port_that_another_program_holds_is_reported_until_it_is_opened(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """The flag is there after the first attempt, and stays while further ones fail."""
    link.pulled, link.taken = True, True
    reconnecting.read(1)
    assert DeviceFlag.PORT_SHARED not in reconnecting.status(1)[0]
    eventually(lambda: reconnecting.status(2) == [AWAY | {DeviceFlag.PORT_SHARED}] * 2)
    first = link.done.count("open")
    seen: set[Flags] = set()

    def tried_again() -> bool:
        seen.update(reconnecting.status(3))
        return link.done.count("open") > first + 3

    eventually(tried_again)

    assert seen == {AWAY | {DeviceFlag.PORT_SHARED}}
    assert reconnecting.absent == "held by x"
    link.taken = False
    eventually(lambda: reconnecting.status(4) == [AWAY] * 2)
    link.pulled = False
    eventually(lambda: reconnecting.there)
    assert reconnecting.status(5) == [NO_FLAGS] * 2
    assert reconnecting.obstacle is None


def test_a_device_with_other_firmware_is_the_same(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """Firmware may change, and a part that is not reported does not count."""
    for changed in ({"firmware": "2.0"}, {"serial": "unknown"}):
        link.pulled = True
        reconnecting.read(1)
        link.who, link.pulled = WHO._replace(**changed), False
        eventually(lambda: reconnecting.there)


def test_a_driver_that_fails_to_close_is_still_opened_again(
    link: FakeLink, reconnecting: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread continues and reports the error; the device is used again."""

    def wrong() -> None:
        raise OSError("closed by the wrong end")

    monkeypatch.setattr(link, "close", wrong)
    link.pulled = True
    reconnecting.read(1)
    eventually(lambda: reconnecting.absent)
    link.pulled = False
    eventually(lambda: reconnecting.there)
    monkeypatch.undo()


def test_a_device_deactivated_while_lost_is_deactivated_after_reconnection(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """Only the loop activates it; its outputs come to rest as soon as possible."""
    link.pulled = True
    reconnecting.read(5)
    reconnecting.deactivate(6)
    assert "deactivate 6" not in link.done
    link.pulled = False
    eventually(lambda: reconnecting.there)
    assert not [done for done in link.done[3:] if done.startswith("activate")]
    assert link.done[-1] == "deactivate 5"

    reconnecting.activate(7)
    assert link.done[-1] == "activate 7"
    reconnecting.deactivate(8)
    assert link.done[-1] == "deactivate 8"


def test_a_device_activated_while_lost_is_activated_after_reconnection(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """The loop need not request it again."""
    reconnecting.deactivate(1)
    link.pulled = True
    reconnecting.read_back(2)
    assert not reconnecting.there
    reconnecting.activate(3)
    link.pulled = False
    eventually(lambda: reconnecting.there)

    assert link.done[-1] == "activate 2"
    assert reconnecting.read(4) == [Sample(4, 1.0, True)]


def test_a_device_that_refused_activation_is_not_activated_later(
    link: FakeLink, reconnecting: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The caller got an error, so the device stays inactive after a reconnection too."""

    def refuse(_now_ns: int) -> None:
        raise DeviceError("it is in local mode")

    reconnecting.deactivate(1)
    with monkeypatch.context() as patch:
        patch.setattr(link, "activate", refuse)
        with pytest.raises(DeviceError, match="local mode"):
            reconnecting.activate(2)
    reconnecting.read_back(3)
    link.pulled = True
    reconnecting.read_back(4)
    link.pulled = False
    eventually(lambda: reconnecting.there)
    reconnecting.read_back(5)

    assert not [done for done in link.done[2:] if done.startswith("activate")]


def test_a_device_lost_during_activation_is_activated_after_reconnection(
    link: FakeLink, reconnecting: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The requested mode is kept."""

    def lose(now_ns: int) -> None:
        link.read(now_ns)
        raise DeviceUnavailableError("the wire is pulled")

    reconnecting.deactivate(1)
    link.pulled = True
    with monkeypatch.context() as patch:
        patch.setattr(link, "activate", lose)
        reconnecting.activate(2)
    assert not reconnecting.there
    assert reconnecting.status(2) == [AWAY] * 2
    link.pulled = False
    eventually(lambda: reconnecting.there)

    assert link.done[-1].startswith("activate")


@pytest.mark.parametrize("active", [True, False])
def test_a_request_during_the_reconnection_is_applied(
    link: FakeLink,
    reconnecting: ReconnectingDevice,
    monkeypatch: pytest.MonkeyPatch,
    *,
    active: bool,
) -> None:
    """The thread has read the old request; the next call of the loop applies the new one."""
    last = {True: ("deactivate", "activate 9"), False: ("activate", "deactivate 9")}[active]
    unwatched = getattr(link, last[0])

    def meanwhile(now_ns: int) -> None:
        unwatched(now_ns)
        (reconnecting.activate if active else reconnecting.deactivate)(6)

    if active:
        reconnecting.deactivate(1)
    link.pulled = True
    reconnecting.read_back(5)
    with monkeypatch.context() as patch:
        patch.setattr(link, last[0], meanwhile)
        link.pulled = False
        eventually(lambda: reconnecting.there)
    before = link.done[-1]
    reconnecting.status(9)
    reconnecting.status(9)

    assert before == f"{last[0]} 5"
    assert link.done[-1] == last[1]


def test_a_lost_device_can_be_closed(link: FakeLink, reconnecting: ReconnectingDevice) -> None:
    """The thread ends with it."""
    link.pulled = True
    reconnecting.read(1)
    reconnecting.close()

    assert not reconnecting.thread.is_alive()
    assert not link.is_open


def test_a_device_that_cannot_be_lost_is_refused(link: FakeLink) -> None:
    """This is an error in the program."""
    with pytest.raises(DeviceError, match="stage cannot be lost"):
        ReconnectingDevice(CombinedExchange(link), WHO)


def test_a_combined_cycle_costs_one_exchange(link: FakeLink) -> None:
    """A read returns the samples of the last write once, with their time stamps."""
    combined = CombinedExchange(link)
    first = combined.read(1)
    assert combined.write([4.0], 1)
    with_write = combined.read(2)
    without = combined.read(3)

    assert (combined.read_back(2), combined.read_back(3)) == ([4.0], [4.0])
    assert first == [Sample(1, 1.0, True)]
    assert with_write == [Sample(1, 1.0, True)]
    assert without == [Sample(3, 1.0, True)]
    assert link.reads == 3


def test_samples_from_before_a_pause_are_dropped(link: FakeLink) -> None:
    """After a deactivation they are too old."""
    combined = CombinedExchange(link)
    combined.write([4.0], 1)
    combined.deactivate(2)

    assert combined.read(9) == [Sample(9, 1.0, True)]


def test_what_an_exchange_has_read_before_a_loan_is_dropped(link: FakeLink) -> None:
    """The devices of a stage forget as one, whatever wraps them."""
    pair = ChannelPair("dev", "dev")
    channels = Channels({"dev": CombinedExchange(link)}, {"x": pair})
    channels.write([4.0], 1)
    link.drive_v = [7.0]  # by somebody else, meanwhile
    channels.forget()

    assert channels.read(9) == [Sample(9, 1.0, True)]
    assert channels.read_back(9) == [7.0]


def cycle(reconnecting: ReconnectingDevice, now_ns: int) -> set[DeviceFlag]:
    """Use a device as a cycle does; return its flags."""
    reconnecting.read(now_ns)
    reconnecting.read_back(now_ns)
    return set().union(*reconnecting.status(now_ns))


def test_a_silent_device_is_lost_and_delays_no_cycle(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """After half a second without an answer the thread opens it again; until then it is tried."""
    link.silent = True
    step_ns = SILENT_NS // SILENT_CYCLES
    flags = [cycle(reconnecting, step * step_ns) for step in range(SILENT_CYCLES + 2)]
    reads = link.reads
    away = [cycle(reconnecting, 10 * SILENT_NS + step) for step in range(3)]

    assert flags[:-1] == [{DeviceFlag.LATE_REPLY}] * (SILENT_CYCLES + 1)
    assert flags[-1] == {DeviceFlag.LATE_REPLY, DeviceFlag.DISCONNECTED}
    assert away == [{DeviceFlag.DISCONNECTED}] * 3
    assert link.reads == reads
    eventually(lambda: reconnecting.absent)
    link.silent = False
    eventually(lambda: reconnecting.there)
    assert reconnecting.read(61) == [Sample(61, 1.0, True)]


def test_a_device_that_answers_now_and_then_is_not_lost(
    link: FakeLink, reconnecting: ReconnectingDevice
) -> None:
    """One answer begins the time anew."""
    for step in range(10 * SILENT_CYCLES):
        link.silent = step % SILENT_CYCLES > 0
        cycle(reconnecting, step * SILENT_NS)

    assert reconnecting.there
