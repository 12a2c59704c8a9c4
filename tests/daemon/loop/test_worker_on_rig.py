"""A device behind a worker that stops answering: from the blocked call to the stage's reaction."""

import threading
from collections.abc import Iterator, Sequence

import pytest

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.loop.worker import STUCK_NS, DeviceWorker
from piezod.devices.interface import Device, Identity, Sample
from piezod.devices.wrapper import DeviceWrapper
from piezod.messages import requests as rq
from piezod.telemetry.record import CycleRecord
from piezod.testing.fake_clock import FakeClock
from piezod.units import NS_PER_S
from tests.conftest import Reaction
from tests.control.rig_stage import ON_TIME, RigStage, cycles_until, quick_config
from tests.daemon.waiting import eventually

MS = 1_000_000


class BlockingDevice(DeviceWrapper):
    """A device that is open, and whose reads last as long as a test wants."""

    def __init__(self, device: Device) -> None:
        self._identity = device.open()
        super().__init__(device)
        self.free = threading.Event()
        self.free.set()
        self.blocked = False

    def open(self) -> Identity:
        """Return who it is."""
        return self._identity

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return samples, when it is free."""
        self.blocked = not self.free.is_set()
        self.free.wait()
        self.blocked = False
        return super().read(now_ns)


class WorkerStage(RigStage):
    """A stage that rests at 12 µm in feedforward, with its rig behind a worker at 1 kHz.

    A cycle begins when the worker has ended the rounds of the cycle before, unless it is blocked.
    """

    def __init__(self) -> None:
        self.clock = FakeClock(MS)
        config = quick_config().model_copy(update={"rate_hz": 1000.0})
        super().__init__(config, self._behind_worker)
        self.until("SAFE")
        self.do(rq.Arm(), rq.SelectMode(mode=Mode.FEEDFORWARD), rq.Goto(position_um=12.0))
        self.run(0.5)
        assert self.faults() == []

    def _behind_worker(self, device: Device) -> Device:
        self.device = BlockingDevice(device)
        self.worker = DeviceWorker(self.device, self.clock, MS, MS)
        self.worker.thread.start()
        return self.worker

    def cycle(self, timing: CycleTiming = ON_TIME) -> CycleRecord:
        """Run one cycle, and wait for the worker; return its record."""
        self.clock.t_ns = max(self.clock.t_ns, self.t_ns + self.period_ns)
        record = super().cycle(timing)
        eventually(lambda: self.worker.idle or self.device.blocked)
        return record


@pytest.fixture
def stage() -> Iterator[WorkerStage]:
    """Return a stage behind a worker, whose thread ends with the test."""
    stage = WorkerStage()
    yield stage
    stage.device.free.set()
    stage.worker.close()
    assert not stage.worker.thread.is_alive()


@pytest.mark.fault("B15")
def test_call_that_blocks_leads_to_blind(stage: WorkerStage, reaction: Reaction) -> None:
    """Unanswered writes make the stage blind (A1) long before the thread counts as stuck (B15).

    Nothing is written until the call returns. Then the stage ramps down.
    """
    before_ns = stage.t_ns
    stage.device.free.clear()
    after = [stage.cycle()]
    eventually(lambda: stage.device.blocked)
    after += stage.run(STUCK_NS / NS_PER_S + 0.05)
    blind = cycles_until(after, lambda record: record.state is State.BLIND)
    written = [t_ns for t_ns, _ in stage.channels.writes if t_ns > after[blind - 1].t_ns]
    stage.device.free.set()
    stage.until("FAULT")

    reaction("B15", cycles=blind)
    assert {record.state for record in after[blind - 1 :]} == {State.BLIND}
    assert STUCK_NS // MS < stage.cycles_to(Fault.B15, before_ns) <= STUCK_NS // MS + 3
    assert written == []
    assert stage.x.drive_v == pytest.approx(0.0, abs=0.5)
