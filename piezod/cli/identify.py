"""`piezod identify`: recorded data becomes a model."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable, existing_file
from piezod.experiment.method import Method

if TYPE_CHECKING:
    from piezod.experiment.identify_file import FileFit

LONGEST_DELAY_S = 1.0
"""What a model file can hold."""


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
        float, typer.Option(min=0, metavar="S", help="Leave out the first seconds of each file.")
    ] = 0.0,
    delay_s: Annotated[
        str,
        typer.Option(
            metavar="auto|S",
            help="How long the displacement lags behind the drive, in s; auto: estimate it.",
        ),
    ] = "auto",
    method: Annotated[
        Method, typer.Option(help="How to find the weights: the paper's, or all at once.")
    ] = Method.LEAST_SQUARES,
    order: Annotated[
        int, typer.Option(min=1, max=200, metavar="M", help="Operators on each side.")
    ] = 19,
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
    range of the voltage. The delay from drive to displacement is where that error is least, unless
    --delay-s gives it; a record of one frequency determines it only to about a sample.
    The fit has no dead-band; the one of an experiment has its compensator's.
    """
    from piezod.cli.identify_view import as_document, print_fit
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
        method=method,
        order=order,
    )
    plot = _write(fitted, out) if out else None
    if json:
        print_json(as_document(fitted, out, plot))
    else:
        print_fit(new_console(), fitted, out, plot)


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
