"""The parameters of a stage on the disk: each save makes a new file, and older ones are kept."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from piezod.daemon.durable import sweep_temporaries, sync_folder, write_durably
from piezod.daemon.stores.parameter_document import (
    MAX_BYTES,
    AxisParameters,
    ParameterDocument,
    decode,
    encode,
)
from piezod.errors import DataError
from piezod.messages.stores import HistoryEntry, Rejected
from piezod.own_folder import make_folder

KEPT: Final = 20
"""Number of valid files that are kept."""

_FILE_NAME: Final = re.compile(r"([0-9]{9})\.json")


def _utc_now() -> datetime:
    return datetime.now(UTC)


class Loaded(NamedTuple):
    """The result of a load."""

    document: ParameterDocument | None  #: The parameters; None if no file is valid.
    copy: str  #: Which file: "newest", "number 7", or "" without one.
    #: Newer files that were skipped, newest first. People must be told of them, and must agree
    #: before the stage adapts from older parameters.
    rejected: tuple[Rejected, ...]


class ParameterStore:
    """Numbered files in a folder, of which the newest valid one counts.

    A save makes a new file and changes no other one; whatever interrupts it, the older files stay.
    Only the owner of the daemon's lock may use a store. Every method may block on the disk.

    Args:
        folder: Folder of the files; made if it is absent.
        stage_id: Name of the stage, at most 255 characters; files of other stages are refused.
        now: The time of day.

    Raises:
        OSError: If the folder cannot be made or read.
    """

    def __init__(self, folder: Path, stage_id: str, now: Callable[[], datetime] = _utc_now) -> None:
        make_folder(folder, 0o750)
        sweep_temporaries(folder)  # the daemon's lock excludes other writers
        self._folder, self._stage_id, self._now = folder, stage_id, now

    def save(self, axes: Mapping[str, AxisParameters], who: str) -> int:
        """Save parameters.

        Returns:
            The number under which they can be loaded.

        Raises:
            OSError: If they cannot be written, as on a full disk; older files are unharmed.
            DataError: If they could not be loaded again, for example a model that is not monotone.
        """
        sequence = max(self._sequences(), default=0) + 1  # after invalid files too
        content = encode(
            ParameterDocument(
                sequence=sequence,
                stage=self._stage_id,
                saved_at=self._now().isoformat(timespec="seconds"),
                saved_by=who[:255] or "unknown",
                axes=dict(axes),
            )
        )
        decode(content)  # never store a file that `load` would refuse
        write_durably(self._path(sequence), content)
        self._prune()  # after the write, so that there are always enough files
        return sequence

    def load(self, sequence: int | None = None) -> Loaded:
        """Return the newest valid parameters, or those with a number.

        With a number, no other file is used instead of an invalid one.

        Args:
            sequence: The number that `save` returned; None for the newest.
        """
        rejected: list[Rejected] = []
        for number in self._newest_first():
            if sequence not in (None, number):
                continue
            try:
                document = self._read(number)
            except DataError as error:
                rejected.append(Rejected(self._path(number).name, str(error)))
            else:
                copy = f"number {number}" if rejected or sequence is not None else "newest"
                return Loaded(document, copy, tuple(rejected))
        return Loaded(None, "", tuple(rejected))

    def history(self) -> tuple[HistoryEntry, ...]:
        """Return the stored files, newest first, including invalid ones."""
        return tuple(self._stored(number) for number in self._newest_first())

    def _stored(self, number: int) -> HistoryEntry:
        try:
            document = self._read(number)
        except DataError as error:
            return HistoryEntry(number, why=str(error))
        return HistoryEntry(number, document.saved_at, document.saved_by, tuple(document.axes))

    def _read(self, number: int) -> ParameterDocument:
        try:
            document = decode(_content(self._path(number)))
        except OSError as error:
            raise DataError(f"it cannot be read: {error.strerror}") from error
        if document.stage != self._stage_id:
            raise DataError(
                f"it belongs to stage {document.stage!r}, this is {self._stage_id!r}; identify "
                "this stage, or use its own files"
            )
        if document.sequence != number:  # else an old file could pass for the newest
            raise DataError(f"it was number {document.sequence} and has been renamed")
        return document

    def _prune(self) -> None:
        """Remove the files that are older than enough valid ones; invalid files do not count."""
        good = 0
        for number in self._newest_first():
            if good >= KEPT:
                self._path(number).unlink(missing_ok=True)
            elif not self._stored(number).why:
                good += 1
        sync_folder(self._folder)

    def _newest_first(self) -> list[int]:
        return sorted(self._sequences(), reverse=True)

    def _sequences(self) -> Iterator[int]:
        for entry in os.scandir(self._folder):
            match = _FILE_NAME.fullmatch(entry.name)
            if match:
                yield int(match[1])

    def _path(self, sequence: int) -> Path:
        return self._folder / f"{sequence:09d}.json"


def _content(path: Path) -> bytes:
    """Return the contents of a file, up to one byte more than is allowed; follow no link."""
    # O_NONBLOCK: opening a named pipe must not wait for a writer.
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        with open(descriptor, "rb", closefd=False) as file:
            return file.read(MAX_BYTES + 1)
    finally:
        os.close(descriptor)
