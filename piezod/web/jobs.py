"""Identification, learning, replays: commands of piezod that run for minutes, one for each stage.

Each runs in a process of its own, as in a shell; the first two drive the stage in a session. A job
goes on when a tab is closed; every tab sees it and can end it. If this server is killed, a process
that drives the stage ends with the next progress that it prints, and the daemon stops the stage.
"""

import asyncio
import json
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from piezod.config.yaml_loader import load_yaml
from piezod.errors import PiezodError
from piezod.messages.documents import Document
from piezod.resource_limits import bound_other
from piezod.web.errors import PageError
from piezod.web.job_commands import MODEL, JobMessage, command_of
from piezod.web.rows import encoded

MOST_BYTES: Final = 6_000_000_000
"""Most address space of a command; compiled kernels and threads reserve more than they use."""
MOST_CPU_S: Final = 4 * 3600
_LONGEST_LINE: Final = 16 * 1024 * 1024
_MOST_TEXT: Final = 20
"""Lines of text that are kept of what the command prints."""
_FOLDER: Final = "piezod-job-"


class Job:
    """One command, from its start until its result is replaced by another one.

    Args:
        wanted: What to do.
        model: The present model of the axis, for a replay.
        upload: The file that the page has sent, for a job that reads it.
        socket: Socket of the stage's daemon.
        changed: Called after each change.

    Attributes:
        figure: The figure of the result, a PNG; None if there is none.
    """

    def __init__(
        self,
        wanted: JobMessage,
        model: Document | None,
        upload: Path | None,
        socket: Path,
        changed: Callable[[], None],
    ) -> None:
        self._changed = changed
        self._document: Document = {
            "kind": wanted.do,
            "axis": wanted.axis,
            "running": True,
            "activity": "starting",
            "share": 0.0,
            "parts": [],
            "result": None,
            "error": "",
        }
        self.figure: bytes | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._ending = False
        self._task = asyncio.get_running_loop().create_task(
            self._run(command_of(wanted, model, upload), None if upload else socket)
        )

    @property
    def running(self) -> bool:
        """Whether the command has not ended."""
        return bool(self._document["running"])

    @property
    def document(self) -> Document:
        """The job as pages see it."""
        return {**self._document, "figure": self.figure is not None}

    def end(self) -> None:
        """Interrupt the command, which then stops the stage."""
        self._ending = True
        if self._process is not None and self._process.returncode is None:
            self._process.send_signal(signal.SIGINT)

    async def wait(self) -> None:
        """Wait for the end of the command."""
        await asyncio.wait((self._task,))

    async def _run(self, command: Callable[[Path], list[str]], socket: Path | None) -> None:
        with TemporaryDirectory(prefix=_FOLDER) as name:
            folder = Path(name)
            try:
                await self._run_in(folder, command(folder), socket)
            except (PiezodError, OSError, ValueError) as error:
                self._document["error"] = str(error)
            finally:
                self._document.update(running=False, activity="")
                self._changed()

    async def _run_in(self, folder: Path, arguments: list[str], socket: Path | None) -> None:
        if socket is not None:
            arguments += ["--socket", str(socket)]
        pipe = asyncio.subprocess.PIPE
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "piezod", *arguments,
            "--json",
            stdin=asyncio.subprocess.DEVNULL, stdout=pipe, stderr=pipe, limit=_LONGEST_LINE,
            env={**os.environ, "PIEZOD_PROGRESS": "json"}, cwd=folder,
            start_new_session=True,  # Ctrl-C reaches this server, which interrupts the command
        )  # fmt: skip
        bound_other(process.pid, MOST_BYTES, MOST_CPU_S)
        if self._ending:
            self.end()
        output = asyncio.create_task(_all_of(process.stdout))
        text = await self._follow(process.stderr)
        out = await output
        if await process.wait():
            self._document["error"] = "ended as requested" if self._ending else "\n".join(text)
            return
        self._document["result"] = json.loads(out)
        model = folder / MODEL
        if model.exists():
            self._document["result"]["model"] = load_yaml(model).data
        for figure in folder.glob("*.png"):
            self.figure = figure.read_bytes()

    async def _follow(self, lines: asyncio.StreamReader | None) -> list[str]:
        """Take over progress until the command ends; return the last lines of other text."""
        text: list[str] = []
        while lines is not None and (line := await lines.readline()):
            try:
                progress = json.loads(line)
            except ValueError:
                text = [*text, line.decode(errors="replace").rstrip()][-_MOST_TEXT:]
                continue
            if "part" in progress:
                self._document["parts"].append(progress["part"])
            else:
                self._document.update(progress)
            self._changed()
        return text


class Jobs:
    """The newest job of each stage.

    Args:
        publish: Sends an event to all tabs.
    """

    def __init__(self, publish: Callable[[str], None]) -> None:
        self._publish = publish
        self._jobs: dict[str, Job] = {}

    def start(
        self, wanted: JobMessage, model: Document | None, upload: Path | None, socket: Path
    ) -> Document:
        """Start a job; return its document. See `Job`.

        Raises:
            PageError: If one of this stage is running.
        """
        stage = wanted.stage
        if (running := self._jobs.get(stage)) and running.running:
            what = f"stage {stage} is busy: {running.document['kind']}"
            raise PageError("busy", what, "wait for its end, or end it")
        job = self._jobs[stage] = Job(wanted, model, upload, socket, lambda: self._tell(stage, job))
        self._tell(stage, job)
        return job.document

    def document(self, stage: str) -> Document:
        """Return the newest job of a stage as `{"job": …}`; null without one."""
        job = self._jobs.get(stage)
        return {"job": job and job.document}

    def end(self, stage: str) -> Document:
        """Interrupt the job of a stage; return as `document` does."""
        if job := self._jobs.get(stage):
            job.end()
        return self.document(stage)

    def figure(self, stage: str) -> bytes | None:
        """Return the figure of the newest job of a stage."""
        job = self._jobs.get(stage)
        return None if job is None else job.figure

    async def aclose(self) -> None:
        """Interrupt all jobs, and wait until they have stopped their stages."""
        for job in self._jobs.values():
            job.end()
            await job.wait()

    def _tell(self, stage: str, job: Job) -> None:
        event: dict[str, Any] = {"event": "job", "stage": stage, "job": job.document}
        self._publish(encoded(event))


async def _all_of(lines: asyncio.StreamReader | None) -> bytes:
    return b"" if lines is None else await lines.read()
