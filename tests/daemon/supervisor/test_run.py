"""A stage from start to end in the process of the test, with a loop without devices."""

import os
import signal
import time
from contextlib import AbstractContextManager, nullcontext
from subprocess import Popen

import httpx
import pytest

from piezod.config.states import State
from piezod.control.in_force import OUTPUT_WAIT_S
from piezod.daemon.durations import ramp_s, ramped_down_within_s
from piezod.daemon.loop import accept
from piezod.daemon.supervisor import processes
from piezod.daemon.supervisor.signals import Signals
from piezod.errors import DeviceUnavailableError, PiezodError, StillDrivenError
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import HUNG, Word
from tests.conftest import Reaction
from tests.daemon.bench import write_record
from tests.daemon.daemons import configuration, is_alive
from tests.daemon.supervisor.run_rig import Rig
from tests.daemon.waiting import eventually

LEFT = "axis x: the voltage is UNKNOWN: no device; the voltage stays at 60.00 V"


def test_stage_ends_in_order(rig: Rig) -> None:
    """After a loop that ends on request, nobody else ramps down."""
    answers: list[httpx.Response] = []

    def healthy() -> bool:
        answers.append(rig.ask("GET", "health"))
        return answers[-1].status_code == 200

    def until_healthy() -> None:
        eventually(healthy)

    in_order = rig.run(until_healthy)

    assert in_order
    assert answers[-1].json()["healthy"]
    assert (len(rig.loops), rig.rescues) == (1, ["end"])
    assert not rig.paths.running.exists()
    assert not rig.paths.api_socket.exists()


@pytest.mark.fault("P1")
def test_signal_ends_it_in_order(rig: Rig) -> None:
    """SIGTERM has the same effect as a shutdown request."""
    assert rig.run(lambda: os.kill(os.getpid(), signal.SIGTERM))


@pytest.mark.fault("P1")
def test_signal_before_the_loop_answers_ends_it_in_order(rig: Rig) -> None:
    """A loop that has touched no device is killed, without a wait or a ramp."""
    rig.loop_code[:] = ["import time; time.sleep(600)"]
    signals = Signals()
    signals.receive(signal.SIGTERM)

    assert rig.start(signals)

    assert (len(rig.loops), rig.rescues) == (1, [])
    assert not rig.paths.running.exists()


@pytest.mark.fault("P1")
@pytest.mark.parametrize("left", [[], [LEFT]])
def test_signal_while_an_earlier_run_is_ramped_down(rig: Rig, left: list[str]) -> None:
    """The ramp is waited for, no loop is started, and the mark stays."""
    rig.left[:] = left
    signals = Signals()
    signals.receive(signal.SIGTERM)
    rig.paths.make_folders()
    rig.paths.running.touch()

    with refused(left):
        assert rig.start(signals)

    assert rig.rescues == ["ramp", "end"]
    assert rig.loops[0].wait() == -signal.SIGKILL
    assert rig.paths.running.exists()


def refused(left: list[str]) -> AbstractContextManager[object]:
    """Return what expects the lines of axes that stay driven, if there are any."""
    return pytest.raises(StillDrivenError, match="stays at 60") if left else nullcontext()


def test_ramp_down_is_not_cut_off(rig: Rig) -> None:
    """A ramp-down may take three times the duration of its ramp, and a minute."""
    config = configuration(rig.config.parent, safety="{safe_v: 0, ramp_v_per_s: 0.1}")
    slow = accept.load(config)

    assert ramp_s(slow) == 1500
    assert ramped_down_within_s(slow) == 3 * 1500 + 60 + 2 * OUTPUT_WAIT_S


@pytest.mark.parametrize("left", [[], [LEFT]])
def test_lost_loop_is_ramped_down(rig: Rig, left: list[str]) -> None:
    """An error has the voltage that stays, and the mark stays."""
    rig.left[:] = left

    with refused(left):
        assert not rig.run(lambda: _kill_and_wait(rig, signal.SIGKILL))

    assert (len(rig.loops), rig.rescues) == (1, ["ramp", "end"])
    assert rig.paths.running.exists()


@pytest.mark.fault("L3")
def test_hung_loop_is_killed(
    rig: Rig, capsys: pytest.CaptureFixture[str], reaction: Reaction
) -> None:
    """A loop without cycles is killed, and the stage ramped down; the next start reports it."""

    def hang() -> None:
        began_s, loop = time.monotonic(), rig.loops[0]
        os.kill(loop.pid, signal.SIGSTOP)
        eventually(lambda: not is_alive(loop.pid))
        reaction("L3", ms=(time.monotonic() - began_s) * 1e3)
        eventually(lambda: not rig.paths.api_socket.exists())

    in_order = rig.run(hang)

    assert not in_order
    log = capsys.readouterr().err
    assert "it runs no cycles any more" in log
    assert "fault=L3" in log
    assert rig.rescues == ["ramp", "end"]
    last_end: list[int] = []
    rig.run(lambda: last_end.append(attach(rig.paths.loop_map).words[Word.UNCLEAN]))
    assert last_end == [HUNG]


