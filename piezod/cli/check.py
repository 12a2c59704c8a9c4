"""`piezod check`: the kind of a file, and all its problems."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file


def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Configuration of a stage, experiment, model or response, YAML.",
            readable=False,
            callback=existing_file,
        ),
    ],
    json: JsonOption = False,
) -> None:
    """Validate the configuration of a stage, an experiment, a model or a response file.

    Prints the kind of the file, or every problem on stderr as `file:line:column: path: problem`,
    and then exits with 78. With --json the document on stdout lists the problems too.
    """
    from piezod.cli.output import new_console, print_json
    from piezod.experiment.check_file import check_file

    checked = check_file(file)
    if json:
        problems = checked.error.problems if checked.error else ()
        print_json(
            {
                "file": str(file),
                "kind": checked.kind,
                "ok": not problems,
                "problems": [problem._asdict() for problem in problems],
                "warnings": checked.warnings,
            }
        )
    if checked.error:
        raise checked.error
    if not json:
        console = new_console()
        console.print(f"{file}: ok, {checked.contents}", soft_wrap=True)
        for warning in checked.warnings:
            console.print(f"! {warning}", style="yellow")
