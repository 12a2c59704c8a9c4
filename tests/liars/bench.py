"""A daemon of the lying amplifier, and a person who watches it."""

import os
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, Self

import httpx

from piezod.daemon.loop.placement import DevicePlace
from piezod.daemon.supervisor.rescuer import MODULE as RESCUER
from tests.daemon.daemons import Daemon, is_alive
from tests.daemon.waiting import eventually
from tests.forked import STARTS_RESCUER, Forked
from tests.liars.config import SAFE_V, TOLERANCE_V, configured
from tests.liars.process import AmplifierProcess, Speaks

POLL_S: Final = 0.06
HOME_WITHIN_S: Final = 60.0
MEASURES_S: Final = 15.0
"""How long `piezod commission` goes on after the lie, unless it ends by itself, in s."""
NEXT: Final = {"READY": "stop", "RUN": "stop", "IDENT": "stop", "HOLD": "stop", "FAULT": "reset"}
"""What a person does in each state to bring a stage home."""
NOT_TOLD: Final = {"D10", "A10", "S5", "S6", "B5", "B7", "P2", "P15"}
"""Faults that this machine, or the way here, may cause: they tell nothing of an output."""


class Bench:
    """The amplifier, a daemon or none, and a person who looks at the status.

    `told` has what the daemon has told since the lie began: ids of faults, states, refusals.
    """

    def __init__(self, folder: Path, model: Path, speaks: Speaks) -> None:
        folder.mkdir(parents=True)
        self.folder, self.amplifier = folder, AmplifierProcess(folder, speaks)
        self.config = configured(folder, self.amplifier.port, model, speaks)
        self._daemon: Daemon | None = None
        self.told = set[str]()
        self.logs = ""
        self._answers = list[str]()
        self._beside: Forked | None = None
        self._beside_what = ""

    @property
    def daemon(self) -> Daemon:
        """The daemon that was started last; it may have ended."""
        assert self._daemon is not None
        return self._daemon

    @property
    def runs(self) -> bool:
        """Whether the daemon runs."""
        return self._daemon is not None and self._daemon.process.poll() is None

    def start(self) -> None:
        """Start the daemon, if it does not run."""
        if self._daemon is None:
            self._daemon = Daemon(self.config, **{STARTS_RESCUER: ""})
        elif not self.runs:
            self._daemon.start()

    # ------------------------------------------------------------------ requests

    def ask(self, verb: str, **fields: Any) -> bool:
        """Send a request; return whether it was accepted. A refusal is remembered."""
        try:
            response = self.daemon.ask("POST", verb, fields)
        except httpx.TransportError as error:
            self._answers.append(f"{verb}: {error}")
            return False
        if response.status_code != 200:
            self.told.add(f"{verb} refused")
            self._answers.append(f"{verb}: {response.text}")
        return response.status_code == 200

    def look(self) -> dict[str, Any]:
        """Return the status, and remember what it tells."""
        status = self.daemon.status() if self.runs else {}
        for fault in status.get("faults", ()):
            if fault["id"][0] != "L" and fault["id"] not in NOT_TOLD:
                self.told.add(fault["id"])
        if (state := status.get("state", "")) in {"FAULT", "BLIND"}:
            self.told.add(state)
        return status

    def until(self, arrived: Callable[[dict[str, Any]], object], within_s: float = 30.0) -> bool:
        """Look until a status fits; return whether it did in time."""
        end_s = time.monotonic() + within_s
        while time.monotonic() < end_s:
            if arrived(self.look()):
                return True
            time.sleep(POLL_S)
        return False

    def rest(self, duration_s: float) -> None:
        """Look for a while."""
        self.until(lambda _: False, duration_s)

    def driven(self, above_v: float) -> None:
        """Wait until the output is above a voltage."""
        eventually(lambda: self.amplifier.output_v() > above_v, 12.0)

    def traced(self, kind: str) -> bool:
        """Return whether the trace has a line of a kind since the lie before this one ended."""
        rows = self.amplifier.rows()
        ends = (i for i in reversed(range(len(rows))) if rows[i].text == "honest")
        return any(row.kind == kind for row in rows[next(ends, 0) :])

    # ------------------------------------------------------------------ before and after

    def at_rest(self) -> None:
        """Bring an honest amplifier and its daemon to the beginning: SAFE, zeroed, no fault."""
        self.start()
        assert self.until(lambda status: status.get("state") in {"SAFE", "FAULT"}, 90.0)
        assert abs(self.amplifier.output_v() - SAFE_V) <= TOLERANCE_V, self.state()
        eventually(lambda: self.ask("reset", engineer=True), 30.0)
        eventually(lambda: self.ask("zero"), 30.0)
        self.rest(0.5)

    def armed(self) -> None:
        """Arm; repeat it on a machine that is busy."""
        eventually(lambda: self.ask("arm") or self.look().get("state") == "READY", 30.0)

    def home(self) -> str:
        """Bring the stage home as a person does; return how, and where it ended."""
        steps = list[str]()
        if self._beside is not None:
            steps.append(f"{self._beside_what} ended with {self._end_beside()}")
            self._beside = None
        if not self.runs:
            self._safe(steps)
            self.start()
        end_s = time.monotonic() + HOME_WITHIN_S
        while time.monotonic() < end_s:
            state, output_v = self.look().get("state", ""), self.amplifier.output_v()
            if state == "SAFE" and abs(output_v - SAFE_V) <= TOLERANCE_V:
                return f"SAFE at {output_v:.2f} V{_by(steps)}"
            if step := NEXT.get(state, "arm" if state == "SAFE" else ""):
                self._do(step, steps)
            time.sleep(0.2)
        return f"NOT HOME: {self.state()}{_by(steps)}"

    def _end_beside(self) -> int:
        """Wait for the end of what runs beside; return its exit code. Ctrl-C ends a measurement."""
        assert self._beside is not None
        if self._beside_what == "commission":
            with suppress(subprocess.TimeoutExpired):
                return self._beside.wait(MEASURES_S)
            self._beside.interrupt()
        return self._beside.wait(150.0)

    def _safe(self, steps: list[str]) -> None:
        """Ramp down without a daemon, if the stage is not at its safe voltage."""
        for options in ((), ("--confirm-output",)):
            if abs(self.amplifier.output_v() - SAFE_V) > TOLERANCE_V:
                done = self.daemon.command("safe", str(self.config), *options)
                steps.append(f"{' '.join(('safe', *options))} ended with {done.returncode}")
                self._answers.append(done.stdout + done.stderr)

    def reckons_with_ms(self) -> float:
        """Return the round trip that a thread of the loop reckons with, in ms; 0 without one."""
        (device,) = self.daemon.status()["devices"]
        in_thread = device["placement"] == DevicePlace.WORKER
        return float(device["round_trip_us"]["p99"]) / 1e3 if in_thread else 0.0

    def state(self) -> str:
        """Return state and output, for people."""
        return f"{self.daemon.status().get('state')} at {self.amplifier.output_v():.2f} V"

    def _do(self, step: str, steps: list[str]) -> None:
        fields = {"engineer": True} if step == "reset" else {}
        if self.daemon.ask("POST", step, fields).status_code == 200:
            steps.append(step)
        elif step == "arm" and steps.count("arm refused") > 8:
            if self.daemon.ask("POST", step, {"confirm_output": True}).status_code == 200:
                steps.append("arm --confirm-output")
        else:
            steps.append(f"{step} refused")

    # ------------------------------------------------------------------ processes

    def kill_loop(self) -> None:
        """Kill the loop; its supervisor lives, and ends."""
        os.kill(self.daemon.loop_pid, signal.SIGKILL)

    def kill_all(self) -> None:
        """Kill supervisor, loop and rescuer."""
        daemon, pid = self.daemon, self.daemon.loop_pid
        daemon.process.kill()
        for each in Path("/proc").glob("[0-9]*/cmdline"):
            with suppress(OSError):
                command = each.read_text(encoding="utf-8", errors="replace")
                if RESCUER in command and str(daemon.folder) in command:
                    os.kill(int(each.parent.name), signal.SIGKILL)
        if pid:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        daemon.process.wait(60)
        eventually(lambda: not (pid and is_alive(pid)))

    def kill_beside(self) -> None:
        """Kill what runs beside, and the process that would bring its axis back."""
        assert self._beside is not None
        children = Path(f"/proc/{self._beside.pid}/task/{self._beside.pid}/children").read_text()
        for pid in (*map(int, children.split()), self._beside.pid):
            os.kill(pid, signal.SIGKILL)
        self._beside.wait(60)
        self._beside = None

    def beside(self, *arguments: str) -> None:
        """Run `piezod` beside; `home` waits for its end."""
        log = self.folder / f"{arguments[0]}.log"
        with log.open("ab") as out, Path(os.devnull).open("rb") as nothing:
            streams = (nothing.fileno(), out.fileno(), out.fileno())
            self._beside = Forked(arguments, streams, self.daemon.environ, self.folder)
        self._beside_what = arguments[0]

    @property
    def drives(self) -> bool:
        """Whether the daemon drives the stage, as far as anybody knows."""
        return self.runs and self._beside is None

    def daemon_ends(self) -> None:
        """Let `home` wait for the end of the daemon, whose loop was killed."""
        self._beside, self._beside_what = self.daemon.process, "run"

    def interrupt(self) -> None:
        """Send Ctrl-C to what runs beside."""
        assert self._beside is not None
        self._beside.interrupt()

    def shut_down(self) -> None:
        """End the daemon in order."""
        if self.runs:
            self.ask("shutdown")
            self.daemon.process.wait(60)

    def take_log(self) -> str:
        """Return what was logged and answered since the last call."""
        logs = [self.folder / f"{what}.log" for what in ("safe", "commission")]
        text = (self._daemon.text if self._daemon else "") + "".join(
            each.read_text() for each in logs if each.exists()
        )
        seen = set(self.logs.splitlines())
        new = "\n".join(line for line in text.splitlines() if line not in seen)
        self.logs = text
        answers, self._answers = self._answers, []
        return "\n".join((new, *answers))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *about: object) -> None:
        if self._beside is not None:
            self._beside.kill()
        if self._daemon is not None:
            with suppress(Exception):  # whatever a case has left of it
                self.shut_down()
            self.kill_all()
            self._daemon.__exit__(*about)
        self.amplifier.end()


def _by(steps: list[str]) -> str:
    """Return the steps of a person, each of several in a row once."""
    once = [step for i, step in enumerate(steps) if i == 0 or steps[i - 1] != step]
    return f" by {', '.join(once)}" if once else ""
