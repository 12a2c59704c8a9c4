"""A stage that runs in the process of the test."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from subprocess import Popen
from typing import Any, NamedTuple

import httpx

from piezod.daemon.lock import Lock
from piezod.daemon.paths import StagePaths
from piezod.daemon.supervisor.run import run_stage
from piezod.daemon.supervisor.signals import Signals, noted_signals
from piezod.daemon.supervisor.terms import RunOptions
from piezod.telemetry.shared_map import attach
from piezod.telemetry.words import Word
from tests.daemon.daemons import NO_TLS
from tests.daemon.service.raw import HEAD, connected, read_to_end
from tests.daemon.waiting import eventually


class Rig(NamedTuple):
    """A stage that can be run."""

    config: Path  #: Its configuration.
    paths: StagePaths  #: Its files.
    loops: list["Popen[bytes]"]  #: The loop processes that were started.
    #: Code of Python for the loop process, in a list; without any it is a fake loop.
    loop_code: list[str]
    rescues: list[str]  #: What the rescuers were asked to do.
    left: list[str]  #: What they leave: the lines of axes that are not at their safe voltages.

    def run(self, during: Callable[[], None]) -> bool:
        """Run the stage; call a function meanwhile, and end the stage after it."""

        def then_end() -> None:
            try:
                self.up()
                during()
            finally:
                self.end()

        with ThreadPoolExecutor(1) as beside, noted_signals() as signals:
            doing = beside.submit(then_end)
            try:
                return self.start(signals)
            finally:
                doing.result()

    def start(self, signals: Signals | None = None, *, require_device: bool = False) -> bool:
        """Run the stage until it ends by itself, or because of the signals."""
        self.paths.make_folders()
        with Lock(self.paths.lock):
            options = RunOptions(require_device=require_device)
            return run_stage(self.config, options, self.paths, signals or Signals())

    def up(self) -> None:
        """Wait for the first healthy cycle."""
        eventually(lambda: self.paths.api_socket.exists() and self.loops)
        eventually(lambda: attach(self.paths.loop_map).words[Word.HEALTHY_CYCLES])

    def end(self) -> None:
        """Request a shutdown; the stage may end by itself at any moment."""
        head = HEAD % b"shutdown" + b"content-type: application/json\r\nconnection: close\r\n"
        with suppress(OSError), connected(self.paths.api_socket) as connection:
            connection.sendall(head + b"content-length: 2\r\n\r\n{}")
            read_to_end(connection)

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> httpx.Response:
        """Send a request to the HTTP interface."""
        transport = httpx.HTTPTransport(uds=str(self.paths.api_socket), verify=NO_TLS)
        with httpx.Client(transport=transport, base_url="http://stage/v1", timeout=20) as client:
            return client.request(method, path, json=body)
