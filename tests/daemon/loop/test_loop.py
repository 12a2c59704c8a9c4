import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import pytest

from piezod.config.gate_reasons import GateReason
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.daemon.last_output import LastOutputReader, LastOutputWriter
from piezod.daemon.loop.device_counters import DeviceCounters
from piezod.daemon.loop.loop import SUPERVISOR_LATE_NS, SUPERVISOR_LOST_NS, Loop
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.timed_channels import NOT_WRITTEN, TimedChannels
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.channels import Channels
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.devices.wiring import ChannelPair
from piezod.messages.requests import Estop, Goto, Hold, Shutdown, Stop
from piezod.telemetry.arrays import RingReader
from piezod.telemetry.cycle_counts import counts_of
from piezod.telemetry.device_counts import DeviceCounts, device_counts_of
from piezod.telemetry.events import EventReader
from piezod.telemetry.layout import Layout
from piezod.telemetry.learned import LearnedReader
from piezod.telemetry.mailbox import MailboxWriter
from piezod.telemetry.record import StageEvent
from piezod.telemetry.requests_codec import encode
from piezod.telemetry.ring import RecordReader
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.stream import StreamWriter
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.conftest import Reaction
from tests.daemon.fake_controller import FakeController

PERIOD_NS = 1_000_000
AXES = ("x", "y")


class FakeBus(SimulatedRig):
    """A device with counts that a test sets."""

    exchanges: int
    exchange_faults: Mapping[DeviceFlag, int]

    def __init__(self, wiring: Wiring) -> None:
        super().__init__(SimulatedOptions(), wiring, 1)


class Rig(NamedTuple):
    """A loop and all that it is connected to."""

    loop: Loop
    controller: FakeController
    clock: FakeClock
    shared: SharedMap
    output: Path

    def run(self, cycles: int, each: Callable[[], object] = lambda: None) -> None:
        """Run cycles, and call a function before each."""
        for _ in range(cycles):
            each()
            self.loop.cycle()

    def beat(self) -> None:
        """Renew the beat of the supervisor."""
        self.shared.words[Word.SUPERVISOR_BEAT_NS] = self.clock.t_ns


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """Return a loop over two simulated axes, with a controller that accepts every request."""
    clock = FakeClock(10**9)
    pairs = {axis: ChannelPair("rig", "rig") for axis in AXES}
    channels = Channels({"rig": SimulatedRig(SimulatedOptions(), Wiring.both(AXES), 1)}, pairs)
    channels.open()
    channels.activate(clock.now_ns())
    output = tmp_path / "output.map"
    timed = TimedChannels(channels, clock, LastOutputWriter(output, len(AXES)))
    controller = FakeController(timed, clock)
    shared = create(tmp_path / "loop.map", Layout(AXES, 2000, PERIOD_NS))
    loop = Loop(controller, timed, shared, clock, Pacer(clock, PERIOD_NS, 40_000))
    return Rig(loop, controller, clock, shared, output)


def test_every_cycle_leaves_its_record(rig: Rig) -> None:
    """One record a cycle has its axes, faults beyond the 64th, and enumerations as numbers."""
    reader = RingReader(rig.shared)

    rig.run(100)

    records, lost = reader.read(1000)
    assert (len(records), lost) == (100, 0)
    assert set(records["t_ns"][1:] - records["t_ns"][:-1]) == {PERIOD_NS}
    last = records[-1]
    assert list(State)[last["state"]] is State.RUN
    assert (last["present_lo"], last["present_hi"]) == (1 << 3, 1 << 6)
    assert (last["latched_lo"], last["latched_hi"]) == (0, 1)
    axis = last["axes"][1]
    assert list(Mode)[axis["mode"]] is Mode.ADAPTIVE
    assert list(GateReason)[axis["gate"]] is GateReason.QUIET
    assert (axis["drive_v"], axis["motion"], axis["on_target"]) == (7.5, 3, True)


def test_phases_of_a_cycle_are_recorded(rig: Rig) -> None:
    """The record has the durations of read, computation and write, and the instant of the write."""
    rig.controller.busy_ns = 200_000

    rig.run(1)

    record = RecordReader(rig.shared).latest()
    assert record is not None
    assert 0 < record["read_ns"] < 1000
    assert 0 < record["write_ns"] < 1000
    assert record["compute_ns"] == pytest.approx(200_000, abs=1000)
    assert record["write_late_ns"] == pytest.approx(200_000, abs=1000)


def test_cycles_are_counted(rig: Rig) -> None:
    """The histograms have every cycle; one that begins half a period late is a late one."""
    rig.run(2)
    rig.controller.command_um = 1e-3
    rig.run(1)
    rig.clock.t_ns += 2_700_000
    rig.run(1)

    counts = counts_of(rig.shared)
    assert counts.late == 1
    assert counts.lateness.total == pytest.approx(700_000, abs=1000)
    assert [sum(each.buckets) for each in (counts.lateness, counts.duration)] == [4, 4]
    assert [sum(each.buckets) for each in counts.errors] == [2, 2]  # those with a command


