"""A device that can be lost, behind a worker: a mode requested during the loss is applied later."""

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
def reconnecting(link: FakeLink) -> ReconnectingDevice:
    """Return the device with a thread that opens it again without a long wait."""
    return ReconnectingDevice(link, WHO, first_wait_s=0.0005, longest_wait_s=0.001)


@pytest.fixture
def worker(reconnecting: ReconnectingDevice) -> Iterator[DeviceWorker]:
    """Return the device behind a worker whose rounds are never late; both threads run."""
    worker = DeviceWorker(reconnecting, CLOCK, NS_PER_S, NS_PER_S, pause_s=0.0005)
    reconnecting.thread.start()
    worker.thread.start()
    yield worker
    worker.close()


def measures(worker: DeviceWorker) -> bool:
    """Return whether a cycle that begins now gets a sample."""
    return any(sample.valid for sample in worker.read(CLOCK.now_ns()))


def test_a_device_that_was_activated_while_it_was_away_is_used_when_it_is_back(
    link: FakeLink, reconnecting: ReconnectingDevice, worker: DeviceWorker
) -> None:
    """A device that is activated during its loss is read and written after it is opened again."""
    worker.deactivate(0)
    eventually(lambda: link.done[-1].startswith("deactivate"))
    link.pulled = True
    eventually(lambda: worker.read_back(CLOCK.now_ns()) and not reconnecting.there)
    worker.activate(0)
    eventually(lambda: reconnecting.absent and worker.read_back(CLOCK.now_ns()))
    link.pulled = False

    eventually(lambda: measures(worker))
    assert worker.crash is None
    now_ns = CLOCK.now_ns()
    assert worker.write([3.0], now_ns)
    eventually(lambda: worker.read_back(CLOCK.now_ns()) == [3.0])


def test_a_device_that_was_deactivated_while_it_was_away_is_so_when_it_is_back(
    link: FakeLink,
    reconnecting: ReconnectingDevice,
    worker: DeviceWorker,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A device that is deactivated during its loss is inactive after it is opened again."""
    deactivated = threading.Event()
    deactivate = reconnecting.deactivate

    def note(now_ns: int) -> None:
        deactivate(now_ns)
        deactivated.set()

    monkeypatch.setattr(reconnecting, "deactivate", note)
    link.pulled = True
    eventually(lambda: worker.read(CLOCK.now_ns()) and not reconnecting.there)
    worker.deactivate(0)
    assert deactivated.wait(20.0)
    link.pulled = False

    eventually(lambda: reconnecting.there)
    assert link.done[-1].startswith("deactivate")
