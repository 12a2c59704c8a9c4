"""`piezod experiment`: run an experiment file, write a report with errors, figures and data."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.options import JsonOption, VectorOption
from piezod.cli.paths import existing_file
from piezod.cli.stage_options import SocketOption, StageOption, check_live, connect

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


def experiment(  # noqa: PLR0913, PLR0917 - each argument is an option
    file: FileArgument,
    out: OutOption = None,
    seed: SeedOption = None,
    live: LiveOption = False,
    largest_step_pct: LargestStepOption = None,
    tables: TablesOption = None,
    vector: VectorOption = False,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Run an experiment in virtual time and write a report.

    With --live it runs in real time on a running stage, which is disarmed at the end. An experiment
    with `play` learns tables that the device plays with its own clock.

    Prints the errors of each case in each mode in % of the displacement range, the origin of the
    model, the warnings, and the path of the report.
    """
    needs_live = {"--stage": stage, "--socket": socket, "--largest-step-pct": largest_step_pct}
    check_live(live=live, seed=seed, only_live=needs_live)
    # numba, scipy and matplotlib take long to import.
    from piezod.cli.experiment.run import Choices, run

    on = (lambda: connect(stage, socket)) if live else None
    run(file, out, Choices(seed, largest_step_pct, tables, on, vector), json=json)
