"""Files that a page sends, to be read by a job: one for each stage, until this server ends."""

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from urllib.parse import unquote

from piezod.web.errors import NOT_FOUND, PageError

MOST_UPLOAD: Final = 128 * 1024 * 1024
"""Most bytes of a file; `piezod identify` itself takes larger ones."""
WITHIN_S: Final = 300.0
"""Time for a file to arrive, in s."""
_LONGEST_NAME: Final = 100
_REMEDY: Final = "use `piezod identify FILE` on this computer"


class Uploads:
    """The newest file of each stage; one is taken at a time."""

    def __init__(self) -> None:
        self._folder: TemporaryDirectory[str] | None = None
        self._files: dict[str, Path] = {}
        self._taking = False

    async def take(self, stage: str, name: str, body: AsyncIterator[bytes]) -> None:
        """Store a file in place of the one that the stage had.

        Args:
            stage: Name of the stage.
            name: Name of the file as the page gives it, percent-encoded.
            body: The contents, in pieces.

        Raises:
            PageError: If it is too large or takes too long, or another one is being taken.
            OSError: If it cannot be stored.
        """
        if self._taking:
            raise PageError("busy", "another file is being sent", "wait for its end")
        self._taking = True
        try:
            self._folder = self._folder or TemporaryDirectory(prefix="piezod-upload-")
            part = Path(self._folder.name) / "part"
            async with asyncio.timeout(WITHIN_S):
                await _write(part, body)
            folder = part.with_name(stage)
            folder.mkdir(exist_ok=True)
            for old in folder.iterdir():
                old.unlink()
            self._files[stage] = part.rename(folder / _plain(name))
        except TimeoutError as error:
            what = f"the file did not arrive within {WITHIN_S:g} s"
            raise PageError("too_slow", what, _REMEDY) from error
        finally:
            self._taking = False

    def path(self, stage: str) -> Path:
        """Return the file of a stage.

        Raises:
            PageError: If none was sent.
        """
        if stage not in self._files:
            raise PageError(NOT_FOUND, f"no file was sent for stage {stage}", "choose one")
        return self._files[stage]

    def close(self) -> None:
        """Remove all files."""
        if self._folder is not None:
            self._folder.cleanup()


async def _write(path: Path, body: AsyncIterator[bytes]) -> None:
    size = 0
    with path.open("wb") as file:
        async for piece in body:
            size += len(piece)
            if size > MOST_UPLOAD:
                what = f"the file is too large, allowed: {MOST_UPLOAD // 1024**2} MB"
                raise PageError("too_large", what, _REMEDY)
            file.write(piece)


def _plain(name: str) -> str:
    """Return a name that is neither a path nor an option."""
    plain = re.sub(r"[^A-Za-z0-9._]+", "_", unquote(name)).lstrip("._")
    return plain[-_LONGEST_NAME:] or "record"
