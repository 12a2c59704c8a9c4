"""`piezod import`: a record of others as piezod reads it."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.record_options import (
    FORMATS,
    ColumnsOption,
    InvertOption,
    OffsetOption,
    RateHzOption,
    ScaleOption,
    choices_of,
    record_file,
)


def import_record(  # noqa: PLR0913, PLR0917 - each argument is an option
    data: Annotated[
        Path,
        typer.Argument(
            metavar="DATA",
            help=f"Table of time, voltage and position: {FORMATS}.",
            readable=False,
            callback=record_file,
        ),
    ],
    columns: ColumnsOption = "",
    scale: ScaleOption = "",
    offset: OffsetOption = "",
    invert: InvertOption = "",
    rate_hz: RateHzOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="RECORD.csv",
            readable=False,
            help="Write the columns t_s, drive_v, position_um to this file, and beside it a "
            "picture (.png). Default: nothing is written.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Show how a record of others is read.

    Prints what was understood: form of the file, columns, units, rate, ranges. What cannot be told
    is asked for, with the options that say it; `piezod identify` takes the same ones.
    """
    choices = choices_of(columns, scale, offset, invert, rate_hz)
    # numpy, scipy and matplotlib take long to import.
    from piezod.cli.identify.import_run import import_file

    import_file(data, choices, out, json=json)
