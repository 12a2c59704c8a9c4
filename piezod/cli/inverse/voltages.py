"""`piezod voltages`: voltages for a trajectory, without a daemon."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file
from piezod.cli.record.recordings import checked_out
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

ModelArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL",
        help="Model file, as `piezod identify --out` writes it.",
        readable=False,
        callback=existing_file,
    ),
]
LoopHzOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        min=0.01,
        max=1e6,
        help="Rate of the voltages. Default: that of the trajectory.",
        show_default=False,
    ),
]
ConfigOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="STAGE.yaml",
        readable=False,
        callback=existing_file,
        help="Configuration whose axis gives limits, rest voltage, modes and delays, as in its "
        "loop. Default: the voltages of the model, any slew rate, and rest at 0 V.",
    ),
]
OfAxisOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--axis", metavar="NAME", help="Axis of the configuration; default: the only one"),
]

TrajectoryArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="TRAJECTORY",
        help="Positions over time, joined by straight lines: a table with the columns t_s and "
        f"position_um, or what --columns says: {FORMATS}.",
        readable=False,
        callback=record_file,
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv",
        readable=False,
        help="File to write. Default: TRAJECTORY-voltages.csv in the current folder.",
    ),
]
FromOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="V",
        help="Voltage at which the stage has stood for long, after a move from rest. Default: "
        "it starts at rest.",
    ),
]
AfterOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv",
        readable=False,
        callback=record_file,
        help="Voltages just before, which the memory has seen: a table with the columns t_s "
        "and drive_v at the same rate, as an earlier FILE.csv.",
    ),
]


def voltages(  # noqa: PLR0913, PLR0917 - each argument is an option
    model: ModelArgument,
    trajectory: TrajectoryArgument,
    out: OutOption = None,
    loop_hz: LoopHzOption = None,
    from_v: FromOption = None,
    after: AfterOption = None,
    config: ConfigOption = None,
    axis: OfAxisOption = None,
    columns: ColumnsOption = "",
    scale: ScaleOption = "",
    offset: OffsetOption = "",
    invert: InvertOption = "",
    rate_hz: RateHzOption = None,
    json: JsonOption = False,
) -> None:
    """Compute the voltages with which a stage follows a trajectory.

    They are those that mode feedforward of the loop would write at this rate, to the last bit, by
    default from rest. Positions count from rest. The voltages come early by one period and the
    delay of the model. The file has the columns t_s, drive_v, position_um (of the trajectory),
    predicted_um, slew_v_per_s, and limited, which says what cut a voltage.
    """
    path = checked_out(out, Path(f"{trajectory.stem}-voltages.csv"), (".csv",), trajectory)
    if axis is not None and config is None:
        raise typer.BadParameter("--axis needs --config")
    # numba takes long to import.
    from piezod.cli.inverse.voltages_run import Job, write_voltages

    choices = choices_of(columns, scale, offset, invert, rate_hz)
    job = Job(model, trajectory, path, loop_hz, from_v, after, config, axis, choices)
    write_voltages(job, json=json)
