"""`piezod identify`: fit the inverse model to recorded data."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.identify.method_choice import DEFAULT_ORDER, MethodChoice
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption, VectorOption
from piezod.cli.paths import check_yaml_out, existing_file
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
from piezod.cli.stage_options import AxisOption, SocketOption, StageOption, connect
from piezod.experiment.fit.method import Spacing
from piezod.reading.choices import Choices

DataArgument: TypeAlias = Annotated[
    Path | None,
    typer.Argument(
        metavar="DATA",
        help=f"Table of time, voltage and position, evenly spaced in time: {FORMATS}; or recording "
        "of a stage (.h5); none with --live.",
        readable=False,
        callback=record_file,
    ),
]
TestOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="OTHER",
        help="Another record of the same stage, to test the model on; with the same columns.",
        readable=False,
        callback=record_file,
    ),
]
SkipOption: TypeAlias = Annotated[
    float,
    typer.Option(
        min=0,
        metavar="S",
        help="Excluded start of each record, in s. Samples in which the unknown past before the "
        "record may matter are always excluded.",
    ),
]
DelayOption: TypeAlias = Annotated[
    str,
    typer.Option(
        metavar="auto|S",
        help="Delay of the displacement behind the drive, in s; auto: estimated. 0 to 1; with "
        "--method surface also negative, from -0.1, if samples were reported early.",
    ),
]
MethodOption: TypeAlias = Annotated[
    MethodChoice | None,
    typer.Option(
        help="Method of the fit: lms is the paper's; least-squares fits all its weights at once; "
        "surface fits a smooth surface of loops, for records with loops of all sizes; auto chooses "
        "the model that predicts held-out positions and voltages best. Default: auto; with "
        "--order or --thresholds, least-squares.",
        show_default=False,
    ),
]
OrderOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=200,
        metavar="M",
        help=f"Number of operators on each side; not with surface. Default: {DEFAULT_ORDER}; with "
        "auto, chosen.",
    ),
]
ThresholdsOption: TypeAlias = Annotated[
    Spacing | None,
    typer.Option(
        help="Spacing of their thresholds: even; graded, denser at both ends; placed, denser where "
        "the data bend most; not with surface. Default: graded; with lms, even; with auto, chosen.",
        show_default=False,
    ),
]
CreepOption: TypeAlias = Annotated[
    bool | None,
    typer.Option(
        "--creep/--no-creep",
        help="Whether creep is fitted too; not with lms. Default: no; with surface, if the "
        "record is long enough; with auto, chosen.",
        show_default=False,
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="MODEL.yaml",
        readable=False,
        help="Write the model to this file, for `model:` of an axis, and beside it a figure of "
        "data and model (.png). Default: nothing is written.",
    ),
]
LiveOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Drive a running stage from rest and fit its record, which is stored beside the model "
        "or in the current folder, with a number if there is one of that name.",
    ),
]
DriveOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.yaml",
        readable=False,
        callback=existing_file,
        help="With --live: file with an `identification:`, which gives the drive. Default: a drive "
        "of 80 s over all voltages of the axis, which covers everything that the fit needs.",
    ),
]
AdoptOption: TypeAlias = Annotated[
    bool, typer.Option("--adopt", help="With --live: the stage uses the model from now on.")
]

CouplingOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--coupling",
        help="Fit how far the axes move each other, for `transform:`; DATA is a recording that "
        "moves one axis after the other. Only with --out and --json.",
    ),
]
VerboseOption: TypeAlias = Annotated[
    bool,
    typer.Option("--verbose", help="Print the choice, all errors, and a drive to record, too."),
]


def identify(  # noqa: PLR0913, PLR0917 - each argument is an option
    data: DataArgument = None,
    test: TestOption = None,
    skip_s: SkipOption = 0.0,
    delay_s: DelayOption = "auto",
    method: MethodOption = None,
    order: OrderOption = None,
    thresholds: ThresholdsOption = None,
    creep: CreepOption = None,
    columns: ColumnsOption = "",
    scale: ScaleOption = "",
    offset: OffsetOption = "",
    invert: InvertOption = "",
    rate_hz: RateHzOption = None,
    out: OutOption = None,
    vector: VectorOption = False,
    live: LiveOption = False,
    drive: DriveOption = None,
    adopt: AdoptOption = False,
    coupling: CouplingOption = False,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    verbose: VerboseOption = False,
    json: JsonOption = False,
) -> None:
    """Fit the inverse model to recorded data.

    DATA is a table, or a recording of a stage as `piezod record get` copies it. With --live the
    data are recorded on a running stage, which is driven from rest and disarmed at
    the end.

    Prints first, in five lines, whether the model can be used, its error on another drive, what the
    record does not show, and what to do next; then what is doubtful. --verbose and --json print all
    results: the errors of the drive voltage that the model predicts from the position, and of the
    position that it predicts from the voltage, in % of the ranges: on the record, on contiguous
    blocks of it that the fit did not use, and on another record. The delay from drive to
    position is the one with the smallest error, unless --delay-s gives it. A record of one
    frequency determines it only to about one sample.
    """
    choices = choices_of(columns, scale, offset, invert, rate_hz)
    _check_usage(data, live=live, only_live=(drive, adopt, stage, socket), choices=choices)
    check_yaml_out(out)
    if coupling:
        _fit_coupling(data, out, alone=not (test or axis or choices), json=json)
        return
    # numba, scipy and matplotlib take long to import.
    from piezod.cli.identify.run import FitJob, fit_file, fit_live
    from piezod.cli.identify.settings import fit_settings, given_delay_s

    settings = fit_settings(method, order, thresholds, creep)
    given_s = given_delay_s(delay_s, settings)
    job = FitJob(test, skip_s, given_s, settings, vector=vector, verbose=verbose)
    if data is not None:
        fit_file(data, job._replace(axis=axis, choices=choices), out, json=json)
        return
    with unwinding(), connect(stage, socket) as client:
        fit_live(client, job, axis, drive, out, adopt=adopt, json=json)


def _fit_coupling(data: Path | None, out: Path | None, *, alone: bool, json: bool) -> None:
    """Fit couplings in place of a model."""
    if data is None or not alone:
        raise typer.BadParameter("--coupling goes with DATA, --out and --json only")
    from piezod.cli.identify.coupling_run import fit_couplings

    fit_couplings(data, out, json=json)


def _check_usage(
    data: Path | None, *, live: bool, only_live: Iterable[object], choices: Choices
) -> None:
    """Refuse arguments that exclude each other; `only_live` are false if not given."""
    if live and data is not None:
        raise typer.BadParameter("DATA and --live exclude each other")
    if not live and data is None:
        raise typer.BadParameter("Missing argument 'DATA'; or --live, for a running stage")
    if not live and any(only_live):
        message = "--drive, --adopt, --stage and --socket need --live"
        raise typer.BadParameter(message)
    if live and choices:
        message = "--columns, --scale, --offset, --invert and --rate-hz need DATA"
        raise typer.BadParameter(message)
