"""Options of the commands that read a record of others, and the path of one."""

from pathlib import Path
from typing import Annotated, Final, TypeAlias

import typer

from piezod.cli.paths import existing_file
from piezod.errors import DataError
from piezod.reading.choices import Choices, parsed_choices
from piezod.reading.part import split_path

FORMATS: Final = (
    "CSV of any kind, .xlsx, .mat, .tdms, .lvm, .npz, .npy, .parquet or HDF5 "
    "(a part: FILE.h5:/PATH)"
)
"""Formats of a record, for the help of its argument."""


def record_file(path: Path | None) -> Path | None:
    """Return the path unchanged, if it is that of a file, or of a part of one.

    Raises:
        typer.BadParameter: If there is no such file, or it is a folder.
        OSError: If the permission to look at it is missing.
    """
    if path is not None:
        existing_file(split_path(path)[0])
    return path


ColumnsOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="t=NAME,…",
        help="Columns of the file by name or number, as in t=TIME,drive=CH1,position=CH2. "
        "Default: told by names and units.",
        show_default=False,
    ),
]
ScaleOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="drive=X,…",
        help="Factors, as in drive=20,position=2: V of the drive, µm of the position and s of "
        "the time (t) per unit of the column.",
        show_default=False,
    ),
]
OffsetOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="drive=V,…",
        help="Added after that, in V and µm, as in position=-10.",
        show_default=False,
    ),
]
InvertOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="position",
        help="Turn the sign of position or drive: of a position that falls while the voltage "
        "rises.",
        show_default=False,
    ),
]
RateHzOption: TypeAlias = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Samples per second, of a file without time."),
]


def choices_of(
    columns: str, scale: str, offset: str, invert: str, rate_hz: float | None
) -> Choices:
    """Return what these options say about the columns of a file.

    Raises:
        typer.BadParameter: If one cannot be understood.
    """
    try:
        return parsed_choices(columns, scale, offset, invert, rate_hz)
    except DataError as error:
        option, _, what = str(error).partition(": ")
        raise typer.BadParameter(what, param_hint=f"'{option}'") from error
