"""Download of recordings: plain files of one folder only."""

import asyncio
import os
import re
import stat
from pathlib import Path
from typing import Final

from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from piezod.daemon.service.peer_protocol import PeerProtocol
from piezod.daemon.stage.errors import UnknownNameError

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,99}")
_CHUNK: Final = 256 * 1024


def open_recording(folder: Path, name: str) -> int:
    """Open the file of a recording; return its descriptor.

    Raises:
        UnknownNameError: If the folder has no plain file of that name.
    """
    unknown = UnknownNameError(f"no recording {name[:100]!r}", "`piezod record list` shows them")
    if not _NAME.fullmatch(name):
        raise unknown
    try:
        inside = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            descriptor = os.open(f"{name}.h5", flags, dir_fd=inside)
        finally:
            os.close(inside)
    except OSError as error:
        raise unknown from error
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise unknown
    return descriptor


class RecordingAnswer(Response):
    """The file of a recording, unchanged.

    Args:
        descriptor: The open file; closed at the end.
        name: Name of the recording.
        connection: Connection of the client.
        downloads: Users with a download in progress; includes this user until the end.
        uid: The user.
    """

    media_type = "application/x-hdf5"

    def __init__(
        self, descriptor: int, name: str, connection: PeerProtocol, downloads: set[int], uid: int
    ) -> None:
        self._descriptor, self._connection = descriptor, connection
        self._downloads, self._uid = downloads, uid
        downloads.add(uid)
        self._left = os.fstat(descriptor).st_size
        headers = {
            "content-length": str(self._left),
            "content-disposition": f'attachment; filename="{name}.h5"',
        }
        super().__init__(headers=headers)

    async def __call__(self, _scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the file."""
        try:
            await send(
                {"type": "http.response.start", "status": 200, "headers": self.raw_headers},
            )
            while self._left and await self._send_chunk(send):
                pass
            await send({"type": "http.response.body", "body": b""})
        finally:
            self._downloads.discard(self._uid)
            os.close(self._descriptor)

    async def _send_chunk(self, send: Send) -> bool:
        # The file may grow, but the answer has its announced length. A thread, because a disk may
        # be slow.
        chunk = await asyncio.to_thread(os.read, self._descriptor, min(_CHUNK, self._left))
        self._left -= len(chunk)
        message = {"type": "http.response.body", "body": chunk, "more_body": True}
        await send(message)
        return bool(chunk) and not self._connection.closing.is_set()
