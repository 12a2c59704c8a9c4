"""`piezod check`: the kind of a file, and all its problems."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.experiment.processor_warnings import processor_warnings
from piezod.cli.options import JsonOption
from piezod.cli.output import new_console, print_json, print_warnings
from piezod.cli.paths import existing_file


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
    if checked.kind is FileKind.STAGE and not checked.error:
        warnings += processor_warnings(file)
    if json:
        problems = checked.error.problems if checked.error else ()
        print_json(
            {
                "file": str(file),
                "kind": checked.kind,
                "ok": not problems,
                "problems": [problem._asdict() for problem in problems],
                "warnings": warnings,
                "margins": checked.margins,
            }
        )
    if checked.error:
        raise checked.error
    if not json:
        console = new_console()
        console.print(f"{file}: ok, {checked.contents}", soft_wrap=True)
        for margins in checked.margins:
            console.print(margins, soft_wrap=True)
        print_warnings(console, warnings)
