"""The choice of a group, and other parts that verbs for a group share."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from piezod.cli.output import new_console, print_json
from piezod.cli.paths import existing_file
from piezod.messages.documents import Message

GroupArgument: TypeAlias = Annotated[
    str, typer.Argument(metavar="GROUP", help="Name of a group in the file of the groups.")
]
GroupsOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        readable=False,
        callback=existing_file,
        help="File of the groups. Default: $PIEZOD_GROUPS, ~/.config/piezod/groups.yaml if it "
        "exists, or /etc/piezod/groups.yaml.",
    ),
]
StartInOption: TypeAlias = Annotated[
    float,
    typer.Option(
        "--start-in", metavar="S", min=0.0, max=30.0, help="Time until the common start, s."
    ),
]


def print_answers(
    answers: Mapping[str, Message], done: Callable[[Any], str], *, json: bool
) -> None:
    """Print a line for each stage, or one document with all answers.

    Args:
        answers: Answers of the stages, by name.
        done: Returns what an answer says, for people.
        json: Whether to print the answers in place of the lines.
    """
    if json:
        print_json({"stages": {stage: each.document for stage, each in answers.items()}})
        return
    console = new_console()
    for stage, answer in answers.items():
        console.print(f"{stage}: {done(answer)}", soft_wrap=True)
