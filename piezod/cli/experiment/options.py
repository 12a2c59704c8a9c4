"""Arguments and options of `piezod experiment`, and their checks."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.paths import existing_file

FileArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="FILE", help="Experiment, YAML.", readable=False, callback=existing_file
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        readable=False,
        help="Folder for report, figures and data; the results of an earlier run in it are "
        "replaced, but with --live an existing folder is left alone, and the name gets a number. "
        "Default: the name of FILE with -results, in the current folder.",
    ),
]
SeedOption: TypeAlias = Annotated[
    int | None,
    typer.Option(min=0, max=2**32 - 1, metavar="N", help="Seed, in place of that of the file."),
]
LiveOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--live",
        help="Run the experiment on a running stage, with its devices, axes, rate and model.",
    ),
]
LargestStepOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        metavar="PCT",
        min=0.001,
        max=100.0,
        help="With --live, for a slow bus: slow the commands down until the motion per cycle of "
        "the loop is at most this share of their range, in %.",
    ),
]
TablesOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        exists=True,
        file_okay=False,
        readable=False,
        help="With `play`: begin with the learned tables in this folder, where waveform, rate, "
        "model and device are the same.",
    ),
]


def check_usage(*, live: bool, seed: int | None, only_live: tuple[object, ...]) -> None:
    """Refuse options that exclude each other.

    Args:
        live: Whether the cases run on a running stage.
        seed: Value of `--seed`; None if not given.
        only_live: Values of the options that need `--live`; false if not given.

    Raises:
        typer.BadParameter: If options exclude each other.
    """
    if live and seed is not None:
        message = "not with --live: a running stage has its own seed"
        raise typer.BadParameter(message, param_hint="'--seed'")
    if not live and any(only_live):
        raise typer.BadParameter("--stage, --socket and --largest-step-pct need --live")


def check_play(*, plays: bool, largest_step_pct: float | None, tables: Path | None) -> None:
    """Refuse options that do not fit the kind of the experiment.

    Args:
        plays: Whether it has `play`.
        largest_step_pct: Value of `--largest-step-pct`; None if not given.
        tables: Value of `--tables`; None if not given.

    Raises:
        typer.BadParameter: If they do not fit.
    """
    if plays and largest_step_pct is not None:
        message = "not with `play`: the loop does not make the steps of a table"
        raise typer.BadParameter(message, param_hint="'--largest-step-pct'")
    if tables is not None and not plays:
        message = "only with an experiment that has `play`"
        raise typer.BadParameter(message, param_hint="'--tables'")
