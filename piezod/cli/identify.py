"""`piezod identify`: recorded data becomes a model."""

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable, existing_file
from piezod.cli.stage_options import AxisOption, SocketOption, StageOption, connect
from piezod.experiment.fit.method import Method, Spacing

if TYPE_CHECKING:
    from piezod.experiment.fit.automatic import Wanted
    from piezod.experiment.fit.file import FileFit
    from piezod.experiment.fit.fit import FitSettings

LONGEST_DELAY_S = 1.0
"""What a model file can hold."""
DEFAULT_ORDER = 19


class MethodOption(StrEnum):
    """What `--method` may be."""

    LMS = Method.LMS.value
    LEAST_SQUARES = Method.LEAST_SQUARES.value
    AUTO = "auto"


def identify(  # noqa: PLR0913, PLR0917 - typer reads options off the signature
    data: Annotated[
        Path | None,
        typer.Argument(
            metavar="DATA.csv",
            help="Columns t_s, drive_v, position_um, evenly in time; left out with --live.",
            readable=False,
            callback=existing_file,
        ),
    ] = None,
    test: Annotated[
        Path | None,
        typer.Option(
            metavar="OTHER.csv",
            help="Judge the model on this file, too.",
            readable=False,
            callback=existing_file,
        ),
    ] = None,
    skip_s: Annotated[
        float,
        typer.Option(
            min=0,
            metavar="S",
            help="First seconds of each file that do not count. Those in which the past before the "
            "file may matter never do.",
        ),
    ] = 0.0,
    delay_s: Annotated[
        str,
        typer.Option(
            metavar="auto|S",
            help="How long the displacement lags behind the drive, in s; auto: estimate it.",
        ),
    ] = "auto",
    method: Annotated[
        MethodOption,
        typer.Option(
            help="How to find the weights: the paper's, or all at once; auto: whatever predicts "
            "best what it was not fitted to, with as few operators as that takes."
        ),
    ] = MethodOption.LEAST_SQUARES,
    order: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=200,
            metavar="M",
            help=f"Operators on each side; {DEFAULT_ORDER} unless auto chooses.",
        ),
    ] = None,
    thresholds: Annotated[
        Spacing | None,
        typer.Option(
            help="Where their thresholds are: evenly, denser at both ends, or where the data "
            "bend most. Unless auto chooses, graded; with lms, even.",
            show_default=False,
        ),
    ] = None,
    creep: Annotated[
        bool | None,
        typer.Option(
            "--creep/--no-creep",
            help="Fit creep too; not by lms. Unless auto chooses, no.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL.yaml",
            readable=False,
            help="Write the model to this file, for `model:` in an experiment, and beside it a "
            "figure of data and model (.png). No model is written without it.",
        ),
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live",
            help="Drive a running stage from rest, and fit to what it does. The record is written "
            "beside the model, or into the current folder.",
        ),
    ] = False,
    drive: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.yaml",
            readable=False,
            callback=existing_file,
            help="With --live: drive it as the `identification:` of this file says; left out: by "
            "80 s that tell all a model needs, over all voltages of the axis.",
        ),
    ] = None,
    adopt: Annotated[
        bool,
        typer.Option("--adopt", help="With --live: have the stage use the model from now on."),
    ] = False,
    axis: AxisOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Fit the inverse model to recorded data.

    With --live the data are those of a running stage, which is driven from rest for it, and is
    disarmed at the end.

    Prints the error of the drive voltage that the model predicts from the displacement, in % of the
    range of the voltage: on the record, on contiguous blocks of it that were held out, and on
    another record. The delay from drive to displacement is where that error is least, unless
    --delay-s gives it; a record of one frequency determines it only to about a sample.
    """
    from piezod.cli.identify_live import ADOPTED, adopt_model, check_usage, record_and_fit
    from piezod.cli.identify_view import print_fit
    from piezod.cli.output import new_console
    from piezod.experiment.fit.file import identify_file

    check_usage(data, live=live, only_live=(drive, adopt, axis, stage, socket))
    if out is not None and out.suffix not in (".yaml", ".yml"):
        raise typer.BadParameter(f"must end in .yaml (got {out})", param_hint="'--out'")
    if out is not None and out.parent.is_dir():
        check_writable(out.parent)
    settings, given_delay_s = _settings(method, order, thresholds, creep), _delay(delay_s)

    def fit(file: Path, run_in_s: float) -> "FileFit":
        not_counted_s = max(skip_s, run_in_s)
        return identify_file(
            file, test=test, skip_s=not_counted_s, delay_s=given_delay_s, settings=settings
        )

    if data is not None:
        fitted = fit(data, 0.0)
        plot = _write(fitted, out, datetime.now(UTC)) if out else None
        if json:
            _print_document(fitted, out, plot, {})
        else:
            print_fit(new_console(), fitted, out, plot)
        return
    with connect(stage, socket) as client:
        fitted, driven = record_and_fit(fit, drive, out, axis, client)
        now = datetime.now(UTC)
        plot = _write(fitted, out, now) if out else None
        if not json:
            print_fit(new_console(), fitted, out, plot)
        if adopt:
            adopt_model(fitted, driven, client, now)
    if json:
        _print_document(fitted, out, plot, {"axis": driven, "adopted": adopt})
    elif adopt:
        new_console().print(ADOPTED)


def _print_document(
    fitted: "FileFit", out: Path | None, plot: Path | None, live: "dict[str, object]"
) -> None:
    from piezod.cli.identify_document import as_document
    from piezod.cli.output import print_json

    print_json({**as_document(fitted, out, plot), **live})


def _settings(
    method: MethodOption, order: int | None, thresholds: Spacing | None, creep: bool | None
) -> "FitSettings | Wanted":
    """Return how to fit, or what not to choose."""
    from piezod.experiment.fit.automatic import Wanted
    from piezod.experiment.fit.fit import FitSettings

    if method is MethodOption.AUTO:
        return Wanted(order=order, spacing=thresholds, creep=creep)
    if method is MethodOption.LMS and creep:
        message = "creep is fitted by least squares, not by lms"
        raise typer.BadParameter(message, param_hint="'--creep'")
    usual = Spacing.EVEN if method is MethodOption.LMS else Spacing.GRADED
    return FitSettings(
        method=Method(method.value),
        order=order or DEFAULT_ORDER,
        spacing=thresholds or usual,
        creep=bool(creep),
    )


def _delay(text: str) -> float | None:
    """Return the delay in s, None for one that is to be estimated."""
    if text == "auto":
        return None
    try:
        delay_s = float(text)
    except ValueError:
        delay_s = -1.0
    if not 0.0 <= delay_s <= LONGEST_DELAY_S:
        message = f"must be auto, or a time from 0 to {LONGEST_DELAY_S:g} s (got {text})"
        raise typer.BadParameter(message, param_hint="'--delay-s'")
    return delay_s


def _write(fitted: "FileFit", out: Path, now: datetime) -> Path:
    from piezod.experiment.fit.outputs import write_model

    return write_model(out, fitted, now)
