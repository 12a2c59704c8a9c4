"""Verbs that choose how a stage is driven, or tell it what it cannot know by itself."""

from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.stage_options import AxesOption, SocketOption, StageOption, connect, tell
from piezod.config.modes import Mode


def mode(
    name: Annotated[Mode, typer.Argument(metavar="MODE", help=f"One of {', '.join(Mode)}.")],
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Choose how the drive is made from the command."""
    with connect(stage, socket) as client:
        answer = client.mode(name, axis=axis)
    tell(answer, f"mode {name}", json=json)


def condition(
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Drive a swing that makes the hysteresis' memory known."""
    with connect(stage, socket) as client:
        answer = client.condition(axis=axis)
    tell(answer, "conditioning; `piezod status` tells READY when it is over", json=json)


def zero(
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonOption = False,
) -> None:
    """Call the displacement at the rest voltage zero."""
    with connect(stage, socket) as client:
        answer = client.zero(axis=axis)
    tell(answer, "the displacement at the rest voltage is zero from now on", json=json)
