"""Whatever process is killed, at whatever moment: the stage goes to its safe voltage, gently."""

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
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import configuration, is_alive, latched
from tests.daemon.waiting import eventually
from tests.hosted_rig import Write, hosted, writes

LOW_V, HIGH_V, SAFE_V = 0.0, 150.0, 5.0
SLEW_V_PER_S = 500.0  # less than the wave asks for now and then
GAIN_ERROR_V = 0.01 * HIGH_V  # what is read back, to ramp from, is not quite what was written
WAVE = {"kind": "sine", "low": 4.0, "high": 20.0, "frequency_hz": 1.5}

VICTIMS = ("loop", "supervisor", "supervisor, then safe", "both, then safe")
KILLS_IN_SHORT = 4  # each victim once, one of them on the way down
KILLS = [
    pytest.param(number, marks=[] if number < KILLS_IN_SHORT else pytest.mark.stress)
    for number in range(200)
]


class Stage:
    """A daemon with a rig that outlives it.

    Args:
        folder: Where the rig has its files.
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
        """Have it follow a wave, on a machine that may be too busy at first."""
        self.daemon.moving("wave", {"command_um": {"x": WAVE}, "duration_s": 600.0})

    def go_on_for(self, cycles: int) -> None:
        """Wait for a number of writes; where they end before, as in SAFE, have it run again."""
        end = len(self.writes()) + cycles

        def went_on() -> bool:
            if self.idle():
                self.run()
            return len(self.writes()) >= end

        eventually(went_on, 60.0)

    def idle(self) -> bool:
        """Tell whether it was not written to lately."""
        return time.monotonic_ns() - self.writes()[-1].asked_ns > NS_PER_S // 2

    def ramp_for(self, cycles: int) -> None:
        """Send it to its safe voltage and wait for a number of writes, or for the end of them."""
        self.daemon.do("stop")
        end = len(self.writes()) + cycles
        eventually(lambda: len(self.writes()) >= end or self.idle())

    def kill(self, victim: str) -> None:
        """Kill one of its processes or both, and wait until nobody drives the stage."""
        supervisor = self.daemon.process
        if victim != "loop":
            supervisor.kill()
        if victim.startswith(("loop", "both")):
            os.kill(self.loop_pid, signal.SIGKILL)
        assert supervisor.wait(60) == (1 if victim == "loop" else -signal.SIGKILL)
        if victim.endswith("safe"):  # as a service manager does, while a loop may still be ramping
            safe = self.daemon.command("safe", str(self.daemon.config), "--unless-clean")
            assert safe.returncode == 0, safe.stderr
        eventually(lambda: not is_alive(self.loop_pid))

    def in_force_v(self) -> float:
        """Return the voltage that the rig has now, in V; nobody else may be its client."""
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
    """Assert that no write was out of range or too fast, and that one process at a time wrote."""
    drivers = [pid for pid, _ in groupby(write.pid for write in trace)]
    assert len(drivers) == len(set(drivers))
    assert all(LOW_V <= write.drive_v <= HIGH_V for write in trace)
    for one, next_one in pairwise(trace):
        reach_v = SLEW_V_PER_S * (next_one.asked_ns - one.asked_ns) / NS_PER_S + 1e-6
        reach_v += 0.0 if one.pid == next_one.pid else GAIN_ERROR_V
        assert abs(next_one.drive_v - one.drive_v) <= reach_v, (one, next_one)


@pytest.mark.fault("P2")
@pytest.mark.parametrize("number", KILLS)
def test_killed(stage: Stage, number: int) -> None:
    """The trace of the rig keeps to range and slew rate, and ends at the safe voltage."""
    draw = random.Random(number)  # noqa: S311 - reproducible, not secret
    stage.run()
    stage.go_on_for(draw.randrange(40))
    if draw.random() < 0.2:  # on its way down already
        stage.ramp_for(draw.randrange(10))

    stage.kill(VICTIMS[number % len(VICTIMS)])

    trace = stage.writes()
    assert_gentle(trace)
    assert trace[-1].drive_v == SAFE_V
    assert stage.in_force_v() == pytest.approx(SAFE_V, abs=0.5)


@pytest.mark.fault("P2")
def test_restart_brings_the_rig_to_its_safe_voltage_first(stage: Stage) -> None:
    """Where nothing ramped down in between, the next daemon does, and wants somebody to look."""
    stage.run()
    stage.go_on_for(15)
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
