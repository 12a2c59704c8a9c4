"""Fly scans: a movement with all of its samples as a stream."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

from bluesky.protocols import (
    Collectable,
    Flyable,
    HasHints,
    Hints,
    Preparable,
    StreamAsset,
    WritesStreamAssets,
)
from event_model import DataKey
from ophyd_async.core import AsyncStatus, Device, PathInfo, PathProvider

from piezod.bluesky.connected_stage import ConnectedStage
from piezod.bluesky.play import Play
from piezod.bluesky.recorded import Column, RecordedFile
from piezod.bluesky.scan import Scan
from piezod.bluesky.wave import Wave
from piezod.client.mirror import take_exception
from piezod.errors import ClientError, DataError, RefusedError

Flight: TypeAlias = Wave | Play | Scan


class PiezoFlyer(Device, Preparable, Flyable, Collectable, WritesStreamAssets, HasHints):
    """Carries out a `Flight`, and gives each of its samples or pixels as a row of a stream.

    `prepare` checks it, and moves to the start of a wave; `kickoff` starts it; `complete` is done
    at its end, when the data are in the file that the path provider names. Each flight has a file
    of its own.

    Args:
        link: Connection to the stage.
        columns: Returns the columns of a recording; called after connecting.
        path_provider: Names the files; None if the stage shall not fly.
    """

    def __init__(
        self,
        link: ConnectedStage,
        columns: Callable[[], Sequence[Column]],
        path_provider: PathProvider | None,
    ) -> None:
        self._link, self._recorded, self._path_provider = link, columns, path_provider
        self._prepared: Flight | None = None
        self._flight: asyncio.Task[None] | None = None
        self._columns: Sequence[Column] = ()
        self._file: RecordedFile | None = None
        super().__init__()

    @property
    def hints(self) -> Hints:
        """The first column, a position."""
        return Hints(fields=[self._columns_now()[0].key])

    @property
    def flies(self) -> bool:
        """Whether a flight has begun and not ended."""
        return self._flight is not None and not self._flight.done()

    @AsyncStatus.wrap
    async def prepare(self, value: Flight) -> None:
        """Check a wave and move its axes to its start, or check a play or a scan.

        Raises:
            RefusedError: If it leaves the range of an axis, or there is no path provider.
            NotReachedError: If an axis does not arrive at the start.
            ClientError: If the daemon does not answer.
        """
        if self._path_provider is None:
            what = f"{self.name}: no place for the recordings"
            raise RefusedError(what, "give the stage a path_provider", "value")
        await value.prepare(self._link)
        self._prepared, self._columns = value, value.columns(self._recorded())

    @AsyncStatus.wrap
    async def kickoff(self) -> None:
        """Start what was prepared.

        Raises:
            RefusedError: If nothing was prepared, or the daemon refuses.
            ClientError: If the daemon does not answer.
        """
        prepared, self._prepared, self._file = self._prepared, None, None
        if prepared is None or self._path_provider is None:
            raise RefusedError(
                f"{self.name}: nothing is prepared",
                "prepare a flight first",
                "value",
            )
        begun = asyncio.Event()
        place = self._path_provider(self.name)
        self._flight = asyncio.create_task(self._fly(prepared, place, begun))
        self._flight.add_done_callback(take_exception)
        waiting = asyncio.create_task(begun.wait())
        await asyncio.wait({self._flight, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if not begun.is_set():
            await self._flight

    @AsyncStatus.wrap
    async def complete(self) -> None:
        """Wait for the end of the flight, and for its data.

        Raises:
            NotReachedError: If the stage was stopped or held, or another client has moved it.
            DataError: If there are no data.
            ClientError: If the daemon ends.
        """
        if self._flight is None:
            raise RefusedError(f"{self.name}: nothing flies", "kick it off first", "value")
        await self._flight

    async def describe_collect(self) -> dict[str, DataKey]:
        """Return the descriptions of the columns of what was prepared last, or of a wave."""
        return {column.key: column.data_key() for column in self._columns_now()}

    async def collect_asset_docs(self, index: int | None = None) -> AsyncIterator[StreamAsset]:
        """Yield the documents of the rows that were not collected before.

        Args:
            index: Number of rows to report; None for all.
        """
        if self._file is not None:
            rows = self._file.rows if index is None else min(index, self._file.rows)
            for document in self._file.documents(rows):
                yield document

    async def get_index(self) -> int:
        """Return the number of rows; 0 before the end of the flight."""
        return 0 if self._file is None else self._file.rows

    async def land(self) -> None:
        """End the recording of a flight; the stage moves on, until it is held."""
        self._prepared = None
        if self._flight is not None and not self._flight.done():
            self._flight.cancel()
            with suppress(asyncio.CancelledError, ClientError, DataError):
                await self._flight

    def _columns_now(self) -> Sequence[Column]:
        return self._columns or self._recorded()

    async def _fly(self, prepared: Flight, place: PathInfo, begun: asyncio.Event) -> None:
        file = Path(place.directory_path) / f"{place.filename}.h5"
        await asyncio.to_thread(_make_room, file, place.create_dir_depth)
        async with self._link.commanding():
            await prepared.fly(self._link, file, begun)
        uri = f"{place.directory_uri}{file.name}"
        self._file = await asyncio.to_thread(RecordedFile, file, uri, self._columns)


def _make_room(file: Path, create_dir_depth: int) -> None:
    if file.exists():
        raise DataError(f"{file} exists; the path provider must name another file for each flight")
    if create_dir_depth:
        file.parent.mkdir(parents=True, exist_ok=True)
