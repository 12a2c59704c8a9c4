"""The choice of the stage, and other parts that verbs for a running stage share."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.output import print_one
from piezod.client import StageClient
from piezod.client.places import running_stages
from piezod.errors import PiezodError
from piezod.messages.documents import Message


def _stages(incomplete: str) -> list[str]:
    return [name for name in running_stages() if name.startswith(incomplete)]


def completion(
    names: Callable[[StageClient], Iterable[str]],
) -> Callable[[typer.Context, str], list[str]]:
    """Return a function that completes a word with names of a stage."""

    def complete(context: typer.Context, incomplete: str) -> list[str]:
        try:
            with connect(context.params.get("stage"), context.params.get("socket")) as client:
                return [name for name in names(client) if name.startswith(incomplete)]
        except PiezodError:
            return []  # the shell would take an error text for a completion

    return complete


axis_names = completion(lambda client: client.status().axes)
"""Completes the name of an axis."""

StageOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--stage",
        metavar="NAME",
        autocompletion=_stages,
        help="Stage: the name of its configuration file without the ending, or its address at "
        "`piezod web` of another machine, as https://labpc:8080/stages/NAME. Default: "
        "$PIEZOD_STAGE, or the only stage that runs.",
    ),
]
SocketOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--socket",
        metavar="PATH",
        help="Socket of the daemon, in place of a name. Default: $PIEZOD_SOCKET.",
    ),
]
AxisOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--axis", metavar="NAME", autocompletion=axis_names, help="Axis; default: the only one."
    ),
]
AxesOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--axis", metavar="NAME", autocompletion=axis_names, help="Axis; default: all axes."
    ),
]


def connect(stage: str | None, socket: Path | None) -> StageClient:
    """Return a client of the chosen stage, with the name in `PIEZOD_CLIENT`.

    Raises:
        typer.BadParameter: If both a name and a socket are given.
        ClientError: If the stage does not run.
    """
    if stage is not None and socket is not None:
        raise typer.BadParameter("--stage and --socket exclude each other")
    return StageClient(stage, socket=socket, name=os.environ.get("PIEZOD_CLIENT", ""))


def print_answer(answer: Message, text: str, *, json: bool) -> None:
    """Print the answer to a request, or in place of it a text for people."""
    print_one(answer.document, text, json=json)


def check_live(*, live: bool, seed: int | None, only_live: Mapping[str, object]) -> None:
    """Refuse options that exclude each other.

    Args:
        live: Whether a running stage is used.
        seed: The seed; None if it was not given.
        only_live: Options that need one, by name; false if not given.
    """
    if live and seed is not None:
        message = "not with --live: a running stage has its own seed"
        raise typer.BadParameter(message, param_hint="'--seed'")
    if not live and any(only_live.values()):
        *names, last = only_live
        raise typer.BadParameter(f"{', '.join(names)} and {last} need --live")
