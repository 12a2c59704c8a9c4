"""The loop process before its first cycle, run in the process of the test."""

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.config.states import State
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.last_output import LastOutputWriter
from piezod.daemon.lock import device_lock
from piezod.daemon.loop import rate
from piezod.daemon.loop.devices import make_channels
from piezod.daemon.loop.rate import (
    MAX_CYCLES,
    MIN_CYCLES,
    kept_period_ns,
    measure_busy_ns,
    sustained_rate_hz,
    usable_spin_ns,
)
from piezod.daemon.loop.start import wait_for_devices, wait_for_lock
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.devices import registry
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity, Wiring
from piezod.devices.wiring import ChannelPair
from piezod.errors import AlreadyRunningError, DeviceUnavailableError
from piezod.messages.requests import Arm, Request, Shutdown
from piezod.telemetry.events import EventReader
from piezod.telemetry.layout import Layout
from piezod.telemetry.mailbox import MailboxAnswer, MailboxWriter
from piezod.telemetry.requests_codec import encode
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.succession import Succession, put_succession
from piezod.telemetry.words import Word
from piezod.testing.fake_clock import FakeClock
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.daemon.fake_controller import FakeController
from tests.daemon.loop_child import beat
from tests.daemon.waiting import eventually

SIMULATED = Path(__file__).parents[3] / "config" / "simulated.yaml"
ABSENT = "nothing answers; plug it in"


class AbsentRig(SimulatedRig):
    """A rig that cannot be opened while it has an error."""

    def __init__(self, error: Exception | None = None) -> None:
        super().__init__(SimulatedOptions(), Wiring.both("x"), 1)
        self.error = error

    def open(self) -> Identity:
        """Open, or raise the error."""
        if self.error is not None:
            raise self.error
        return super().open()


class Waiting:
    """A loop that waits for its devices in a thread."""

    def __init__(
        self, rig: AbsentRig, shared: SharedMap, known: dict[str, Identity] | None = None
    ) -> None:
        self._rig, self._shared, self._known = rig, shared, known or {}
        self.outcome: bool | Exception | None = None
        self._mailbox = MailboxWriter(shared)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        channels = Channels({"rig": self._rig}, {"x": ChannelPair("rig", "rig")})
        try:
            self.outcome = wait_for_devices(channels, self._shared, MonotonicClock(), self._known)
        except RuntimeError as error:
            self.outcome = error

    def ask(self, request: Request) -> MailboxAnswer:
        """Post a request; return its answer."""
        number = self._mailbox.post(encode(request), time.monotonic_ns() + 10 * 10**9)
        answer = eventually(lambda: self._mailbox.answer(number))
        assert answer is not None
        return answer

    def ended(self) -> bool | Exception | None:
        """Wait for the end; return the result."""
        self._thread.join()
        return self.outcome


@pytest.fixture
def unsupervised(tmp_path: Path) -> SharedMap:
    """Return a shared memory whose supervisor has never beaten."""
    return create(tmp_path / "loop.map", Layout(("x",), 64, 1_000_000))


@pytest.fixture
def shared(unsupervised: SharedMap) -> Iterator[SharedMap]:
    """Return a shared memory whose supervisor is alive."""
    silent = threading.Event()
    with ThreadPoolExecutor(1) as supervisor:
        beating = supervisor.submit(beat, unsupervised, silent)
        yield unsupervised
        silent.set()
        beating.result()


def test_present_devices_are_opened_at_once(shared: SharedMap) -> None:
    """The supervisor sees that the devices are open."""
    waiting = Waiting(AbsentRig(), shared)

    assert waiting.ended() is True
    assert shared.words[Word.DEVICES_OPEN] == 1
    assert shared.words[Word.HEALTHY_CYCLES] == 0


def test_absent_devices_are_tried_until_they_are_there(shared: SharedMap) -> None:
    """While a device is absent the process is BLIND and healthy, and refuses with the reason."""
    rig, events = AbsentRig(DeviceUnavailableError(ABSENT)), EventReader(shared)
    waiting = Waiting(rig, shared)
    eventually(lambda: shared.words[Word.HEALTHY_CYCLES] > 1)

    answer = waiting.ask(Arm())
    blind = shared.words[Word.LOOP_STATE]
    rig.error = None

    assert waiting.ended() is True
    assert (answer.accepted, answer.why) == (False, ABSENT)
    assert list(State)[blind] is State.BLIND
    assert [event.text for event in events.read()[0]] == [ABSENT, "the devices are open"]


