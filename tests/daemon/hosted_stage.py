"""A daemon with a rig that outlives it, and records every voltage that is written."""

import os
import signal
import time
from itertools import groupby, pairwise
from pathlib import Path

from piezod.units import NS_PER_S
from piezod_drivers.emulated.driver import EmulatedRig
from piezod_drivers.emulated.options import EmulatedOptions
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import children, configuration, is_alive
from tests.daemon.waiting import eventually
from tests.hosted_rig import Write, writes

LOW_V, HIGH_V, SAFE_V = 0.0, 150.0, 5.0
SLEW_V_PER_S = 500.0  # the wave needs more in some parts
GAIN_ERROR_V = 0.01 * HIGH_V  # the read-back voltage, where a ramp begins, differs that much
WAVE = {"kind": "sine", "low": 4.0, "high": 20.0, "frequency_hz": 1.5}


class HostedStage:
    """A daemon with a rig that outlives it."""

    def __init__(
        self, folder: Path, start: StartDaemon, ramp_v_per_s: float = 200.0, /, **environ: str
    ) -> None:
        socket = folder / "rig.sock"
        self._trace = folder / "trace.csv"
        self._rig = EmulatedRig(EmulatedOptions(socket=str(socket), deadline_ms=1000.0), ("x",))
        limits = f"drive_min_v: {LOW_V}, drive_max_v: {HIGH_V}, slew_v_per_s: {SLEW_V_PER_S}"
        config = configuration(
            folder,
            rate_hz="20",
            rig=f"{{driver: emulated, options: {{socket: {socket}, deadline_ms: 500}}}}",
            limits=f"{{{limits}, rest_v: 0}}",
            safety=f"{{safe_v: {SAFE_V}, ramp_v_per_s: {ramp_v_per_s:g}}}",
        )
        self.daemon = start(config, **environ).up()
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
        pids = children(supervisor.pid)
        if victim != "loop":
            supervisor.kill()
        if victim.startswith(("loop", "both")):
            os.kill(self.loop_pid, signal.SIGKILL)
        assert supervisor.wait(60) == (1 if victim == "loop" else -signal.SIGKILL)
        if victim.endswith("safe"):  # as the service manager does; a loop may still be ramping
            safe = self.daemon.command("safe", str(self.daemon.config), "--unless-clean")
            assert safe.returncode == 0, safe.stderr
        eventually(lambda: not any(map(is_alive, pids)), 60.0)  # the rescuer ends last

    def kill_rescuer(self) -> None:
        """Kill the process that would ramp the stage down."""
        for pid in children(self.daemon.process.pid) - {self.loop_pid}:
            os.kill(pid, signal.SIGKILL)

    def in_force_v(self) -> float:
        """Return the present voltage of the rig, in V; the rig must have no other client."""
        self._rig.open()
        (drive_v,) = self._rig.read_back(time.monotonic_ns())
        self._rig.close()
        return drive_v


def assert_gentle(trace: list[Write], late_s: float = 0.0) -> None:
    """Assert that every write is in range and slow enough, and by one process at a time.

    On a busy machine a thread writes, and may send a setpoint late by `late_s` and the next one in
    time.
    """
    drivers = [pid for pid, _ in groupby(write.pid for write in trace)]
    assert len(drivers) == len(set(drivers))
    assert all(LOW_V <= write.drive_v <= HIGH_V for write in trace)
    for one, next_one in pairwise(trace):
        elapsed_s = (next_one.asked_ns - one.asked_ns) / NS_PER_S + late_s
        reach_v = SLEW_V_PER_S * elapsed_s + 1e-6
        reach_v += 0.0 if one.pid == next_one.pid else GAIN_ERROR_V
        assert abs(next_one.drive_v - one.drive_v) <= reach_v, (one, next_one)
