"""Recordings for the page, read in a process of its own: a long one would hold up an e-stop."""

import asyncio
import json
import sys
from contextlib import suppress
from typing import Final

from piezod.messages.documents import Document
from piezod.web.errors import PageError

WITHIN_S: Final = 120.0
"""Longest time for one answer, in s: a copy of a long recording takes most of it."""
_LONGEST_LINE: Final = 16 * 1024 * 1024
_TRY_OTHER: Final = "try a shorter span, or `piezod plot`"
_MODULE: Final = "piezod.web.recording_worker"


class RecordingReader:
    """Asks one process after the other question; it is started with the first one."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._one_at_a_time = asyncio.Lock()

    async def ask(self, wanted: Document) -> Document:
        """Return the result of a request, see `recording_worker`.

        Raises:
            PageError: If the recording cannot be read.
        """
        async with self._one_at_a_time:
            try:
                async with asyncio.timeout(WITHIN_S):
                    answer = await self._exchange(wanted)
            except TimeoutError as error:
                await self._end()
                what = f"the recording was not read within {WITHIN_S:.0f} s"
                raise PageError("recording", what, _TRY_OTHER) from error
            except (ValueError, OSError) as error:
                await self._end()
                raise PageError("recording", f"the recording was not read: {error}") from error
            except asyncio.CancelledError:
                await self._end()  # its answer would be taken for that of the next request
                raise
        if refused := answer.get("error"):
            raise PageError(refused["code"], refused["what"], refused["remedy"])
        result: Document = answer["result"]
        return result

    async def aclose(self) -> None:
        """End the process."""
        async with self._one_at_a_time:
            await self._end()

    async def _exchange(self, wanted: Document) -> Document:
        if self._process is None:
            pipe = asyncio.subprocess.PIPE
            self._process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", _MODULE, stdin=pipe, stdout=pipe, limit=_LONGEST_LINE
            )
        source, sink = self._process.stdout, self._process.stdin
        if source is None or sink is None:
            raise OSError("the process that reads it has no pipes")
        sink.write(json.dumps(wanted).encode() + b"\n")
        await sink.drain()
        line = await source.readline()
        if not line.endswith(b"\n"):
            raise OSError("the process that reads it has ended")
        answer: Document = json.loads(line)
        return answer

    async def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