def test_another_device_than_the_known_one_is_not_used(shared: SharedMap) -> None:
    """A device that takes the place of the known one counts as absent, with both identities."""
    rig, events = AbsentRig(), EventReader(shared)
    put_succession(shared, Succession())
    waiting = Waiting(rig, shared, {"rig": Identity("maker", "other", "7", "1")})
    eventually(lambda: shared.words[Word.HEALTHY_CYCLES] > 1)

    answer = waiting.ask(Shutdown())

    assert answer.accepted
    assert waiting.ended() is False
    assert not shared.words[Word.DEVICES_OPEN]
    assert "rig is another device" in events.read()[0][0].text


def test_waiting_ends_on_request(shared: SharedMap) -> None:
    """A shutdown ends the wait for a device."""
    waiting = Waiting(AbsentRig(DeviceUnavailableError(ABSENT)), shared)

    answer = waiting.ask(Shutdown())

    assert answer.accepted
    assert waiting.ended() is False


def test_unreadable_request_is_refused_while_waiting(shared: SharedMap) -> None:
    """An unreadable request does not end the process."""
    rig = AbsentRig(DeviceUnavailableError(ABSENT))
    waiting = Waiting(rig, shared)
    mailbox = MailboxWriter(shared)

    number = mailbox.post(b"junk", time.monotonic_ns() + 10 * 10**9)
    answer = eventually(lambda: mailbox.answer(number))
    rig.error = None

    assert answer is not None
    assert not answer.accepted
    assert waiting.ended() is True


def test_waiting_ends_without_supervisor(unsupervised: SharedMap) -> None:
    """The process ends if its supervisor is lost."""
    assert Waiting(AbsentRig(DeviceUnavailableError(ABSENT)), unsupervised).ended() is False


def test_emergency_stop_is_answered_while_nothing_is_driven(shared: SharedMap) -> None:
    """The answer says why there is nothing to stop."""
    rig = AbsentRig(DeviceUnavailableError(ABSENT))
    waiting = Waiting(rig, shared)
    eventually(lambda: shared.words[Word.HEALTHY_CYCLES] > 1)
    mailbox = MailboxWriter(shared)

    number = mailbox.post_estop()
    answer = eventually(lambda: mailbox.estop_answer(number))
    rig.error = None

    assert answer == (False, ABSENT, 0, 0.0)
    assert waiting.ended() is True


@pytest.mark.fault("P2")
def test_loop_of_an_earlier_run_is_waited_for(shared: SharedMap, tmp_path: Path) -> None:
    """An earlier loop may still ramp without a supervisor; requests are refused meanwhile."""
    path, mailbox = tmp_path / "loop.lock", MailboxWriter(shared)
    earlier = device_lock(path)
    number = mailbox.post(encode(Arm()), time.monotonic_ns() + 10 * 10**9)
    with ThreadPoolExecutor(1) as beside:
        lock = beside.submit(wait_for_lock, path, shared, MonotonicClock(), 60.0)
        answer = eventually(lambda: mailbox.answer(number))
        waited = not lock.done()
        earlier.release()
        mine = lock.result()

    assert waited
    assert answer is not None
    assert f"process {os.getpid()} has the devices" in answer.why
    assert mine is not None
    mine.release()


@pytest.mark.fault("P2")
def test_loop_that_does_not_end_keeps_the_devices(shared: SharedMap, tmp_path: Path) -> None:
    """Two loops never drive one amplifier; error and log name the process to end."""
    path, events = tmp_path / "loop.lock", EventReader(shared)
    with device_lock(path), pytest.raises(AlreadyRunningError, match=f"kill -9 {os.getpid()}"):
        wait_for_lock(path, shared, FakeClock(10**9), 0.1)

    assert [(event.kind, event.severity) for event in events.read()[0]] == [("lock", "error")]


