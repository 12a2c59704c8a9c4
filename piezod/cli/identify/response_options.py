"""Arguments and options of `piezod response`."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.paths import existing_file
from piezod.cli.stage_options import axis_names

AxisArgument: TypeAlias = Annotated[
    str | None,
    typer.Argument(metavar="AXIS", autocompletion=axis_names, help="Axis; default: the only one."),
]
FromOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--from",
        metavar="FILE",
        readable=False,
        callback=existing_file,
        help="Evaluate a recording (.h5, or CSV with t_s, drive_v, position_um) in place of "
        "driving the stage. Its drive must contain many frequencies.",
    ),
]
OffsetOption: TypeAlias = Annotated[
    list[float] | None,
    typer.Option(
        "--offset-v",
        metavar="V",
        help="Voltage about which the axis is driven, in V; may be repeated. Default: the middle "
        "of its limits.",
        show_default=False,
    ),
]
AmplitudeOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        min=1e-4,
        metavar="V",
        help="Largest deviation from it, in V. Default: 2 % of the voltages of the axis, less if "
        "the slew rate requires it.",
    ),
]
LowOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        min=1e-3,
        metavar="HZ",
        help="Lowest frequency, in Hz, and distance of the closest lines. Default: 1/2000 of the "
        "rate, at least 1 Hz, and at most 1/60 of the highest.",
    ),
]
HighOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        min=1e-2,
        metavar="HZ",
        help="Highest frequency, in Hz, below half of the rate. Default: 45 % of the rate.",
    ),
]
PeriodsOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=4,
        max=10_000,
        metavar="N",
        help="Averaged periods, each as long as a cycle of the lowest frequency. Default: as many "
        "as fit into 8 s, at least 8.",
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="RESPONSE.yaml",
        readable=False,
        help="Write the model to this file, for `response:` of an axis, and beside it a table of "
        "the lines (.csv) and a figure (.png). Default: nothing is written.",
    ),
]
