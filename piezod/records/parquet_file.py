"""Parquet output: columns with their units, for pandas, polars and other programs."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from piezod.errors import PiezodError
from piezod.records.atomic import replacing


class MissingPyarrowError(PiezodError):
    """Raised when the library for Parquet is not installed."""


def check_parquet() -> None:
    """Check that Parquet can be written.

    Raises:
        MissingPyarrowError: If pyarrow is not installed.
    """
    try:
        import pyarrow.parquet  # noqa: F401, PLC0415 - an optional library
    except ImportError as error:
        raise MissingPyarrowError(
            "Parquet needs pyarrow, which is not installed: `pip install 'piezod[parquet]'`, "
            "or write CSV with --out NAME.csv"
        ) from error


def write_parquet(
    path: Path,
    portions: Iterable[Mapping[str, NDArray[Any]]],
    about: Mapping[str, Mapping[str, str]],
    metadata: Mapping[str, str],
) -> None:
    """Write columns that come in portions; each portion becomes a row group.

    Texts that repeat are stored once per portion.

    Args:
        path: Path of the file; it is written completely or not at all.
        portions: Columns by name, each of shape (n,), at least one portion.
        about: Metadata of each column, as in `{"drive_v": {"units": "V"}}`.
        metadata: Metadata of the file.

    Raises:
        OSError: If the file cannot be written.
    """
    import pyarrow as pa  # noqa: PLC0415 - an optional library, and large
    from pyarrow import parquet  # noqa: PLC0415 - see above

    with replacing(path) as temporary:
        writer = None
        try:
            for portion in portions:
                arrays = [
                    pa.array(column).dictionary_encode()
                    if column.dtype.kind == "U"
                    else pa.array(column)
                    for column in portion.values()
                ]
                fields = [
                    pa.field(name, array.type, metadata=dict(about.get(name, {})))
                    for name, array in zip(portion, arrays, strict=True)
                ]
                schema = pa.schema(fields, metadata=dict(metadata))
                writer = writer or parquet.ParquetWriter(temporary, schema, compression="zstd")
                writer.write_table(pa.Table.from_arrays(arrays, schema=schema))
        finally:
            if writer is not None:
                writer.close()
