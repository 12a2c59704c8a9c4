"""Runs `piezod` for the shells of documented commands, in processes that start at once."""

import json
import os
import socket
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, TypeAlias

from tests.daemon.waiting import eventually
from tests.forked import Forked

Streams: TypeAlias = tuple[int, int, int]
READY: Final = {"run": "ready ", "emulate": "serving ", "web": "token", "gcs": "GCS 2"}
"""Commands that run until somebody ends them, and a text that they print when they are ready.

The server leaves them running, as in a terminal of their own, and the shell goes on. A second
daemon ends the first one, as a reader does by Ctrl-C.
"""
ENDLESS: Final = "watch"
"""It prints until Ctrl-C: the server interrupts it after its first output."""
READY_WITHIN_S: Final = 90.0
LONGEST_S: Final = 1200.0
"""Longest time of a command, in s: a generous one, for a busy machine."""
SLOWER: Final = {"rate_hz: 200\n": "rate_hz: 20\n", "gain_per_s: 50,": "gain_per_s: 5,"}
"""Changes to the shipped configuration for a rate that a busy machine keeps."""


class CommandServer:
    """Runs commands until it is closed; nothing that it started outlives it.

    Args:
        folder: A folder with a short path, for the socket.
        environ: The environment of the commands.
        slower: Texts in the configuration of a daemon, and what replaces them.
        together: Whether daemons run beside each other.
    """

    def __init__(
        self,
        folder: Path,
        environ: Mapping[str, str],
        slower: Mapping[str, str],
        *,
        together: bool = False,
    ) -> None:
        self.path = folder / "commands"
        self._environ, self._slower, self._logs = environ, slower, folder
        self._together = together
        self._left: list[tuple[str, Forked]] = []
        self._codes: list[int] = []
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(str(self.path))
        self._listener.listen()
        self._workers = ThreadPoolExecutor()
        self._workers.submit(self._serve)

    @property
    def log(self) -> str:
        """What the commands that were left running have printed."""
        return "\n".join(path.read_text("utf-8") for path in sorted(self._logs.glob("*.log")))

    def close(self) -> None:
        """End what runs, in order; raise AssertionError if a daemon does not end in order."""
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        for verb in READY:
            self._end(verb)
        self._workers.shutdown()
        assert not any(self._codes), self.log

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            self._workers.submit(self._answer, connection)

    def _answer(self, connection: socket.socket) -> None:
        with connection:
            message, streams, *_ = socket.recv_fds(connection, 65536, 3)
            stdin, stdout, stderr = streams
            try:
                code = self._run(json.loads(message), (stdin, stdout, stderr))
            except BaseException as error:  # noqa: BLE001 - the shell shall show it
                os.write(stderr, f"{type(error).__name__}: {error}\n".encode())
                code = 1
            for stream in streams:
                os.close(stream)
            connection.sendall(str(code).encode())

    def _run(self, request: Mapping[str, Any], streams: Streams) -> int:
        arguments, folder = request["arguments"], Path(request["folder"])
        verb = arguments[0]
        if verb == "run":
            self._slow_down(folder / arguments[-1])
        if verb in READY:
            return self._leave_running(arguments, folder)
        environ = {**self._environ, **request["environ"]}
        if verb == ENDLESS:
            return self._interrupt(arguments, folder, streams, environ)
        return Forked(arguments, streams, environ, folder).wait(LONGEST_S)

    def _slow_down(self, config: Path) -> None:
        text = config.read_text(encoding="utf-8")
        for shipped, slower in self._slower.items():
            text = text.replace(shipped, slower)
        config.write_text(text, encoding="utf-8")

    def _leave_running(self, arguments: list[str], folder: Path) -> int:
        self._end("run" if arguments[0] == "run" and not self._together else "")
        log = self._logs / f"{len(self._left)}.log"
        with log.open("wb") as out, Path(os.devnull).open("rb") as nothing:
            outputs = (nothing.fileno(), out.fileno(), out.fileno())
            process = Forked(arguments, outputs, self._environ, folder)
        self._left.append((arguments[0], process))

        def ready() -> bool:
            assert process.poll() is None, log.read_text("utf-8")
            return READY[arguments[0]] in log.read_text("utf-8")

        eventually(ready, READY_WITHIN_S)
        return 0

    def _end(self, verb: str) -> None:
        """End the commands of a verb, and note their exit codes."""
        for each, process in self._left:
            if each == verb and process.poll() is None:
                process.terminate()
                self._codes.append(process.wait(60.0))

    def _interrupt(
        self, arguments: list[str], folder: Path, streams: Streams, environ: Mapping[str, str]
    ) -> int:
        read_fd, write_fd = os.pipe()
        with os.fdopen(read_fd, "rb") as output:
            process = Forked(arguments, (streams[0], write_fd, streams[2]), environ, folder)
            os.close(write_fd)
            os.write(streams[1], output.readline())
            process.interrupt()
            os.write(streams[1], output.read())
        code = process.wait(20.0)
        return 0 if code == 130 else code


@contextmanager
def serving(
    folder: Path, environ: Mapping[str, str], slower: Mapping[str, str], *, together: bool = False
) -> Iterator[CommandServer]:
    """Serve commands while the block runs; arguments as in `CommandServer`."""
    server = CommandServer(folder, environ, slower, together=together)
    try:
        yield server
    finally:
        server.close()
