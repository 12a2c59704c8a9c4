"""`piezod identify`: recorded data becomes a model."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable, existing_file
from piezod.experiment.method import Method, Spacing

if TYPE_CHECKING:
    from piezod.experiment.automatic import Wanted
    from piezod.experiment.fit import FitSettings
    from piezod.experiment.identify_file import FileFit

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
        Path,
        typer.Argument(
            metavar="DATA.csv",
            help="Columns t_s, drive_v, position_um, evenly in time.",
            readable=False,
            callback=existing_file,
        ),
    ],
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
            "figure of data and model (.png). Nothing is written without it.",
        ),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Fit the inverse model to recorded data.

    Prints the error of the drive voltage that the model predicts from the displacement, in % of the
    range of the voltage: on the record, on contiguous blocks of it that were held out, and on
    another record. The delay from drive to displacement is where that error is least, unless
    --delay-s gives it; a record of one frequency determines it only to about a sample.
    """
    from piezod.cli.identify_document import as_document
    from piezod.cli.identify_view import print_fit
    from piezod.cli.output import new_console, print_json
    from piezod.experiment.identify_file import identify_file

    if out is not None and out.suffix not in (".yaml", ".yml"):
        raise typer.BadParameter(f"must end in .yaml (got {out})", param_hint="'--out'")
    if out is not None and out.parent.is_dir():
        check_writable(out.parent)
    fitted = identify_file(
        data,
        test=test,
        skip_s=skip_s,
        delay_s=_delay(delay_s),
        settings=_settings(method, order, thresholds, creep),
    )
    plot = _write(fitted, out) if out else None
    if json:
        print_json(as_document(fitted, out, plot))
    else:
        print_fit(new_console(), fitted, out, plot)


def _settings(
    method: MethodOption, order: int | None, thresholds: Spacing | None, creep: bool | None
) -> "FitSettings | Wanted":
    """Return how to fit, or what not to choose."""
    from piezod.experiment.automatic import Wanted
    from piezod.experiment.fit import FitSettings

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


def _write(fitted: "FileFit", out: Path) -> Path:
    from datetime import UTC, datetime

    from piezod.experiment.model_outputs import write_model

    return write_model(out, fitted, datetime.now(UTC))
