"""Waves as fly scans: all cycles of the loop, from a recording, as a stream."""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

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

from piezod.bluesky.link import StageLink
from piezod.bluesky.motion import follow_waves, move_to
from piezod.bluesky.recorded import Column, RecordedFile
from piezod.bluesky.wave import Wave
from piezod.errors import ClientError, DataError, RefusedError

_LABEL: Final = "bluesky"


class PiezoFlyer(Device, Preparable, Flyable, Collectable, WritesStreamAssets, HasHints):
    """Follows waves, and gives each cycle of the loop on the way as a row of a stream.

    `prepare` takes a `Wave` and moves to its start; `kickoff` starts the wave, with a recording;
    `complete` is done at its end, when the recording has been copied to the place that the path
    provider names. Each flight has a file of its own.

    Args:
        link: Connection to the stage.
        columns: Returns the columns of the recording; called after connecting.
        path_provider: Names the files; None if the stage shall not fly.
    """

    def __init__(
        self,
        link: StageLink,
        columns: Callable[[], Sequence[Column]],
        path_provider: PathProvider | None,
    ) -> None:
        self._link, self._columns, self._path_provider = link, columns, path_provider
        self._wave: Wave | None = None
        self._flight: asyncio.Task[None] | None = None
        self._file: RecordedFile | None = None
        super().__init__()

    @property
    def hints(self) -> Hints:
        """The first column, which is the position of the first axis."""
        return Hints(fields=[self._columns()[0].key])

    @AsyncStatus.wrap
    async def prepare(self, value: Wave) -> None:
        """Check a wave, and move its axes to its start.

        Raises:
            RefusedError: If it leaves the range of an axis, or there is no path provider.
            NotReachedError: If an axis does not arrive at the start.
            ClientError: If the daemon does not answer.
        """
        if self._path_provider is None:
            what = f"{self.name}: no place for the recordings"
            raise RefusedError(what, "give the stage a path_provider", "value")
        start_um = value.start_um(self._link.facts)
        await asyncio.gather(*(move_to(self._link, axis, um) for axis, um in start_um.items()))
        self._wave = value

    @AsyncStatus.wrap
    async def kickoff(self) -> None:
        """Start the recording and the wave.

        Raises:
            RefusedError: If nothing was prepared, or the daemon refuses.
            ClientError: If the daemon does not answer.
        """
        wave, self._wave, self._file = self._wave, None, None
        if wave is None or self._path_provider is None:
            raise RefusedError(f"{self.name}: nothing to follow", "prepare a Wave first", "value")
        begun = asyncio.Event()
        place = self._path_provider(self.name)
        self._flight = asyncio.create_task(self._fly(wave, place, begun))
        waiting = asyncio.create_task(begun.wait())
        await asyncio.wait({self._flight, waiting}, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if not begun.is_set():
            await self._flight

    @AsyncStatus.wrap
    async def complete(self) -> None:
        """Wait for the end of the wave, and for its recording.

        Raises:
            NotReachedError: If the wave was stopped, held or replaced.
            DataError: If the recording has ended before the wave.
            ClientError: If the daemon ends.
        """
        if self._flight is None:
            raise RefusedError(f"{self.name}: nothing is followed", "kick it off first", "value")
        await self._flight

    async def describe_collect(self) -> dict[str, DataKey]:
        """Return the descriptions of the columns."""
        return {column.key: column.data_key() for column in self._columns()}

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
        """Return the number of recorded rows; 0 before the end of the wave."""
        return 0 if self._file is None else self._file.rows

    @property
    def flies(self) -> bool:
        """Whether a wave has begun and not ended."""
        return self._flight is not None and not self._flight.done()

    async def land(self) -> None:
        """End the recording of a wave; the stage moves on, until it is held."""
        self._wave = None
        if self._flight is not None and not self._flight.done():
            self._flight.cancel()
            with suppress(asyncio.CancelledError, ClientError, DataError):
                await self._flight

    async def _fly(self, wave: Wave, place: PathInfo, begun: asyncio.Event) -> None:
        link, file = self._link, Path(place.directory_path) / f"{place.filename}.h5"
        async with link.commanding():
            await asyncio.to_thread(_make_room, file, place.create_dir_depth)
            await link.daemon.start_recording(_LABEL)
            try:
                await follow_waves(link, wave.command_um, wave.duration_s, begun)
            except BaseException:
                with suppress(ClientError):  # the reason is the other error
                    await link.daemon.stop_recording()
                raise
            recording = await link.daemon.stop_recording()
            if recording.why or recording.files > 1:
                why = recording.why or "it has several files, see recordings.max_file_mb"
                raise DataError(f"{link.title}: recording {recording.name}: {why}")
            await link.fetch_recording(recording.name, file)
        uri = f"{place.directory_uri}{file.name}"
        self._file = await asyncio.to_thread(RecordedFile, file, uri, self._columns())


def _make_room(file: Path, create_dir_depth: int) -> None:
    if file.exists():
        raise DataError(f"{file} exists; the path provider must name another file for each flight")
    if create_dir_depth:
        file.parent.mkdir(parents=True, exist_ok=True)
