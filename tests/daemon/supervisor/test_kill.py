"""Processes are killed at random moments: the stage always goes to its safe voltage, gently."""

import os
import random
import signal
import time
from collections.abc import Iterator
from itertools import groupby, pairwise
from pathlib import Path

import pytest

from piezod.units import NS_PER_S
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.options import EmulatedOptions
from tests.conftest import Reaction
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import configuration, is_alive, latched
from tests.daemon.waiting import eventually
from tests.hosted_rig import Write, hosted, writes

LOW_V, HIGH_V, SAFE_V = 0.0, 150.0, 5.0
SLEW_V_PER_S = 500.0  # the wave needs more in some parts
GAIN_ERROR_V = 0.01 * HIGH_V  # the read-back voltage, where a ramp begins, differs that much
WAVE = {"kind": "sine", "low": 4.0, "high": 20.0, "frequency_hz": 1.5}

VICTIMS = ("loop", "supervisor", "supervisor, then safe", "both, then safe")
KILLS_IN_SHORT = 4  # each victim once, one of them during its ramp
KILLS = [
    pytest.param(number, marks=[] if number < KILLS_IN_SHORT else pytest.mark.stress)
    for number in range(200)
]


class Stage:
    """A daemon with a rig that outlives it.

    Args:
        folder: Folder for the files of the rig.
        start: Starts a daemon.
    """

    def __init__(self, folder: Path, start: StartDaemon) -> None:
        socket = folder / "rig.sock"
        self._trace = folder / "trace.csv"
        self._rig = EmulatedRig(EmulatedOptions(socket=str(socket), deadline_ms=1000.0), ("x",))
        limits = f"drive_min_v: {LOW_V}, drive_max_v: {HIGH_V}, slew_v_per_s: {SLEW_V_PER_S}"
        config = configuration(
            folder,
            rate_hz="20",
            rig=f"{{driver: emulated, options: {{socket: {socket}, deadline_ms: 500}}}}",
            limits=f"{{{limits}, rest_v: 0}}",
            safety=f"{{safe_v: {SAFE_V}, ramp_v_per_s: 200}}",
        )
        self.daemon = start(config).up()
        self.loop_pid = self.daemon.loop_pid

    def writes(self) -> list[Write]:
        """Return every voltage that was written."""
        return writes(self._trace)

    def run(self) -> None:
        """Follow a wave; repeat the command on a machine that is too busy at first."""
        self.daemon.moving("wave", {"command_um": {"x": WAVE}, "duration_s": 600.0})

    def wait_for_writes(self, cycles: int) -> None:
        """Wait for a number of writes; if they end before, as in SAFE, follow the wave again."""
        end = len(self.writes()) + cycles

        def written() -> bool:
            if self.idle():
                self.run()
            return len(self.writes()) >= end

        eventually(written, 60.0)

    def idle(self) -> bool:
        """Return whether the last write is longer than half a second ago."""
        return time.monotonic_ns() - self.writes()[-1].asked_ns > NS_PER_S // 2

    def ramp_for(self, cycles: int) -> None:
        """Begin a ramp to the safe voltage, and wait for a number of writes, or for their end."""
        self.daemon.do("stop")
        end = len(self.writes()) + cycles
        eventually(lambda: len(self.writes()) >= end or self.idle())

    def kill(self, victim: str) -> None:
        """Kill one of its processes or both, and wait until no process drives the stage."""
        supervisor = self.daemon.process
        if victim != "loop":
            supervisor.kill()
        if victim.startswith(("loop", "both")):
            os.kill(self.loop_pid, signal.SIGKILL)
        assert supervisor.wait(60) == (1 if victim == "loop" else -signal.SIGKILL)
        if victim.endswith("safe"):  # as the service manager does; a loop may still be ramping
            safe = self.daemon.command("safe", str(self.daemon.config), "--unless-clean")
            assert safe.returncode == 0, safe.stderr
        eventually(lambda: not is_alive(self.loop_pid))

    def in_force_v(self) -> float:
        """Return the present voltage of the rig, in V; the rig must have no other client."""
        self._rig.open()
        (drive_v,) = self._rig.read_back(time.monotonic_ns())
        self._rig.close()
        return drive_v


@pytest.fixture
def stage(tmp_path: Path, start: StartDaemon) -> Iterator[Stage]:
    """Return a stage that is at rest."""
    with hosted(tmp_path / "rig.sock", tmp_path / "trace.csv"):
        yield Stage(tmp_path, start)


def assert_gentle(trace: list[Write]) -> None:
    """Assert that every write is in range and slow enough, and by one process at a time."""
    drivers = [pid for pid, _ in groupby(write.pid for write in trace)]
    assert len(drivers) == len(set(drivers))
    assert all(LOW_V <= write.drive_v <= HIGH_V for write in trace)
    for one, next_one in pairwise(trace):
        reach_v = SLEW_V_PER_S * (next_one.asked_ns - one.asked_ns) / NS_PER_S + 1e-6
        reach_v += 0.0 if one.pid == next_one.pid else GAIN_ERROR_V
        assert abs(next_one.drive_v - one.drive_v) <= reach_v, (one, next_one)


@pytest.mark.fault("P2")
@pytest.mark.parametrize("number", KILLS)
def test_killed(stage: Stage, number: int, reaction: Reaction) -> None:
    """The writes keep to range and slew rate, and end at the safe voltage."""
    draw = random.Random(number)  # noqa: S311 - reproducible, not secret
    stage.run()
    stage.wait_for_writes(draw.randrange(40))
    if draw.random() < 0.2:  # kill during a ramp
        stage.ramp_for(draw.randrange(10))

    driven, killed_ns = len(stage.writes()), time.monotonic_ns()
    victim = VICTIMS[number % len(VICTIMS)]
    stage.kill(victim)

    trace = stage.writes()
    if victim == "loop" and len(trace) > driven:
        first_ns = next(write.asked_ns for write in trace if write.pid != stage.loop_pid)
        reaction("P2", ms=(first_ns - killed_ns) / 1e6)
    assert_gentle(trace)
    assert trace[-1].drive_v == SAFE_V
    assert stage.in_force_v() == pytest.approx(SAFE_V, abs=0.5)


@pytest.mark.fault("P2")
def test_restart_brings_the_rig_to_its_safe_voltage_first(stage: Stage) -> None:
    """If nothing ramped down before, the next daemon does, and latches P2."""
    stage.run()
    stage.wait_for_writes(15)
    stage.kill("both")
    left_v = stage.in_force_v()
    stage.daemon.start()
    status = stage.daemon.until("FAULT", 90.0)
    # On a busy machine the rig may not answer in the very first cycle.
    drive_v = eventually(lambda: stage.daemon.status()["axes"]["x"]["drive_v"], 20.0)
    ended_v = stage.writes()[-1].drive_v
    refused = stage.daemon.ask("POST", "arm", {}).status_code

    assert left_v > SAFE_V + 5
    assert ended_v == SAFE_V
    assert drive_v == pytest.approx(SAFE_V, abs=0.5)
    assert latched(status) == ["P2"]
    assert refused == 409

    stage.loop_pid = stage.daemon.loop_pid
    stage.run()
    stage.daemon.do("stop")
    stage.daemon.until("SAFE")

    assert_gentle(stage.writes())
    assert stage.writes()[-1].drive_v == SAFE_V
