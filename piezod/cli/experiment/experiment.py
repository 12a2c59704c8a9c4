"""`piezod experiment`: run an experiment file, write a report with errors, figures and data."""

from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from piezod.cli.experiment.options import (
    FileArgument,
    LargestStepOption,
    LiveOption,
    OutOption,
    SeedOption,
    TablesOption,
    check_play,
    check_usage,
)
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.paths import check_writable
from piezod.cli.stage_options import SocketOption, StageOption, connect

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    from piezod.client import StageClient
    from piezod.config.experiment import ExperimentConfig
    from piezod.records.recording import ExperimentResult


def experiment(  # noqa: PLR0913, PLR0917 - each argument is an option
    file: FileArgument,
    out: OutOption = None,
    seed: SeedOption = None,
    live: LiveOption = False,
    largest_step_pct: LargestStepOption = None,
    tables: TablesOption = None,
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
    from piezod.cli.experiment.view import as_document, print_result
    from piezod.cli.output import new_console, print_json
    from piezod.cli.progress import progress_bar
    from piezod.config.experiment import load_experiment
    from piezod.devices import registry
    from piezod.experiment.outputs import write_outputs
    from piezod.experiment.reference import reference_of
    from piezod.experiment.virtual.run import run_experiment

    check_usage(live=live, seed=seed, only_live=(stage, socket, largest_step_pct))
    config = load_experiment(file, registry)
    check_play(plays=config.play is not None, largest_step_pct=largest_step_pct, tables=tables)
    if seed is not None:
        config = config.model_copy(update={"seed": seed})
    with _folder(out or Path(f"{file.stem}-results"), live=live) as folder:
        if config.play is not None:
            from piezod.cli.experiment.plays import run_play

            on = connect(stage, socket) if live else None
            run_play(config, config.play, folder, tables, on, json=json)
            return
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


@contextmanager
def _folder(wanted: Path, *, live: bool) -> "Iterator[Path]":
    """Make the folder before the run, which may take minutes; what was measured is not replaced."""
    from piezod.records.new_name import new_folder

    if not live:
        wanted.mkdir(parents=True, exist_ok=True)
    with new_folder(wanted) if live else nullcontext(wanted) as folder:
        check_writable(folder)
        yield folder


def _run_live(
    config: "ExperimentConfig",
    text: str,
    title: str,
    largest_step_pct: float | None,
    connection: "AbstractContextManager[StageClient]",
    progress: "Callable[[str, float], None]",
) -> "ExperimentResult":
    from piezod.experiment.live.run import run_live

    with unwinding(), connection as client:
        return run_live(config, text, title, client, progress, largest_step_pct)
