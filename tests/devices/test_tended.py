"""A device that is lost, and what is done until it is there again."""

from collections.abc import Iterator
from math import isnan

import pytest

from piezod.devices.interface import Sample
from piezod.devices.reconnecting import CanBeLost, ReconnectingDevice
from piezod.devices.status import NO_FLAGS, DeviceFlag
from piezod.devices.wrapper import CombinedExchange
from piezod.errors import DeviceError, DeviceUnavailableError
from tests.daemon.waiting import eventually
from tests.devices.fake_link import OTHER, WHO, FakeLink

AWAY = frozenset({DeviceFlag.HALF_OPEN})


@pytest.fixture
def link() -> FakeLink:
    """Return a device that is open and active."""
    link = FakeLink()
    link.open()
    link.activate(0)
    return link


@pytest.fixture
def tended(link: FakeLink) -> Iterator[ReconnectingDevice]:
    """Return it tended, by a thread that does not wait long."""
    tended = ReconnectingDevice(link, WHO, first_wait_s=0.0005, longest_wait_s=0.001)
    tended.thread.start()
    yield tended
    tended.close()
    assert not tended.thread.is_alive()


def test_calls_go_through_as_long_as_the_device_is_there(
    link: FakeLink, tended: ReconnectingDevice
) -> None:
    """Each role's, and what is told once is told once."""
    link.noticed(DeviceFlag.GARBAGE)

    assert tended.read(7) == [Sample(7, 1.0, True)]
    assert tended.write([2.0], 7)
    assert tended.read_back(7) == [2.0]
    assert tended.exchange([3.0], 8) == (True, [Sample(8, 1.0, True)])
    assert tended.status(8) == [frozenset({DeviceFlag.GARBAGE})] * 2
    assert tended.status(8) == [NO_FLAGS] * 2
    assert tended.capabilities() == link.capabilities()
    assert isinstance(link, CanBeLost)


@pytest.mark.parametrize("call", ["read", "write", "read_back", "exchange"])
def test_a_device_is_lost_in_any_call_and_comes_back(
    link: FakeLink, tended: ReconnectingDevice, call: str
) -> None:
    """Meanwhile every call answers at once that there is nothing; then it is active again."""
    link.noticed(DeviceFlag.GARBAGE)
    link.pulled = True
    getattr(tended, call)(*([[2.0], 50] if call in {"write", "exchange"} else [50]))

    assert not tended.there
    assert tended.status(50) == [AWAY | {DeviceFlag.GARBAGE}] * 2
    assert tended.status(51) == [AWAY] * 2
    assert [sample.valid for sample in tended.read(51)] == [False]
    assert not tended.write([2.0], 51)
    assert tended.exchange([2.0], 51)[0] is False
    assert all(map(isnan, tended.read_back(51)))
    eventually(lambda: tended.absent)
    assert tended.absent == "nobody there"

    tended.read(60)
    link.pulled = False
    eventually(lambda: tended.there)
    assert link.done[-1] == "activate 60"
    assert "write 51" not in link.done
    assert tended.read(61) == [Sample(61, 1.0, True)]
    assert tended.status(61) == [NO_FLAGS] * 2
    assert tended.absent == ""


def test_a_device_may_be_lost_again(link: FakeLink, tended: ReconnectingDevice) -> None:
    """As often as it likes."""
    for now_ns in (1, 2, 3):
        link.pulled = True
        tended.read(now_ns)
        link.pulled = False
        eventually(lambda: tended.there)

    assert link.done.count("activate 3") == 1


def test_another_device_is_not_taken_for_the_lost_one(
    link: FakeLink, tended: ReconnectingDevice
) -> None:
    """It is closed again and nothing is written to it; the right one is taken when it comes."""
    link.pulled = True
    tended.read(1)
    link.who, link.pulled = OTHER, False
    eventually(lambda: tended.absent.startswith("another device"))

    assert tended.absent == (
        "another device came back: maker stage 2 1.0, expected: maker stage 1 1.0"
    )
    tended.status(2)
    eventually(lambda: DeviceFlag.OTHER_DEVICE in tended.status(2)[0])
    assert not tended.there
    assert "activate 1" not in link.done
    link.who = WHO
    eventually(lambda: tended.there)


def test_a_device_with_other_firmware_is_the_same(
    link: FakeLink, tended: ReconnectingDevice
) -> None:
    """Somebody has changed that; and what is not told speaks against nobody."""
    for changed in ({"firmware": "2.0"}, {"serial": "unknown"}):
        link.pulled = True
        tended.read(1)
        link.who, link.pulled = WHO._replace(**changed), False
        eventually(lambda: tended.there)


