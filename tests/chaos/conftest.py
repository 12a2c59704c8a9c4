"""A stage with a rig of its own, and what a test must not leave behind."""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.daemon import conftest as of_daemon
from tests.daemon.conftest import StartDaemon
from tests.daemon.daemons import NEXT_VERB, Daemon, is_alive
from tests.daemon.hosted_stage import HostedStage, assert_gentle
from tests.daemon.waiting import eventually
from tests.forked import STARTS_RESCUER, Piped

start = of_daemon.start  # the fixture
IDENT = {"kind": "sine", "low": 0.0, "high": 50.0, "frequency_hz": 0.1}
LATENESS = re.compile(r"fault=(L2|L5|S5|A1|B1|B15)\b")
SLOW_RAMP_V_PER_S = 20.0
"""Slow enough for a test that acts during a ramp."""
LATE_S = 1.0 / 20.0
"""A period: no test here is alone on its machine."""


class ChaosStage(HostedStage):
    """A stage that can be brought to each state."""

    rig: Piped  #: The process of the rig.

    def bring(self, state: str) -> None:
        """Bring a stage that is in SAFE to a state."""
        daemon = self.daemon
        if state in {"READY", "IDENT", "FAULT"}:
            daemon.do("arm")
        elif state != "SAFE":
            self.run()
            self.wait_for_writes(10)
        match state:
            case "IDENT":
                self.identify()
            case "HOLD":
                daemon.do("hold")
            case "RAMP":
                daemon.do("stop")
            case "ESTOP" | "FAULT":
                daemon.do("estop")
        if state != "RUN":
            daemon.until(state)

    def identify(self) -> None:
        """Drive a waveform of voltages; repeat it if late cycles hold the stage before."""
        fields = {"drive_v": {"x": IDENT}, "duration_s": 600.0}

        def driven() -> bool:
            answer = self.daemon.ask("POST", "identify", fields)
            if answer.status_code != 200:
                step = NEXT_VERB.get(self.daemon.status().get("state", ""), "")
                self.daemon.ask("POST", step or "arm", {})
            return answer.status_code == 200

        eventually(driven, 60.0)

    def was_late(self) -> bool:
        """Return whether this machine was too busy for loop or rig, by the faults in the log."""
        return bool(LATENESS.search(self.daemon.text))

    def assert_ended(self) -> None:
        """Assert that the writes were gentle, and that no process and no lock is left."""
        assert_gentle(self.writes(), LATE_S)
        assert not is_alive(self.loop_pid)
        assert left_behind(self.daemon) == []


def processes(of: str) -> list[str]:
    """Return the ids of all processes but this one that name a folder, or have mapped a file of it.

    The loop has mapped its shared memory, also after the file is removed.
    """
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and int(folder.name) != os.getpid():
            try:
                known = (folder / "cmdline").read_bytes() + (folder / "maps").read_bytes()
            except OSError:  # it has ended, or is another user's
                continue
            if of.encode() in known and is_alive(int(folder.name)):
                found.append(folder.name)
    return found


def left_behind(daemon: Daemon) -> list[str]:
    """Return the processes of a daemon that has ended, and files that no next start explains."""
    temporary = [str(each) for each in daemon.folder.rglob("*") if ".tmp" in each.name]
    sockets = [str(each) for each in daemon.folder.rglob("*.sock") if daemon.process.poll() == 0]
    return processes(str(daemon.folder)) + temporary + sockets


MakeStage = Callable[..., ChaosStage]


@pytest.fixture
def make_stage(tmp_path: Path, start: StartDaemon) -> Iterator[MakeStage]:
    """Return a function that starts a stage, with environment variables of its daemon.

    The daemon starts its rescuer as a program, as for users.
    """
    with mortal_rig(tmp_path / "rig.sock", tmp_path / "trace.csv") as rig:

        def make(**environ: str) -> ChaosStage:
            stage = ChaosStage(
                tmp_path, start, SLOW_RAMP_V_PER_S, **{STARTS_RESCUER: ""}, **environ
            )
            stage.rig = rig
            return stage

        yield make


@contextmanager
def mortal_rig(socket: Path, trace: Path) -> Iterator[Piped]:
    """Host a rig while the block runs, unless it is killed before."""
    process = Piped(("emulate", "simulated", "--socket", str(socket), "--trace", str(trace)))
    with process.stdin, process.stdout:
        try:
            assert "serving" in process.stdout.readline()
            yield process
        finally:
            process.kill()
            process.wait()


@pytest.fixture
def stage(make_stage: MakeStage) -> ChaosStage:
    """Return a stage that is at rest."""
    return make_stage()
