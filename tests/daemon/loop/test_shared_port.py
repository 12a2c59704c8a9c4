"""Another program takes the port of a device: of one that is lost, or before the start."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.daemon.conftest import StartDaemon
from tests.daemon.loop.test_pulled_cable import configured, high_up
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated

HOLD = """
import fcntl, os, sys, time
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
while True:
    try:
        fcntl.flock(port, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        time.sleep(0.001)
    else:
        break
print("held", flush=True)
sys.stdin.read()
"""
"""A program that takes the port as soon as nobody has it, and keeps it until its input ends."""


@contextmanager
def held(port: str) -> Iterator[int]:
    """Let another program hold a port while the block runs; yield its process id."""
    command = (sys.executable, "-c", HOLD, port)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process.pid


@pytest.mark.fault("B14")
def test_a_program_that_takes_the_port_of_a_lost_device_is_named(
    start: StartDaemon, tmp_path: Path
) -> None:
    """The stage is BLIND with B14 while the program has the port, and is opened again after it."""
    with high_up(start, tmp_path) as (daemon, far):
        far.faults("lost")
        daemon.until("BLIND")
        eventually(lambda: "B1" in daemon.faults())
        before = daemon.faults()
        with held(far.where[0]) as pid:
            far.faults()
            eventually(lambda: "B14" in daemon.faults())
            eventually(lambda: f"process {pid})" in daemon.text)
            state, log = daemon.status()["state"], daemon.text
        daemon.until("FAULT")
        eventually(lambda: daemon.ask("POST", "reset", {}).status_code == 200)
        daemon.until("SAFE")

        assert "B14" not in before
        assert state == "BLIND"
        assert f"controller: {far.where[0]} is held by another program (python" in log
        assert "B14" not in daemon.faults()


@pytest.mark.fault("B14")
def test_a_stage_whose_port_is_held_at_the_start_waits_for_it(
    start: StartDaemon, tmp_path: Path
) -> None:
    """It is BLIND, the log names the program, and it starts when the port is free."""
    with emulated("pi-e816") as far:
        path = configured(tmp_path, far.where[0])
        with held(far.where[0]) as pid:
            daemon = start(path)
            daemon.until("BLIND", 90.0)
            eventually(lambda: f"process {pid})" in daemon.text)
            refused = daemon.ask("POST", "arm", {})
        daemon.until("SAFE")

        assert refused.status_code == 409
        assert "is held by another program" in refused.text
        assert "fault=B14" in daemon.text


@pytest.mark.fault("B14")
def test_a_held_port_may_be_an_error_at_the_start(start: StartDaemon, tmp_path: Path) -> None:
    """With --require-device the daemon ends with code 69, and has sent nothing."""
    trace = tmp_path / "trace.csv"
    with emulated("pi-e816", arguments=("--trace", str(trace))) as far:
        with held(far.where[0]):
            daemon = start(configured(tmp_path, far.where[0]), "--require-device")

            assert daemon.exit_code(90) == 69
        assert "is held by another program" in daemon.text
        assert len(trace.read_text(encoding="ascii").splitlines()) <= 1