def test_a_driver_that_fails_to_close_is_opened_again_all_the_same(
    link: FakeLink, tended: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread goes on, and tells it; the device is used when it is back."""

    def wrong() -> None:
        raise OSError("closed by the wrong end")

    monkeypatch.setattr(link, "close", wrong)
    link.pulled = True
    tended.read(1)
    eventually(lambda: tended.absent)
    link.pulled = False
    eventually(lambda: tended.there)
    monkeypatch.undo()


def test_a_device_that_was_deactivated_meanwhile_comes_back_so(
    link: FakeLink, tended: ReconnectingDevice
) -> None:
    """Nobody activates it but who is asked to; its outputs come to rest as soon as they can."""
    link.pulled = True
    tended.read(5)
    tended.deactivate(6)
    assert "deactivate 6" not in link.done
    link.pulled = False
    eventually(lambda: tended.there)
    assert not [done for done in link.done[3:] if done.startswith("activate")]
    assert link.done[-1] == "deactivate 5"

    tended.activate(7)
    assert link.done[-1] == "activate 7"
    tended.deactivate(8)
    assert link.done[-1] == "deactivate 8"


def test_a_device_that_is_away_is_activated_when_it_comes_back(
    link: FakeLink, tended: ReconnectingDevice
) -> None:
    """Who asked for it need not ask again."""
    tended.deactivate(1)
    link.pulled = True
    tended.read_back(2)
    assert not tended.there
    tended.activate(3)
    link.pulled = False
    eventually(lambda: tended.there)

    assert link.done[-1] == "activate 2"
    assert tended.read(4) == [Sample(4, 1.0, True)]


def test_a_device_that_refuses_is_not_activated_behind_anybodys_back(
    link: FakeLink, tended: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who asked for it was told that it is not active: then it is not, whatever comes later."""

    def refuse(_now_ns: int) -> None:
        raise DeviceError("it is in local mode")

    tended.deactivate(1)
    with monkeypatch.context() as patch:
        patch.setattr(link, "activate", refuse)
        with pytest.raises(DeviceError, match="local mode"):
            tended.activate(2)
    tended.read_back(3)
    link.pulled = True
    tended.read_back(4)
    link.pulled = False
    eventually(lambda: tended.there)
    tended.read_back(5)

    assert not [done for done in link.done[2:] if done.startswith("activate")]


def test_a_device_that_is_lost_over_its_activation_is_activated_when_it_comes_back(
    link: FakeLink, tended: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is like any other that is away, and told to be."""

    def lose(now_ns: int) -> None:
        link.read(now_ns)
        raise DeviceUnavailableError("the wire is pulled")

    tended.deactivate(1)
    link.pulled = True
    with monkeypatch.context() as patch:
        patch.setattr(link, "activate", lose)
        tended.activate(2)
    assert not tended.there
    assert tended.status(2) == [AWAY] * 2
    link.pulled = False
    eventually(lambda: tended.there)

    assert link.done[-1].startswith("activate")


@pytest.mark.parametrize("active", [True, False])
def test_what_is_said_while_the_device_is_being_opened_is_done(
    link: FakeLink, tended: ReconnectingDevice, monkeypatch: pytest.MonkeyPatch, *, active: bool
) -> None:
    """The thread has just looked what it is to be; the next call of the loop sees to it."""
    last = {True: ("deactivate", "activate 9"), False: ("activate", "deactivate 9")}[active]
    unwatched = getattr(link, last[0])

    def meanwhile(now_ns: int) -> None:
        unwatched(now_ns)
        (tended.activate if active else tended.deactivate)(6)

    if active:
        tended.deactivate(1)
    link.pulled = True
    tended.read_back(5)
    with monkeypatch.context() as patch:
        patch.setattr(link, last[0], meanwhile)
        link.pulled = False
        eventually(lambda: tended.there)
    before = link.done[-1]
    tended.status(9)
    tended.status(9)

    assert before == f"{last[0]} 5"
    assert link.done[-1] == last[1]


def test_a_device_that_is_away_can_be_closed(link: FakeLink, tended: ReconnectingDevice) -> None:
    """The thread ends with it."""
    link.pulled = True
    tended.read(1)
    tended.close()

    assert not tended.thread.is_alive()
    assert not link.is_open


def test_what_cannot_be_lost_need_not_be_tended(link: FakeLink) -> None:
    """That is a mistake in the program."""
    with pytest.raises(DeviceError, match="stage cannot be lost"):
        ReconnectingDevice(CombinedExchange(link), WHO)


def test_a_combined_cycle_costs_one_exchange(link: FakeLink) -> None:
    """A read gives what came with the write before it, once, with its time stamp."""
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


def test_what_came_before_a_pause_is_not_given_after_it(link: FakeLink) -> None:
    """It is old then."""
    combined = CombinedExchange(link)
    combined.write([4.0], 1)
    combined.deactivate(2)

    assert combined.read(9) == [Sample(9, 1.0, True)]
