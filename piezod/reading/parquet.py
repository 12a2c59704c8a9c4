"""Tables in .parquet files."""

from collections.abc import Sequence
from pathlib import Path

from piezod.errors import DataError
from piezod.reading.extra import library
from piezod.reading.table import MOST_VALUES, Column, FloatArray, Table, as_column


def open_parquet(file: Path, part: str) -> Table:
    """Return the table in a .parquet file.

    Raises:
        DataError: If it has no columns of numbers, is damaged, or pyarrow is not installed.
    """
    arrow = library("pyarrow", "a .parquet file", file)
    parquet = library("pyarrow.parquet", "a .parquet file", file)
    if part:
        raise DataError(f"{file}: a .parquet file has no parts; leave out ':{part}'")
    try:
        with parquet.ParquetFile(file) as opened:
            schema, rows = opened.schema_arrow, opened.metadata.num_rows
    except (arrow.ArrowException, OSError) as error:
        raise DataError(f"{file}: the .parquet file is damaged: {error}") from error
    types = arrow.types
    fields = [
        field for field in schema if types.is_floating(field.type) or types.is_integer(field.type)
    ]
    if not fields:
        raise DataError(f"{file}: it has no columns of numbers; has {', '.join(schema.names)}")
    if rows > MOST_VALUES:
        raise DataError(f"{file}: it has {rows} rows; allowed: at most {MOST_VALUES}")

    def read(numbers: Sequence[int]) -> list[FloatArray]:
        wanted = [fields[number].name for number in numbers]
        try:
            table = parquet.read_table(file, columns=wanted)
        except (arrow.ArrowException, OSError) as error:
            raise DataError(f"{file}: the .parquet file is damaged: {error}") from error
        return [as_column(table.column(name).to_numpy(), f"{file}: {name}") for name in wanted]

    return Table(file, ".parquet", tuple(map(_column, fields)), read, counted="row")


def _column(field: object) -> Column:
    metadata = getattr(field, "metadata", None) or {}
    unit = next((metadata[key] for key in (b"units", b"unit") if key in metadata), b"")
    return Column(str(getattr(field, "name", "")), unit.decode(errors="replace"))
