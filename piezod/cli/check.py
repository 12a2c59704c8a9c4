"""`piezod check`: whether a file can be used, and all that is wrong with it."""

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
            help="Experiment or model, YAML.",
            readable=False,
            callback=existing_file,
        ),
    ],
    json: JsonOption = False,
) -> None:
    """Validate a stage, an experiment or a model file.

    Says what it is, or prints every problem on stderr, `file:line:column: path: what is wrong`, and
    exits with 78. With --json the document on stdout lists the problems too.
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
            }
        )
    if checked.error:
        raise checked.error
    if not json:
        new_console().print(f"{file}: ok, {checked.contents}", soft_wrap=True)