def test_counts_of_devices_are_published(rig: Rig) -> None:
    """A device on a bus has its exchanges and faults, one behind a worker also its rounds."""
    link = FakeBus(Wiring.both(AXES))
    link.exchanges, link.exchange_faults = 5, {DeviceFlag.BUSY: 2}
    link.open()
    worker = DeviceWorker(link, rig.clock, PERIOD_NS, PERIOD_NS)
    worker.rounds, worker.rounds_ns = 3, 4000
    shared = create(rig.output.with_name("m"), Layout(AXES, 64, PERIOD_NS, ("rig", "link")))
    devices = {"rig": SimulatedRig(SimulatedOptions(), Wiring.both(AXES), 1), "link": link}

    DeviceCounters(shared, devices, {**devices, "link": worker}).publish()

    assert device_counts_of(shared, 1) == [
        DeviceCounts(0, 0, 0, [0]),
        DeviceCounts(5, 3, 4000, [2]),
    ]


def test_cycle_that_writes_nothing_records_no_write(rig: Rig) -> None:
    """The record of a cycle without a write has no instant of a write."""
    rig.controller.state = State.SAFE

    rig.run(1)

    record = RecordReader(rig.shared).latest()
    assert record is not None
    assert (record["write_late_ns"], record["write_ns"]) == (NOT_WRITTEN, 0)


def test_written_voltages_are_stored(rig: Rig) -> None:
    """The last voltage of each axis is in the file that `piezod safe` reads."""
    rig.run(3)

    assert [output.drive_v for output in LastOutputReader(rig.output).read()] == [7.5, 8.5]


def test_requests_are_executed_and_answered(rig: Rig) -> None:
    """Each cycle executes one request, in order, and each request gets its answer."""
    mailbox = MailboxWriter(rig.shared)
    sent = [Goto(position_um=1.0), Goto(position_um=2.0)]
    first, second = (mailbox.post(encode(each), 2 * 10**9) for each in sent)

    rig.run(2)
    early = mailbox.answer(second)
    rig.run(1)

    assert early is None
    assert rig.controller.requests == sent
    assert mailbox.answer(first) == (True, "", 1, 0.5)
    assert mailbox.answer(second) == (True, "", 2, 0.5)


def test_answer_comes_with_the_state_that_the_request_causes(rig: Rig) -> None:
    """When the answer arrives, the newest record has its consequences."""
    mailbox = MailboxWriter(rig.shared)
    number, estop = mailbox.post(encode(Goto(position_um=1.0)), 2 * 10**9), mailbox.post_estop()
    rig.run(1)
    early = mailbox.answer(number), mailbox.estop_answer(estop)
    rig.controller.state = State.HOLD  # what the request does
    rig.run(1)

    assert early == (None, None)
    assert mailbox.answer(number) is not None
    assert mailbox.estop_answer(estop) is not None
    assert list(State)[rig.shared.words[Word.LOOP_STATE]] is State.HOLD


def test_last_request_is_answered(rig: Rig) -> None:
    """A loop that ends because of a request answers it."""
    mailbox = MailboxWriter(rig.shared)
    number = mailbox.post(encode(Shutdown()), 2 * 10**9)

    rig.loop.run()

    assert mailbox.answer(number) is not None


def test_request_that_cannot_be_read_is_refused(rig: Rig) -> None:
    """An unreadable request is refused, and the loop runs on."""
    mailbox = MailboxWriter(rig.shared)
    number = mailbox.post(b"junk", 2 * 10**9)

    rig.run(2)

    answer = mailbox.answer(number)
    assert answer is not None
    assert not answer.accepted
    assert "cannot be read" in answer.why


def test_setpoints_come_before_the_cycle(rig: Rig) -> None:
    """The newest streamed setpoint of an axis reaches the controller once."""
    StreamWriter(rig.shared).set(1, 4.5, 77)

    rig.run(2)

    assert rig.controller.setpoints == [(1, 4.5, 77)]


def test_events_are_published(rig: Rig) -> None:
    """Every event of the controller is published."""
    reader = EventReader(rig.shared)
    rig.controller.events = [StageEvent(1, "info", "state", "SAFE to READY")]

    rig.run(1)

    assert [event.text for event in reader.read()[0]] == ["SAFE to READY"]


def test_learned_parameters_are_published_twenty_times_a_second(rig: Rig) -> None:
    """The axes are published in turn."""
    reader = LearnedReader(rig.shared)

    rig.run(100)

    for axis in range(2):
        learned = reader.read(axis)
        assert learned is not None
        assert list(learned.weights) == [axis + 0.5]
    turns = rig.shared.part("learned").cast("q")[0]
    assert turns == 2


