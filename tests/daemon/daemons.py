"""Daemons as processes, for tests."""

import json
import os
import re
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

import httpx

from piezod.daemon.paths import StagePaths, stage_paths
from piezod.telemetry.shared_map import MapError, attach
from piezod.telemetry.words import Word
from tests.daemon.waiting import eventually
from tests.forked import Forked, run

# A unix socket needs no TLS; httpx's own context takes 25 ms to make, too long for polling.
NO_TLS = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
REPOSITORY = Path(__file__).parents[2]
EXAMPLE = "/dev/serial/by-id/EXAMPLE"
"""The port in the shipped configuration of a device."""
SHIPPED = REPOSITORY / "config" / "simulated.yaml"
ASK_EACH_S = 0.05
NEXT_VERB = {"SAFE": "arm", "FAULT": "reset", "HOLD": "stop"}
UP_WITHIN_S = 90.0
"""On a fresh clone a loop compiles its kernels before its first cycle."""


class Daemon:
    """`piezod run` with its own folders; no process outlives the object."""

    def __init__(self, config: Path, *arguments: str, **environ: str) -> None:
        # The path of a socket must be short, and pytest's folders have long ones.
        self.folder = Path(tempfile.mkdtemp(prefix="pz-"))
        self.config = config
        self.environ = {
            **os.environ,
            "XDG_RUNTIME_DIR": str(self.folder),
            "XDG_STATE_HOME": str(self.folder),
            **environ,
        }
        self.log = self.folder / "log"
        self.paths: StagePaths = stage_paths(config, self.environ)
        self._arguments = arguments
        self._ask_at_s = 0.0
        self.process = self.another()

    def start(self) -> None:
        """Start the daemon again after its end."""
        self.process = self.another()

    def another(self) -> Forked:
        """Start a further `piezod run` with the same files; the caller waits for its end."""
        arguments = ("run", *self._arguments, str(self.config))
        with self.log.open("ab") as log, Path(os.devnull).open("rb") as nothing:
            streams = (nothing.fileno(), log.fileno(), log.fileno())
            return Forked(arguments, streams, self.environ)

    def command(self, *arguments: str) -> "subprocess.CompletedProcess[str]":
        """Run another `piezod` command with the same folders."""
        return run(arguments, self.environ)

    @property
    def text(self) -> str:
        """Its output, without colours."""
        return re.sub("\x1b\\[[0-9;]*m", "", self.log.read_text(encoding="utf-8"))

    @property
    def loop_pid(self) -> int:
        """Process id of its loop; 0 without one."""
        try:
            return attach(self.paths.loop_map).words[Word.LOOP_PID]
        except (OSError, MapError):
            return 0

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> httpx.Response:
        """Send a request to its HTTP interface."""
        # Rarely enough for the rate limit of the daemon, often enough for a short test.
        time.sleep(max(0.0, self._ask_at_s - time.monotonic()))
        self._ask_at_s = time.monotonic() + ASK_EACH_S
        transport = httpx.HTTPTransport(uds=str(self.paths.api_socket), verify=NO_TLS)
        with httpx.Client(transport=transport, base_url="http://stage/v1", timeout=20) as client:
            return client.request(method, path, json=body)

    def do(self, verb: str, **fields: Any) -> dict[str, Any]:
        """Send a request that must be accepted; return the answer."""
        response = self.ask("POST", verb, fields)
        assert response.status_code == 200, response.text
        answer: dict[str, Any] = response.json()
        return answer

    def status(self) -> dict[str, Any]:
        """Return its status; empty if it does not answer."""
        # Try the socket first: httpx does not close one that cannot be connected.
        with socket.socket(socket.AF_UNIX) as probe:
            if probe.connect_ex(str(self.paths.api_socket)):
                return {}
        try:
            status: dict[str, Any] = self.ask("GET", "status").json()
        except httpx.TransportError:
            return {}
        return status

    def faults(self) -> set[str]:
        """Return the ids of the faults that are present or latched."""
        return {fault["id"] for fault in self.status()["faults"]}

    def zero_um(self) -> float:
        """Return the sensor zero of axis x, in µm; 0 while it is unknown."""
        axes = self.ask("GET", "params").json().get("axes")
        return float(axes["x"]["zero_um"]) if axes else 0.0

    def until(self, state: str, within_s: float = 20.0) -> dict[str, Any]:
        """Wait for a state; return the status then."""

        def there() -> dict[str, Any]:
            assert self.process.poll() is None, self.text
            status = self.status()
            return status if status.get("state") == state and self.loop_pid else {}

        try:
            return eventually(there, within_s)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{json.dumps(self.status())}\n{self.text}") from error

    def moving(
        self,
        verb: str,
        fields: dict[str, Any],
        arrived: Callable[[dict[str, Any]], object] = bool,
        within_s: float = 60.0,
    ) -> dict[str, Any]:
        """Let it move, and repeat the commands if late cycles stop it; return the status in RUN.

        It has arrived when `arrived` says so of a status in RUN.
        """
        answers: list[str] = []

        def moves() -> dict[str, Any]:
            status = self.status()
            state = status.get("state", "")
            if state == "RUN" and arrived(status):
                return status
            step = verb if state == "READY" else NEXT_VERB.get(state, "")
            if step == "arm" and any(fault["latched"] for fault in status["faults"]):
                step = "reset"
            if step:
                answers.append(self.ask("POST", step, fields if step == verb else {}).text)
            return {}

        try:
            return eventually(moves, within_s)
        except AssertionError as error:
            raise AssertionError("\n".join([*answers[-3:], self.text])) from error

    def driven(self, position_um: float, above_v: float) -> None:
        """Let axis x move to a position, until its drive voltage is above a value."""
        self.moving(
            "goto",
            {"position_um": position_um},
            lambda status: status["axes"]["x"]["drive_v"] > above_v,
        )

    def up(self) -> Self:
        """Wait until it has started."""
        self.until("SAFE", UP_WITHIN_S)
        return self

    def signal(self, number: int) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def exit_code(self, within_s: float = 90.0) -> int:
        """Wait for its end; return the exit code."""
        return self.process.wait(within_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End its processes and remove its files."""
        pids = {self.loop_pid} - {0}
        if self.process.poll() is None:
            pids |= children(self.process.pid)
            self.process.kill()
            self.process.wait()
        for pid in filter(is_alive, pids):
            os.kill(pid, signal.SIGKILL)
        eventually(lambda: not any(map(is_alive, pids)))
        eventually(self._removed)  # a rescuer whose daemon was killed may still take its lock

    def _removed(self) -> bool:
        shutil.rmtree(self.folder, ignore_errors=True)
        return not self.folder.exists()


class StartedDaemon(Daemon):
    """A daemon that the interpreter starts, as on a bench; it starts its processes like that."""

    def another(self) -> Any:
        """Start `piezod run`."""
        command = (sys.executable, "-m", "piezod", "run", str(self.config))
        with self.log.open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log, env=self.environ)


def configuration(folder: Path, **replaced: str) -> Path:
    """Write the configuration of a simulated stage; return its path.

    It is the shipped one, with a rate that a busy machine can keep.
    `replaced` has new values of lines, by their key.
    """
    text = SHIPPED.read_text(encoding="utf-8")
    text = text.replace("models/", f"{SHIPPED.parent}/models/")
    for key, value in {"rate_hz": "20", **replaced}.items():
        text, count = re.subn(rf"^( *{key}:).*$", rf"\1 {value}", text, flags=re.MULTILINE)
        assert count == 1, key
    path = folder / "rig.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def device_configuration(folder: Path, name: str, replaced: Mapping[str, str]) -> Path:
    """Write the shipped configuration of a device with parts of its text replaced."""
    text = (REPOSITORY / "config" / "devices" / f"{name}.yaml").read_text(encoding="utf-8")
    text = text.replace("../models/", f"{REPOSITORY}/config/models/")
    for before, after in replaced.items():
        assert before in text, before
        text = text.replace(before, after)
    path = folder / "stage.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def latched(status: dict[str, Any]) -> list[str]:
    """Return the ids of latched faults, except those of the loop, which a busy machine causes."""
    return [each["id"] for each in status["faults"] if each["latched"] and each["id"][0] != "L"]


def children(pid: int) -> set[int]:
    """Return the processes that a process has started and not waited for."""
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii")
    return set(map(int, text.split()))


def is_alive(pid: int) -> bool:
    """Return whether a process is alive; a zombie is not."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"
