"""A device that can be lost, behind a worker: what the loop was told that it is, it becomes."""

import threading
from collections.abc import Iterator

import pytest

from piezod.daemon.clock import MonotonicClock
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.reconnecting import ReconnectingDevice
from piezod.units import NS_PER_S
from tests.daemon.waiting import eventually
from tests.devices.fake_link import WHO, FakeLink

CLOCK = MonotonicClock()


@pytest.fixture
def link() -> FakeLink:
    """Return a device that is open and active."""
    link = FakeLink()
    link.open()
    link.activate(0)
    return link


@pytest.fixture
def tended(link: FakeLink) -> ReconnectingDevice:
    """Return it tended, by a thread that does not wait long."""
    return ReconnectingDevice(link, WHO, first_wait_s=0.0005, longest_wait_s=0.001)


@pytest.fixture
def worker(tended: ReconnectingDevice) -> Iterator[DeviceWorker]:
    """Return it behind a worker whose rounds are never late, both threads running."""
    worker = DeviceWorker(tended, CLOCK, NS_PER_S, NS_PER_S, pause_s=0.0005)
    tended.thread.start()
    worker.thread.start()
    yield worker
    worker.close()


def measures(worker: DeviceWorker) -> bool:
    """Tell whether there is a sample in a cycle that begins now."""
    return any(sample.valid for sample in worker.read(CLOCK.now_ns()))


def test_a_device_that_was_activated_while_it_was_away_is_used_when_it_is_back(
    link: FakeLink, tended: ReconnectingDevice, worker: DeviceWorker
) -> None:
    """The worker has told long ago that it will be active."""
    worker.deactivate(0)
    eventually(lambda: link.done[-1].startswith("deactivate"))
    link.pulled = True
    eventually(lambda: worker.read_back(CLOCK.now_ns()) and not tended.there)
    worker.activate(0)
    eventually(lambda: tended.absent and worker.read_back(CLOCK.now_ns()))
    link.pulled = False

    eventually(lambda: measures(worker))
    assert worker.crash is None
    now_ns = CLOCK.now_ns()
    assert worker.write([3.0], now_ns)
    eventually(lambda: worker.read_back(CLOCK.now_ns()) == [3.0])


def test_a_device_that_was_deactivated_while_it_was_away_is_so_when_it_is_back(
    link: FakeLink,
    tended: ReconnectingDevice,
    worker: DeviceWorker,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its outputs come to rest then."""
    told = threading.Event()
    deactivate = tended.deactivate

    def note(now_ns: int) -> None:
        deactivate(now_ns)
        told.set()

    monkeypatch.setattr(tended, "deactivate", note)
    link.pulled = True
    eventually(lambda: worker.read(CLOCK.now_ns()) and not tended.there)
    worker.deactivate(0)
    assert told.wait(20.0)
    link.pulled = False

    eventually(lambda: tended.there)
    assert link.done[-1].startswith("deactivate")
