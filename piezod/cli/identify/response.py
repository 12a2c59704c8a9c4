"""`piezod response`: the frequency response of an axis."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.paths import check_yaml_out
from piezod.cli.progress import progress_bar
from piezod.cli.record_options import FORMATS, record_file
from piezod.cli.stage_options import SocketOption, StageOption, axis_names, connect

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
        callback=record_file,
        help=f"Evaluate a recording (.h5), or a table of time, voltage and position ({FORMATS}), "
        "in place of driving the stage. Its drive must contain many frequencies.",
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


def response(  # noqa: PLR0913, PLR0917 - each argument is an option
    axis: AxisArgument = None,
    from_file: FromOption = None,
    offset_v: OffsetOption = None,
    amplitude_v: AmplitudeOption = None,
    low_hz: LowOption = None,
    high_hz: HighOption = None,
    periods: PeriodsOption = None,
    out: OutOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Measure the frequency response of an axis: gain, delay and modes.

    A running stage is driven from rest to the middle of its voltages, and there by small steps and
    by a multisine, a sum of sinusoids of many frequencies. It is disarmed at the end. With --from a
    recording is evaluated, and no stage is driven.

    Prints the small-signal gain in µm/V, the delay, and the modes with their damping. Only
    frequencies below half of the rate can be measured.
    """
    # scipy and matplotlib take long to import.
    from piezod.cli.identify.response_view import write_and_print
    from piezod.experiment.live.response import response_live
    from piezod.experiment.response.plan import Wanted
    from piezod.experiment.response.recorded import response_of_file

    check_yaml_out(out)
    wanted = Wanted(tuple(offset_v or ()), amplitude_v, low_hz, high_hz, periods)
    if from_file is None:
        with unwinding(), connect(stage, socket) as client, progress_bar() as progress:
            record = response_live(client, axis, wanted, progress)
    elif any((*wanted, stage, socket)):
        message = "only AXIS, --out and --json go with it: nothing is driven"
        raise typer.BadParameter(message, param_hint="'--from'")
    else:
        record = response_of_file(from_file, axis)
    write_and_print(record, out, json=json)
