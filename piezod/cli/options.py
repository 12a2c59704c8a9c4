"""Options of several verbs."""

from typing import Annotated, TypeAlias

import typer

JsonOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on stdout and nothing else.")
]
JsonLinesOption: TypeAlias = Annotated[
    bool, typer.Option("--json", help="Print one JSON document per line of stdout.")
]
