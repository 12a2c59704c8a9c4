"""The IOC as a process, and clients by others as processes."""

import json
import os
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, Self

from tests.daemon.waiting import eventually

ROOT: Final = Path(__file__).parents[2]
PYTHON: Final = ROOT / "build" / "epics" / "bin" / "python"
"""Interpreter of the environment that `make epics` sets up."""
ENDS_WITHIN_S: Final = 30.0


def free_ports(count: int) -> list[int]:
    """Return ports that nobody uses, for TCP and UDP."""
    with_sockets = [socket.socket() for _ in range(count)]
    try:
        for each in with_sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in with_sockets]
    finally:
        for each in with_sockets:
            each.close()


def epics_environment() -> dict[str, str]:
    """Return variables for servers and clients that are to meet on this computer only."""
    ca, pva, search = free_ports(3)
    return {
        "EPICS_CA_ADDR_LIST": "127.0.0.1",
        "EPICS_CA_AUTO_ADDR_LIST": "NO",
        "EPICS_CA_SERVER_PORT": str(ca),
        "EPICS_CA_REPEATER_PORT": str(free_ports(1)[0]),
        "EPICS_PVA_ADDR_LIST": "127.0.0.1",
        "EPICS_PVA_AUTO_ADDR_LIST": "NO",
        "EPICS_PVA_SERVER_PORT": str(pva),
        "EPICS_PVA_BROADCAST_PORT": str(search),
        "EPICS_PVAS_SERVER_PORT": str(pva),
        "EPICS_PVAS_BROADCAST_PORT": str(search),
    }


class Ioc:
    """`piezod ioc` in the environment with softioc.

    Args:
        runtime: Folder with the sockets of the daemons.
        arguments: Options of `piezod ioc`.

    Attributes:
        environ: Environment of its clients.
        announced: The prefixes of its stages.
    """

    def __init__(self, runtime: Path, *arguments: str) -> None:
        self.environ = {**os.environ, **epics_environment(), "XDG_RUNTIME_DIR": str(runtime)}
        command = [str(PYTHON), "-m", "piezod", "ioc", *arguments]
        self.process = subprocess.Popen(
            command, cwd=ROOT, env=self.environ, text=True, stdout=subprocess.PIPE
        )
        self.announced: list[str] = []

    def up(self, stages: int = 1) -> Self:
        """Wait until it serves its stages; end it if it does not."""
        assert self.process.stdout is not None
        try:
            while len(self.announced) < stages:
                line = self.process.stdout.readline()
                assert line, "the IOC has ended, see its errors above"
                if line.startswith("EPICS: "):
                    self.announced.append(line.split()[1].removesuffix("STATE"))
        except BaseException:
            self.kill()
            raise
        return self

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()

    def end(self) -> int:
        """End it in order, if it lives; return the exit code."""
        self.process.terminate()
        try:
            return self.process.wait(ENDS_WITHIN_S)
        finally:
            with suppress(ProcessLookupError):
                self.process.kill()
            assert self.process.stdout is not None
            self.process.stdout.close()


class Peer:
    """A client by others.

    Args:
        library: Name of its library.
        process: Its process, which takes requests.
    """

    def __init__(self, library: str, process: "subprocess.Popen[str]") -> None:
        self.library, self._process = library, process

    def get(self, name: str) -> dict[str, Any]:
        """Return value, severity, unit, digits and limits of a record."""
        answer: dict[str, Any] = self._ask("get", name)
        return answer

    def value(self, name: str) -> Any:
        """Return the value of a record; of an array of characters, the text."""
        value = self.get(name)["value"]
        if isinstance(value, list) and all(isinstance(each, int) for each in value):
            return bytes(value).rstrip(b"\0").decode()
        return value

    def put(self, name: str, value: Any) -> str:
        """Write with completion; return why it failed, empty if it did not."""
        answer: str = self._ask("put", name, value)
        return answer

    def until_taken(self, name: str, value: Any = 1) -> None:
        """Write with completion until the daemon does not refuse it."""
        eventually(lambda: self.put(name, value) == "")

    def send(self, name: str, value: Any) -> str:
        """Write without completion; return why it failed, empty if it did not."""
        answer: str = self._ask("send", name, value)
        return answer

    def watch(self, name: str) -> None:
        """Monitor a record."""
        self._ask("watch", name)

    def seen(self, name: str) -> list[dict[str, Any]]:
        """Return what the monitor of a record has received."""
        answer: list[dict[str, Any]] = self._ask("seen", name)
        return answer

    def _ask(self, do: str, name: str, value: Any = None) -> Any:
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(json.dumps((do, name, value)) + "\n")
        process.stdin.flush()
        line = process.stdout.readline()
        assert line, "the client has ended, see its errors above"
        return json.loads(line)


@contextmanager
def peer(library: str, environ: Mapping[str, str]) -> Iterator[Peer]:
    """Run a client of `clients/` while the block runs."""
    pipe = subprocess.PIPE
    command = [str(PYTHON), "-m", f"tests.epics.clients.{library}_client"]
    with subprocess.Popen(
        command, cwd=ROOT, env=environ, stdin=pipe, stdout=pipe, text=True
    ) as process:
        try:
            yield Peer(library, process)
        finally:
            process.kill()


def run_client(library: str, environ: Mapping[str, str], *arguments: str) -> Any:
    """Run a program of `clients/` to its end; return what it prints, as JSON."""
    command = [str(PYTHON), "-m", f"tests.epics.clients.{library}_client", *arguments]
    done = subprocess.run(
        command, cwd=ROOT, env=environ, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])
