"""A stage as a service on a machine, installed and used with the commands that people use."""

import csv
import io
import json
import subprocess
from typing import Any, Final, NamedTuple

from piezod.units import NS_PER_S
from tests.daemon.waiting import eventually
from tests.system.machine import PIEZOD, Machine

UNIT: Final = "piezod@stage1"
CONFIG: Final = "/etc/piezod/stage1.yaml"
OPERATOR, OUTSIDER = "olga", "otto"
RIG: Final = "/var/lib/rig"
TARGET_UM: Final = 12.5
SAFE_V: Final = 0.0
RAMP_V_PER_S: Final = 100.0


class Write(NamedTuple):
    """A voltage that was written: instant of the rig, writing process, voltage."""

    t_ns: int
    pid: int
    drive_v: float


class InstalledStage:
    """The stage, its rig as another service, and two users, of whom one may move the stage."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        installed = json.loads(machine.root(f"{PIEZOD} install-service --json"))
        for command in installed["next"]:
            # A container has no udev; the other lines are for people to fill in.
            if command.startswith("systemd-") or "daemon-reload" in command:
                machine.root(command)
        machine.root(f"useradd --create-home --groups piezod-view,piezod {OPERATOR}")
        machine.root(f"useradd --create-home {OUTSIDER}")
        self._configure()
        self._host_rig()

    def _configure(self) -> None:
        self.machine.root(f"{PIEZOD} init /etc/piezod")
        text = self.machine.root("cat /etc/piezod/emulated.yaml")
        # A low rate and a long time-out, because the machine may be busy.
        text = text.replace("rate_hz: 200", "rate_hz: 100")
        text = text.replace("ramp_v_per_s: 50", f"ramp_v_per_s: {RAMP_V_PER_S:g}")
        text = text.replace("rig.sock", f"{RIG}/rig.sock, deadline_ms: 500")
        self.configuration = text
        self.machine.write(CONFIG, text)

    def _host_rig(self) -> None:
        """Run the rig as the user of the service, because only that one may use its socket."""
        folders = f"-p StateDirectory=rig -E NUMBA_CACHE_DIR={RIG}"
        rig = f"emulate simulated --socket {RIG}/rig.sock --trace {RIG}/trace.csv"
        self.machine.root(f"systemd-run --unit=rig --uid=piezod {folders} {PIEZOD} {rig}")
        self.machine.wait_until(f"test -S {RIG}/rig.sock")

    def begin(self) -> None:
        """Bring the stage to rest, from any state."""
        self._start()
        eventually(self._at_rest)

    def begin_driven(self) -> None:
        """Start the stage, and move it to a position that needs a voltage."""
        self._start()
        eventually(self._moved, 60.0)
        assert self.writes()[-1].drive_v > 30.0

    def _start(self) -> None:
        self.machine.write(CONFIG, self.configuration)
        self.machine.run(f"systemctl reset-failed {UNIT}")  # also resets the count of starts
        self.machine.root(f"systemctl start {UNIT}")

    def _moved(self) -> bool:
        self.piezod("reset")  # the test before may have left it in FAULT
        for verb in ("arm", f"goto {TARGET_UM} --wait"):
            if self.piezod(verb).returncode:
                eventually(self._at_rest)  # it moves already, or late cycles have stopped it
                return False
        return True

    def _at_rest(self) -> bool:
        state = self.status()["state"]
        if state != "SAFE":
            self.piezod("reset" if state == "FAULT" else "disarm")
        return bool(state == "SAFE")

    def piezod(self, verb: str, user: str = OPERATOR) -> "subprocess.CompletedProcess[str]":
        """Run a `piezod` command as a user."""
        return self.machine.run(f"{PIEZOD} {verb}", user)

    def status(self) -> dict[str, Any]:
        """Return the status that the operator gets."""
        ended = self.piezod("status --json")
        assert ended.returncode == 0, ended.stderr
        document: dict[str, Any] = json.loads(ended.stdout)
        return document

    def shows(self, name: str) -> str:
        """Return a property of the service."""
        return self.machine.root(f"systemctl show --value --property={name} {UNIT}")

    @property
    def supervisor(self) -> str:
        """Process id of the service, within the machine."""
        return self.shows("MainPID")

    @property
    def loop(self) -> str:
        """Process id of its loop, within the machine."""
        return self.machine.root(f"pgrep --parent {self.supervisor} --full loop.process")

    def wait_for_restart(self) -> None:
        """Wait until systemd has restarted it and it is ready."""
        show = "systemctl show --value --property"
        again = f"test $({show}=NRestarts {UNIT}) != 0"
        self.machine.wait_until(f"{again} && systemctl --quiet is-active {UNIT}")

    def writes(self) -> list[Write]:
        """Return every voltage that was written to the rig."""
        rows = csv.DictReader(io.StringIO(self.machine.root(f"cat {RIG}/trace.csv")))
        return [Write(int(row["t_ns"]), int(row["pid"]), float(row["x_v"])) for row in rows]

    def log(self) -> str:
        """Return its journal."""
        return self.machine.root(f"journalctl --no-pager --unit={UNIT}")


def fastest_v_per_s(writes: list[Write]) -> float:
    """Return the fastest change over a tenth of a second or more, in V/s.

    Shorter changes mean nothing, because the instants are those of the rig, and a busy machine
    delivers writes in bursts.
    """
    fastest = 0.0
    for begin, write in enumerate(writes):
        later = next((w for w in writes[begin:] if w.t_ns - write.t_ns >= NS_PER_S / 10), None)
        if later is not None:
            rate = abs(later.drive_v - write.drive_v) / (later.t_ns - write.t_ns) * NS_PER_S
            fastest = max(fastest, rate)
    return fastest