def test_cycles_that_skip_are_counted_and_not_healthy(rig: Rig) -> None:
    """Only cycles on schedule feed the watchdog."""
    rig.run(5)
    rig.clock.spend_ns(4 * PERIOD_NS)
    rig.run(5)

    words = rig.shared.words
    assert words[Word.SKIPPED_CYCLES] == 3
    assert words[Word.HEALTHY_CYCLES] == 9
    assert words[Word.LOOP_STATE] == list(State).index(State.RUN)
    assert rig.controller.timings[5].skipped == 3


def test_next_cycle_gets_the_duration_of_the_last_one(rig: Rig) -> None:
    """The duration includes publishing."""
    rig.controller.busy_ns = 300_000

    rig.run(2)

    assert rig.controller.timings[0].busy_ns == 0
    assert rig.controller.timings[1].busy_ns == pytest.approx(300_000, abs=3000)


def test_loop_ends_when_the_controller_has_finished(rig: Rig) -> None:
    """The loop ends after the shutdown has ended, not when it is requested."""
    MailboxWriter(rig.shared).post(encode(Shutdown()), 2 * 10**9, urgent=True)

    rig.loop.run()

    assert rig.controller.requests == [Shutdown()]


NO_PROCESS = 0
"""Id that no supervisor has."""


@pytest.mark.parametrize(
    ("supervisor", "limit_ns"),
    [(NO_PROCESS, SUPERVISOR_LOST_NS), (os.getppid(), SUPERVISOR_LATE_NS)],
    ids=["ended", "silent"],
)
@pytest.mark.fault("H1")
def test_loop_without_supervisor_shuts_down(
    rig: Rig, reaction: Reaction, supervisor: int, limit_ns: int
) -> None:
    """A second after the last beat the loop shuts down, once, and reports H1.

    If the process of the supervisor still lives, the loop waits for 3 s.
    """
    rig.shared.words[Word.SUPERVISOR_PID] = supervisor
    rig.run(100, rig.beat)
    before = list(rig.controller.requests)

    rig.run(limit_ns // PERIOD_NS - 1)
    shortly_before = list(rig.controller.requests)
    further = 0
    while not rig.controller.requests:
        rig.run(1)
        further += 1
    reaction("H1", cycles=further)
    rig.run(limit_ns // PERIOD_NS + 100)

    assert before == shortly_before == []
    assert rig.controller.requests == [Shutdown()]
    # Collections and page faults are those of the process of the tests.
    found = [each.fault for each in rig.controller.detections]
    assert [fault for fault in found if fault not in {"L6", "L8"}] == ["H1"]


@pytest.mark.fault("D8")
@pytest.mark.fault("P6")
@pytest.mark.fault("P7")
@pytest.mark.fault("P11")
@pytest.mark.fault("P15")
def test_faults_of_the_supervisor_are_reported_in_each_cycle(rig: Rig) -> None:
    """The faults that only the supervisor can find are present as long as it finds them."""
    words = rig.shared.words
    words[Word.SUPERVISOR_FAULTS] = (1 << len(SUPERVISOR_FAULTS)) - 1
    rig.run(2, rig.beat)
    words[Word.SUPERVISOR_FAULTS] = 0
    rig.run(2, rig.beat)

    assert [found.fault for found in rig.controller.detections] == [*SUPERVISOR_FAULTS] * 2


def test_process_counters_are_published(rig: Rig) -> None:
    """Page faults, collections and memory blocks are published once a second."""
    rig.run(2001, rig.beat)

    assert rig.shared.words[Word.ALLOCATED_BLOCKS] > 0
    assert rig.shared.words[Word.GC_COLLECTIONS] >= 0


def test_urgent_request_goes_first(rig: Rig) -> None:
    """A stop is executed before a movement that was posted earlier."""
    mailbox = MailboxWriter(rig.shared)
    mailbox.post(encode(Goto(position_um=1.0)), 2 * 10**9)
    mailbox.post(encode(Stop()), 2 * 10**9, urgent=True)

    rig.run(1)

    assert rig.controller.requests == [Stop()]


@pytest.mark.fault("E1")
def test_emergency_stop_waits_for_no_other_request(rig: Rig, reaction: Reaction) -> None:
    """An emergency stop is executed in the next cycle, once, even if the urgent lane is full."""
    mailbox = MailboxWriter(rig.shared)
    for _ in range(3):
        mailbox.post(encode(Hold()), 10**12, urgent=True)
    number = mailbox.post_estop()

    cycles = 0
    while Estop() not in rig.controller.requests:
        rig.run(1)
        cycles += 1
    rig.run(1)

    reaction("E1", cycles=cycles + 1)  # the next cycle carries it out
    assert rig.controller.requests == [Estop(), Hold(), Hold()]
    answer = mailbox.estop_answer(number)
    assert answer is not None
    assert answer.accepted
