"""`piezod experiment`: an experiment file becomes a table of errors, figures and data."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable, existing_file
from piezod.cli.stage_options import SocketOption, StageOption, connect

if TYPE_CHECKING:
    from collections.abc import Callable
    from contextlib import AbstractContextManager

    from piezod.client import StageClient
    from piezod.config.experiment import ExperimentConfig
    from piezod.records.recording import ExperimentResult


def experiment(  # noqa: PLR0913, PLR0917 - typer reads options off the signature
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="Experiment, YAML.", readable=False, callback=existing_file
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            readable=False,
            help="Folder for report, figures and data; FILE's name with -results, in the current "
            "folder, if not given. What an earlier run left in it is replaced.",
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, max=2**32 - 1, help="Use this seed and not the file's."),
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live",
            help="Run its cases on a running stage, with that one's devices, axes, rate and model.",
        ),
    ] = False,
    largest_step_pct: Annotated[
        float | None,
        typer.Option(
            metavar="PCT",
            min=0.001,
            max=100.0,
            help="With --live: slow the commands down until a cycle of the loop moves at most this "
            "part of their range, %: for a slow bus.",
        ),
    ] = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Run an experiment in virtual time and write a report.

    With --live, its cases are run on a running stage, which is disarmed at the end.

    Prints the errors of each case in each mode, in % of the displacement's range, which method made
    the model, what to beware of, and where the report is.
    """
    from piezod.cli.experiment_view import as_document, print_result
    from piezod.cli.output import new_console, print_json
    from piezod.cli.progress import progress_bar
    from piezod.config.experiment import load_experiment
    from piezod.devices import registry
    from piezod.experiment.outputs import write_outputs
    from piezod.experiment.reference import reference_of
    from piezod.experiment.virtual.run import run_experiment

    if live and seed is not None:
        raise typer.BadParameter("a running stage has none to give", param_hint="'--seed'")
    if not live and (stage or socket or largest_step_pct):
        raise typer.BadParameter("--stage, --socket and --largest-step-pct need --live")
    config = load_experiment(file, registry)
    if seed is not None:
        config = config.model_copy(update={"seed": seed})
    folder = out or Path(f"{file.stem}-results")
    folder.mkdir(parents=True, exist_ok=True)  # before the run: to learn it after would be a pity
    check_writable(folder)
    with progress_bar() as progress:
        text = file.read_text(encoding="utf-8-sig")
        what = config, text, config.title or file.stem
        if live:
            result = _run_live(*what, largest_step_pct, connect(stage, socket), progress)
        else:
            result = run_experiment(*what, progress)
        progress("writing the report", 1.0)
        reference = reference_of(config)
        report = write_outputs(folder, result, reference)
    if json:
        print_json(as_document(result, report))
    else:
        print_result(new_console(), result, reference, report)


def _run_live(
    config: "ExperimentConfig",
    text: str,
    title: str,
    largest_step_pct: float | None,
    connection: "AbstractContextManager[StageClient]",
    progress: "Callable[[str, float], None]",
) -> "ExperimentResult":
    from piezod.experiment.live.run import run_live

    with connection as client:
        return run_live(config, text, title, client, progress, largest_step_pct)