def test_waiting_for_an_earlier_loop_ends_on_request(shared: SharedMap, tmp_path: Path) -> None:
    """A shutdown ends the wait for the lock."""
    mailbox = MailboxWriter(shared)
    mailbox.post(encode(Shutdown()), time.monotonic_ns() + 10 * 10**9)

    with device_lock(tmp_path / "loop.lock"):
        assert wait_for_lock(tmp_path / "loop.lock", shared, MonotonicClock(), 60.0) is None


def test_broken_driver_ends_the_process(shared: SharedMap) -> None:
    """An exception that is no `DeviceError` is raised, and nothing is tried again."""
    outcome = Waiting(AbsentRig(RuntimeError("a mistake")), shared).ended()

    assert isinstance(outcome, RuntimeError)


@pytest.fixture
def controller(tmp_path: Path) -> FakeController:
    """Return a disarmed controller of the simulated rig."""
    clock = FakeClock(10**9)
    devices = make_channels(load_daemon(SIMULATED, registry))
    devices.open()
    devices.activate(clock.now_ns())
    timed = TimedChannels(devices, clock, LastOutputWriter(tmp_path / "output.map", 1))
    controller = FakeController(timed, clock)
    controller.state = State.SAFE
    return controller


def test_duration_of_a_cycle_is_the_median(controller: FakeController) -> None:
    """The median of 200 cycles is returned."""
    controller.busy_ns = 50_000

    busy_ns = measure_busy_ns(controller, controller.clock)

    assert busy_ns == pytest.approx(50_000, abs=1000)
    assert len(controller.timings) == MAX_CYCLES


def test_slow_cycles_are_measured_for_a_short_time(controller: FakeController) -> None:
    """A slow loop does not wait minutes for the measurement."""
    controller.busy_ns = 100_000_000

    measure_busy_ns(controller, controller.clock)

    assert len(controller.timings) == MIN_CYCLES


@pytest.mark.parametrize(
    ("busy_ns", "period_ns"), [(60_000, 1_000_000), (60_000, 100_000), (90_000, 100_000)]
)
def test_spinning_leaves_time_to_sleep(busy_ns: int, period_ns: int) -> None:
    """Spinning gives way, because a real-time thread that never sleeps loses 50 ms each second."""
    spin_ns = usable_spin_ns(40_000, busy_ns, period_ns)

    assert 0 <= spin_ns <= 40_000
    assert spin_ns == 0 or spin_ns + busy_ns <= 0.8 * period_ns


@pytest.mark.parametrize(
    ("runtime", "part"), [("950000", 0.95), ("-1", 1.0), ("100000", 0.1), ("no number", 1.0)]
)
def test_loop_leaves_room_below_what_the_kernel_leaves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, runtime: str, part: float
) -> None:
    """A thread that uses more of the time than the kernel allows stands still for the rest."""
    files = tmp_path / "runtime", tmp_path / "period"
    for file, text in zip(files, (runtime, "1000000"), strict=True):
        file.write_text(text, encoding="utf-8")
    monkeypatch.setattr(rate, "THROTTLE", files)

    assert rate.throttle_part() == part
    assert 0.0 <= rate.usable_part() < part
    assert usable_spin_ns(10**9, 10_000, 10**6) + 10_000 <= max(part * 10**6, 10_000)


def test_rate_leaves_a_part_of_the_period_free() -> None:
    """The rate is inversely proportional to the duration of a cycle, and below its inverse."""
    assert sustained_rate_hz(100_000) < 10_000
    assert sustained_rate_hz(100_000) == 2 * sustained_rate_hz(200_000)


@pytest.mark.parametrize("period_ns", [10**6, 5 * 10**6])
def test_period_that_the_machine_keeps_stays(period_ns: int) -> None:
    """A cycle may take half of it."""
    assert kept_period_ns(period_ns, period_ns // 2) == period_ns


@pytest.mark.parametrize(("busy_us", "periods"), [(26, 2), (100, 4), (101, 5)])
def test_loop_that_is_too_fast_runs_in_every_second_period_or_less(
    busy_us: int, periods: int
) -> None:
    """At 20 kHz a cycle of 100 µs then takes half of its time."""
    assert kept_period_ns(50_000, busy_us * 1000) == periods * 50_000
