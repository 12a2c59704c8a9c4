"""A recording as a table: `piezod export` in a process of its own, and its file as a download."""

import asyncio
import re
import sys
from collections.abc import AsyncGenerator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from starlette.responses import FileResponse, Response
from starlette.types import Receive, Scope, Send

from piezod.resource_limits import bound_other
from piezod.web.download import while_connected
from piezod.web.errors import NOT_FOUND, PageError, refused_file
from piezod.web.job_commands import RECORDING
from piezod.web.stages import Stages

MEDIA_TYPES: Final = {"csv": "text/csv", "parquet": "application/vnd.apache.parquet"}
"""The formats of a table, which are the endings of its file, and their media types."""
MOST_BYTES: Final = 4_000_000_000
"""Most address space of the command; Parquet reserves more of it than it uses."""
MOST_CPU_S: Final = 3600
_FOLDER: Final = "piezod-export-"
_NO_PYARROW: Final = "Parquet needs `pip install 'piezod[parquet]'` where `piezod web` runs"
_REMEDY: Final = "`piezod export` in a shell has more options"


def barriers() -> dict[str, str]:
    """Return why each format cannot be made here, for people; "" if it can."""
    missing = "" if find_spec("pyarrow") else _NO_PYARROW
    return {ending: missing if ending == "parquet" else "" for ending in MEDIA_TYPES}


class Exports:
    """Makes tables one by one: a long recording takes a processor and room on the disk."""

    def __init__(self, stages: Stages) -> None:
        self._stages = stages
        self._one_at_a_time = asyncio.Lock()

    @asynccontextmanager
    async def table(self, stage: str, name: str, ending: str) -> AsyncGenerator[Path, None]:
        """Yield the file of a table, which is removed afterwards.

        Raises:
            PageError: If there is no such stage, recording or format, or it cannot be exported.
        """
        if ending not in MEDIA_TYPES or not re.fullmatch(RECORDING, name):
            raise PageError(NOT_FOUND, f"no table {name[:64]!r} as {ending[:16]!r}", _REMEDY)
        async with self._stages.visiting(stage) as connections:
            with TemporaryDirectory(prefix=_FOLDER) as folder:
                path = Path(folder) / f"{name}.{ending}"
                async with self._one_at_a_time:
                    await _export(connections.socket, name, path)
                yield path


class ExportAnswer(Response):
    """The file of a table, or the document of an error.

    Args:
        exports: Makes the table.
        stage: Name of the stage.
        name: Name of the recording.
        ending: Its format.
    """

    def __init__(self, exports: Exports, stage: str, name: str, ending: str) -> None:
        super().__init__()
        self._exports, self._wanted = exports, (stage, name, ending)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Make the table and send it; stop that if the browser leaves."""
        await while_connected(self._serve(scope, receive, send), _wait_for_end(receive))

    async def _serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        stage, name, ending = self._wanted
        async with AsyncExitStack() as stack:
            answer: Response
            try:
                path = await stack.enter_async_context(self._exports.table(stage, name, ending))
                answer = FileResponse(path, media_type=MEDIA_TYPES[ending], filename=path.name)
            except PageError as error:
                answer = refused_file(error, scope)
            await answer(scope, receive, send)


async def _wait_for_end(receive: Receive) -> None:
    """Wait until the browser disconnects."""
    while (await receive())["type"] != "http.disconnect":
        pass


async def _export(socket: Path, name: str, path: Path) -> None:
    """Run the command.

    Raises:
        PageError: If it fails; with what it prints.
    """
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "piezod", "export", name, "--out", str(path), "--socket", str(socket),
        stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE, cwd=path.parent, start_new_session=True,
    )  # fmt: skip
    bound_other(process.pid, MOST_BYTES, MOST_CPU_S)
    try:
        _, text = await process.communicate()
    finally:
        if process.returncode is None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
    if process.returncode:
        raise PageError("recording", text.decode(errors="replace").strip()[-1000:], _REMEDY)
