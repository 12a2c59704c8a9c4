"""The work of `piezod experiment`."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import NamedTuple, TypeAlias

import typer

from piezod.cli.experiment.plays import run_play
from piezod.cli.experiment.view import as_document, print_result
from piezod.cli.interrupt import unwinding
from piezod.cli.output import new_console, print_json
from piezod.cli.paths import check_writable
from piezod.cli.progress import progress_bar
from piezod.client import StageClient
from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.devices import registry
from piezod.experiment.live.run import run_live
from piezod.experiment.outputs import write_outputs
from piezod.experiment.reference import reference_of
from piezod.experiment.virtual.run import run_experiment
from piezod.records.new_name import new_folder

Connection: TypeAlias = AbstractContextManager[StageClient]


class Choices(NamedTuple):
    """What the command line says about a run."""

    seed: int | None  #: Seed; None for that of the file.
    largest_step_pct: float | None  #: Largest motion per cycle, in % of the range; None for any.
    tables: Path | None  #: Folder of learned tables to begin with; None for none.
    connect: Callable[[], Connection] | None  #: Connects to a stage; None in virtual time.
    vector: bool = False  #: Whether figures are written as SVG and PDF, too.


def run(file: Path, out: Path | None, chosen: Choices, *, json: bool) -> None:
    """Run an experiment, write its outputs, and print the result.

    Args:
        file: The experiment file.
        out: Folder for the outputs; None for the default.
        chosen: What the command line says about the run.
        json: Whether one JSON document is printed.
    """
    config = load_experiment(file, registry)
    _check_play(config, chosen)
    if chosen.seed is not None:
        config = config.model_copy(update={"seed": chosen.seed})
    live = chosen.connect is not None
    with _folder(out or Path(f"{file.stem}-results"), live=live) as folder:
        if config.play is not None:
            on = chosen.connect() if chosen.connect else None
            run_play(config, config.play, folder, chosen.tables, on, json=json)
            return
        with progress_bar() as progress:
            text = file.read_text(encoding="utf-8-sig")
            what = config, text, config.title or file.stem
            if chosen.connect:
                with unwinding(), chosen.connect() as client:
                    result = run_live(*what, client, progress, chosen.largest_step_pct)
            else:
                result = run_experiment(*what, progress)
            progress("writing the report", 1.0)
            reference = reference_of(config)
            report = write_outputs(folder, result, reference, vector=chosen.vector)
    if json:
        print_json(as_document(result, report))
    else:
        print_result(new_console(), result, reference, report)


def _check_play(config: ExperimentConfig, chosen: Choices) -> None:
    """Refuse options that do not fit the kind of the experiment."""
    if config.scan is not None:
        raise typer.BadParameter("has `scan:`, which `piezod scan` runs", param_hint="FILE")
    if config.play is not None and chosen.largest_step_pct is not None:
        message = "not with `play`: the loop does not make the steps of a table"
        raise typer.BadParameter(message, param_hint="'--largest-step-pct'")
    if config.play is not None and chosen.vector:
        raise typer.BadParameter("not with `play`", param_hint="'--vector'")
    if config.play is None and chosen.tables is not None:
        message = "only with an experiment that has `play`"
        raise typer.BadParameter(message, param_hint="'--tables'")


@contextmanager
def _folder(wanted: Path, *, live: bool) -> Iterator[Path]:
    """Make the folder before the run, which may take minutes; what was measured is not replaced."""
    if not live:
        wanted.mkdir(parents=True, exist_ok=True)
    with new_folder(wanted) if live else nullcontext(wanted) as folder:
        check_writable(folder)
        yield folder
