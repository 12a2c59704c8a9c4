"""`piezod check`: the kind of a file, and all its problems."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.experiment.machine_view import print_machine
from piezod.cli.experiment.processor_warnings import processor_warnings
from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json, print_warnings
from piezod.cli.paths import existing_file

if TYPE_CHECKING:
    from piezod.daemon.loop.machine import Machine


def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Configuration of a stage, experiment, model, response or groups, YAML.",
            readable=False,
            callback=existing_file,
        ),
    ],
    machine: Annotated[
        bool,
        typer.Option(
            "--machine",
            help="Also measure for 5 s how the loop of this stage runs on this machine, without "
            "its devices, and propose the highest rate.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Validate the configuration of a stage, an experiment, a model, response or groups file.

    Prints the kind of the file, and the margins of each trim whose axis has a response. Otherwise
    prints every problem on stderr as `file:line:column: path: problem` and exits with 78. With
    --json the document on stdout lists the problems too.
    """
    # The checks of a trim and of a model take long to import.
    from piezod.experiment.check_file import FileKind, check_file

    checked = check_file(file)
    warnings = list(checked.warnings)
    if machine and checked.kind is not FileKind.STAGE:
        raise typer.BadParameter("FILE is not the configuration of a stage", param_hint="--machine")
    if checked.kind is FileKind.STAGE and not checked.error:
        warnings += processor_warnings(file)
    measured = _measured(file) if machine and not checked.error else None
    if json:
        problems = checked.error.problems if checked.error else ()
        found = {"machine": measured._asdict()} if measured else {}
        print_json(
            {
                "file": str(file),
                "kind": checked.kind,
                "ok": not problems,
                "problems": [problem._asdict() for problem in problems],
                "warnings": warnings,
                "margins": checked.margins,
                **found,
            }
        )
    if checked.error:
        raise checked.error
    if not json:
        console = new_console()
        console.print(f"{file}: ok, {checked.contents}", soft_wrap=True)
        for margins in checked.margins:
            console.print(margins, soft_wrap=True)
        if measured is not None:
            print_machine(console, measured)
        print_warnings(console, warnings)


def _measured(file: Path) -> "Machine":
    from piezod.config.daemon import load_daemon
    from piezod.daemon.loop.machine import measure_machine
    from piezod.devices import registry

    return measure_machine(load_daemon(file, registry))
