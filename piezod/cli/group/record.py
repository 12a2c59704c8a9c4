"""`piezod group record`: recordings of several stages with one time."""

from typing import Annotated

import typer

from piezod.cli.group.options import (
    GroupArgument,
    GroupsOption,
    StartInOption,
    print_answers,
)
from piezod.cli.options import JsonOption
from piezod.client import StageGroup


def start(
    name: GroupArgument,
    label: Annotated[
        str | None, typer.Argument(metavar="[LABEL]", help="Becomes part of the files' names.")
    ] = None,
    start_in: StartInOption = 1.0,
    groups: GroupsOption = None,
    json: JsonOption = False,
) -> None:
    """Start a recording of each stage; time 0 of all files is the same instant.

    If one stage refuses, the recordings that were started for it are ended again.
    """
    with StageGroup(name, file=groups) as group:
        started = group.start_recording(label, start_in_s=start_in)
    print_answers(started, lambda each: f"recording {each.name}", json=json)


def stop(name: GroupArgument, groups: GroupsOption = None, json: JsonOption = False) -> None:
    """End the recording of each stage."""
    with StageGroup(name, file=groups) as group:
        ended = group.stop_recording()
    print_answers(ended, lambda each: f"recorded {each.records} cycles as {each.name}", json=json)
