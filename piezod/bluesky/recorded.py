"""Documents that tell where the columns of a recording are, for consumers of event-model."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple, cast

import h5py
import numpy as np
from bluesky.protocols import StreamAsset
from event_model import (
    ComposeStreamResource,
    ComposeStreamResourceBundle,
    DataKey,
    StreamRange,
)
from ophyd_async.core import SignalMetadata

from piezod.errors import DataError

MIMETYPE: Final = "application/x-hdf5"
_DTYPE: Final = np.dtype("f8").str


class Column(NamedTuple):
    """A column of numbers in a recording."""

    key: str  #: Its key in the documents.
    dataset: str  #: Path of its dataset in the file.
    source: str  #: Where its values come from.
    metadata: SignalMetadata  #: Unit, precision and limits.
    dtype: str = _DTYPE  #: Type of its values, as numpy names it.

    def data_key(self) -> DataKey:
        """Return the description of the column, for the descriptor of the stream."""
        key = DataKey(
            source=self.source,
            shape=[1],
            dtype="number" if self.dtype == _DTYPE else "integer",
            dtype_numpy=self.dtype,
            external="STREAM:",
        )
        return cast("DataKey", {**key, **self.metadata})


class RecordedFile:
    """The rows of a file, of which documents are made up to an index.

    Args:
        file: A closed recording.
        uri: Where consumers find it.
        columns: Its columns.

    Raises:
        DataError: If the file has other columns.
        OSError: If it cannot be read.
    """

    def __init__(self, file: Path, uri: str, columns: Sequence[Column]) -> None:
        compose, lengths = ComposeStreamResource(), set()
        self._bundles: list[ComposeStreamResourceBundle] = []
        with h5py.File(file, "r") as opened:
            for column in columns:
                dataset = opened.get(column.dataset)
                if dataset is None or dataset.dtype.str != column.dtype:
                    raise DataError(f"{file}: {column.dataset} is missing, or of another type")
                lengths.add(len(dataset))
                parameters = {
                    "dataset": column.dataset,
                    "chunk_shape": dataset.chunks,
                    "swmr": False,
                }
                self._bundles.append(
                    compose(mimetype=MIMETYPE, uri=uri, data_key=column.key, parameters=parameters)
                )
        self.rows = min(lengths)
        self._told = 0

    def documents(self, rows: int) -> list[StreamAsset]:
        """Return the documents of the rows that were not reported before.

        Args:
            rows: Number of rows, from the first one, that are to be reported.
        """
        found: list[StreamAsset] = []
        if not self._told:
            found += [("stream_resource", each.stream_resource_doc) for each in self._bundles]
        if rows > self._told:
            indices = StreamRange(start=self._told, stop=rows)
            found += [
                ("stream_datum", each.compose_stream_datum(indices)) for each in self._bundles
            ]
            self._told = rows
        return found