def _kill_and_wait(rig: Rig, number: int) -> None:
    pid = rig.loops[0].pid
    os.kill(pid, number)
    eventually(lambda: not rig.paths.api_socket.exists())
    assert not is_alive(pid)


def test_device_that_must_be_there(rig: Rig) -> None:
    """With --require-device an absent device is an error, and the end is orderly."""
    with pytest.raises(DeviceUnavailableError, match="absent"):
        rig.start(require_device=True)

    assert not rig.paths.running.exists()


@pytest.mark.parametrize("left", [[], [LEFT]])
def test_stage_that_its_loop_left_unsafe_is_ramped_down(rig: Rig, left: list[str]) -> None:
    """An end on request is orderly if the rescuer reaches the safe voltage."""
    rig.left[:] = left

    def drive() -> None:
        shared = attach(rig.paths.loop_map, writable=True)
        write_record(shared, State.FAULT, drive_v=80.0)

    with refused(left):
        assert rig.run(drive)
    assert rig.rescues == ["ramp", "end"]
    assert rig.paths.running.exists()


@pytest.mark.fault("P2")
def test_mark_of_an_earlier_run_stays_if_no_device_was_opened(rig: Rig) -> None:
    """The voltage of the earlier run may still be in force."""
    rig.paths.make_folders()
    rig.paths.running.touch()
    unclean: list[int] = []

    rig.run(lambda: unclean.append(attach(rig.paths.loop_map).words[Word.UNCLEAN]))

    assert unclean == [1]
    assert rig.paths.running.exists()


@pytest.mark.fault("P2")
def test_voltage_of_an_earlier_run_is_ramped_down_first(rig: Rig) -> None:
    """The ramp comes before the start of the loop, which starts even if the ramp fails."""
    rig.paths.make_folders()
    rig.paths.running.touch()
    rig.left[:] = [LEFT]
    before: list[str] = []

    rig.run(lambda: before.extend(rig.rescues))

    assert before == ["ramp"]


def test_loop_that_cannot_be_started_touches_nothing(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If no process can be started, the run fails and makes no mark."""

    def none_left(*_arguments: str) -> "Popen[bytes]":
        raise BlockingIOError(11, "no process left")

    monkeypatch.setattr(processes, "start", none_left)

    with pytest.raises(BlockingIOError):
        rig.start()

    assert not rig.paths.running.exists()


@pytest.mark.fault("P2")
def test_loop_that_ends_before_its_first_cycle_leaves_no_mark(rig: Rig) -> None:
    """It has driven nothing, so that the next start need not be checked by an operator."""
    configuration(rig.config.parent, title="broken")

    assert not rig.start()

    assert rig.rescues == ["ramp", "end"]
    assert not rig.paths.running.exists()


@pytest.mark.fault("P2")
@pytest.mark.parametrize("unclean", [False, True])
def test_start_that_fails_leaves_the_mark_as_it_was(rig: Rig, unclean: bool) -> None:
    """If a file of the stage cannot be made, the loop has not been started."""
    rig.paths.make_folders()
    rig.paths.flights.touch()  # must be a folder
    if unclean:
        rig.paths.running.touch()

    with pytest.raises(FileExistsError):
        rig.start()

    assert rig.loops[0].poll() == -signal.SIGKILL
    assert rig.paths.running.exists() is unclean


@pytest.mark.fault("P6")
def test_copy_that_cannot_be_written_is_named(rig: Rig) -> None:
    """The loop process reports the file of the error, and no mark is made."""
    error = '{"failed": [28, "No space left on device", "config-a/rig.yaml"]}'
    rig.loop_code[:] = [f"print({error!r})"]

    with pytest.raises(OSError, match=r"config-a/rig\.yaml"):
        rig.start()

    assert not rig.paths.running.exists()


def test_loop_of_another_version_is_refused(rig: Rig) -> None:
    """After an upgrade a reload would start one, which reads the shared memory in another way."""
    answer = '{"accepted": {}, "named_files": {}, "version": "999.0"}'
    rig.loop_code[:] = [f"print({answer!r})"]

    with pytest.raises(PiezodError, match="restart the daemon"):
        rig.start()

    assert not rig.paths.running.exists()
