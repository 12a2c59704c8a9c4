"""The service of a stage: its start, its rights, its failures."""

import json
import os
import signal
from pathlib import Path
from typing import Final

from piezod.errors import ClientError
from tests.vm.guest.shell import PIEZOD, CheckError, attempt, need, run, shows, wait_until
from tests.vm.guest.stage import Stage

RIG: Final = Path("/var/lib/rig")
TARGET_UM: Final = 12.5
STAGE: Final = Stage(
    "stage1",
    "emulated.yaml",
    (
        # A low rate and long time-outs: an emulated processor is some twenty times slower.
        ("rate_hz: 1000", "rate_hz: 10"),
        ("ramp_v_per_s: 50", "ramp_v_per_s: 100"),
        (r"rig\.sock", f"{RIG}/rig.sock, deadline_ms: 1000"),
    ),
)


def unit_starts() -> str:
    """Start the rig and the service, at the same time: a service waits for its devices."""
    rig = f"{PIEZOD} emulate simulated --socket {RIG}/rig.sock --trace {RIG}/trace.csv"
    folders = "-p StateDirectory=rig -p CacheDirectory=piezod -E NUMBA_CACHE_DIR=/var/cache/piezod"
    run(f"systemd-run --unit=rig --uid=piezod {folders} {rig}")
    STAGE.configure()
    STAGE.start()
    STAGE.wait_for("SAFE")
    need(shows(STAGE.unit, "StatusText"), "the service has sent no status to systemd")
    return shows(STAGE.unit, "StatusText")


def operator_moves() -> str:
    """Arm, and go to a position."""
    status = STAGE.move(TARGET_UM)
    axis = status.axes["x"]
    need(abs(axis.error_um or 99.0) < 0.5, f"the error is {axis.error_um} µm")
    return f"at {axis.position_um:.2f} µm with {axis.drive_v:.1f} V"


def loop_is_real_time() -> str:
    """The loop has SCHED_FIFO and locked memory; the supervisor is an ordinary process."""
    loop, supervisor = STAGE.loop, STAGE.supervisor
    policy = os.sched_getscheduler(loop) & ~os.SCHED_RESET_ON_FORK
    need(policy == os.SCHED_FIFO, f"the loop has the policy {policy}, not SCHED_FIFO")
    need(os.sched_getscheduler(supervisor) == os.SCHED_OTHER, "the supervisor is not SCHED_OTHER")
    locked_mb = memory_mb(loop, "VmLck")
    need(locked_mb > 50, f"only {locked_mb:.0f} MB of the loop are locked")
    priority = os.sched_getparam(loop).sched_priority
    return f"SCHED_FIFO {priority}, {locked_mb:.0f} MB locked"


def clock_is_set() -> str:
    """Set the clock an hour forward, and back: the log has L4, and the loop runs on."""
    loop = STAGE.loop
    run("date --set='1 hour'")
    try:
        wait_until(lambda: '"L4"' in STAGE.log(), "the log has L4")
    finally:
        run("date --set='1 hour ago'")
    wait_until(lambda: "L4" not in STAGE.faults(), "L4 has ended")
    STAGE.runs_on(loop, STAGE.status())
    return "L4 in the log, then RUN in the same loop"


def memory_mb(pid: int, name: str) -> float:
    """Return a size of a process from /proc, in MB."""
    for line in Path(f"/proc/{pid}/status").read_text("ascii").splitlines():
        if line.startswith(f"{name}:"):
            return float(line.split()[1]) / 1024
    raise CheckError(f"process {pid} has no {name}")


def journal_has_fields() -> str:
    """Each line of the supervisor in the journal is one JSON document, with a priority."""
    whose = f"--unit={STAGE.unit} _PID={STAGE.supervisor}"
    lines = run(f"journalctl --boot --output=json {whose}").splitlines()
    entries = [json.loads(line) for line in lines]
    messages = [json.loads(entry["MESSAGE"]) for entry in entries]
    need(messages, "the journal has no line of the supervisor")
    priorities = {
        (each["level"], entry["PRIORITY"]) for each, entry in zip(messages, entries, strict=True)
    }
    need(priorities <= {("info", "6"), ("warning", "4"), ("error", "3")}, f"{priorities}")
    return f"{len(messages)} lines: {', '.join(dict.fromkeys(each['event'] for each in messages))}"


def last_writes() -> list[float]:
    """Return the last voltages that were written to the rig."""
    rows = (RIG / "trace.csv").read_text("ascii").splitlines()[1:]
    return [float(row.split(",")[-1]) for row in rows[-3:]]


def watchdog_restarts() -> str:
    """A stopped supervisor is ended by systemd's watchdog; the next one needs a person."""
    return _restarted(signal.SIGSTOP, "watchdog")


def kill_restarts() -> str:
    """The same after SIGKILL."""
    return _restarted(signal.SIGKILL, "signal")


def _restarted(number: signal.Signals, result: str) -> str:
    """Send the supervisor a signal, and wait until the service has started again.

    Checks the voltage when the next process begins, the cause that systemd gives, and the state,
    which needs a person. Then brings the stage back.
    """
    before = STAGE.supervisor
    os.kill(before, number)
    others = "0", str(before)
    wait_until(lambda: shows(STAGE.unit, "MainPID") not in others, "another process", 180.0)
    drive_v = last_writes()[-1]
    wait_until(lambda: shows(STAGE.unit, "ActiveState") == "active", "the service is ready", 300.0)
    need(drive_v == 0.0, f"the output is {drive_v} V when the next process begins")
    need(f"Failed with result '{result}'" in STAGE.log(), f"the journal has no result {result}")
    STAGE.wait_for("FAULT")
    need("P2" in STAGE.faults(), f"the faults are {STAGE.faults()}, without P2")
    with STAGE.client() as client:
        try:
            client.arm()
        except ClientError as refusal:
            said = str(refusal)
        else:
            raise CheckError("the stage could be armed without a reset")
    STAGE.reset()
    attempt(f"systemctl reset-failed {STAGE.unit}")  # also resets the count of starts
    STAGE.move(TARGET_UM)
    return f"0 V, FAULT with P2; `arm` is refused: {said}"


def stop_ends_at_rest() -> str:
    """`systemctl stop` ramps to 0 V and leaves no failure."""
    STAGE.stop()
    result = shows(STAGE.unit, "Result"), shows(STAGE.unit, "ExecMainStatus")
    need(result == ("success", "0"), f"the result is {result}")
    need(last_writes()[-1] == 0.0, f"the output is {last_writes()[-1]} V")
    return "0 V, exit code 0"
