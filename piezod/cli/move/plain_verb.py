"""Verbs that send one request and print that it is accepted; the table of commands makes them."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import typer

from piezod.cli.move.outcome import outcome
from piezod.cli.options import JsonOption
from piezod.cli.stage_options import AxesOption, SocketOption, StageOption, connect, print_answer
from piezod.client import calls
from piezod.errors import UnreachableError
from piezod.messages.requests import REQUESTS, TABLE

_BY_SIGNAL: Final = ("stop", "estop")
"""Verbs that a daemon without its sockets carries out at a signal."""
_POLL_S: Final = 0.1


def plain_verb(verb: str) -> Callable[..., None]:
    """Return the function of a verb that sends the request of its name."""

    def send(stage: str | None, socket: Path | None, json: bool, **fields: object) -> None:
        try:
            with connect(stage, socket) as client:
                answer = client.call(calls.command(verb, **fields))
        except UnreachableError as error:
            if verb not in _BY_SIGNAL:
                raise
            _end_by_signal(error)
            return
        print_answer(answer, outcome(verb, TABLE[verb].done, answer.state), json=json)

    def for_stage(
        stage: StageOption = None, socket: SocketOption = None, json: JsonOption = False
    ) -> None:
        send(stage, socket, json)

    def for_axes(
        axis: AxesOption = None,
        stage: StageOption = None,
        socket: SocketOption = None,
        json: JsonOption = False,
    ) -> None:
        send(stage, socket, json, axis=axis)

    return for_axes if "axis" in REQUESTS[verb].model_fields else for_stage


def _end_by_signal(error: UnreachableError) -> None:
    """Let a daemon ramp down and end by SIGTERM; return when it has ended."""
    os.kill(error.pid, signal.SIGTERM)
    typer.echo(f"{error.what}: SIGTERM was sent to it; it ramps down and ends", err=True)
    while Path(f"/proc/{error.pid}").exists():
        time.sleep(_POLL_S)
    typer.echo(f"process {error.pid} has ended; its log says at which voltage")
