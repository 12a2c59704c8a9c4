"""Arguments and options that several commands share."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.paths import existing_file

JsonOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")
]
JsonLinesOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON document per line of stdout.")
]
VectorOption: TypeAlias = Annotated[
    bool, typer.Option("--vector", help="Write the figures as SVG and PDF, too, for publications.")
]
ConfigArgument: TypeAlias = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        help="Configuration of the stage, YAML.",
        readable=False,  # `existing_file` checks it, and a missing permission exits with 77
        callback=existing_file,
    ),
]
