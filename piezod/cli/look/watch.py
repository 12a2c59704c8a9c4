"""`piezod watch`: telemetry of a stage."""

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.console import Console, RenderableType
from rich.live import Live

from piezod.cli.interrupt import Interrupted
from piezod.cli.look.watch_view import WatchView, ranges_of, view_line
from piezod.cli.options import JsonLinesOption
from piezod.cli.output import new_console, print_json_line
from piezod.cli.stage_options import AxesOption, SocketOption, StageOption, connect
from piezod.client import StageClient
from piezod.errors import ClientError
from piezod.messages.answers import Fault


def watch(
    rate: Annotated[
        float, typer.Option(metavar="HZ", min=1.0, max=50.0, help="Updates per second.")
    ] = 10.0,
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonLinesOption = False,
) -> None:
    """Show updates until Ctrl-C: in place on a terminal, otherwise one line each."""
    axes = [axis] if axis else []
    with connect(stage, socket) as client:
        try:
            if json:
                _print_lines(client, rate, axes)
            else:
                _show(client, rate, axes)
        except Interrupted:
            return  # Ctrl-C is the normal end


def _print_lines(client: StageClient, rate_hz: float, axes: list[str]) -> None:
    for interval in client.telemetry(rate_hz, axes):
        print_json_line(interval.document)


def _show(client: StageClient, rate_hz: float, axes: list[str]) -> None:
    console = new_console()
    if console.is_terminal and not console.is_dumb_terminal:
        _show_in_place(client, console, rate_hz, axes)
    else:
        ranges = ranges_of(client.config())
        for interval in client.telemetry(rate_hz, axes):
            console.print(view_line(interval, ranges), soft_wrap=True)


def _show_in_place(client: StageClient, console: Console, rate_hz: float, axes: list[str]) -> None:
    view, known = WatchView(client.place.stage, ranges_of(client.config())), _Faults(client)
    shown: RenderableType = ""
    try:
        # On a screen of its own: when the terminal changes its size, nothing of the old view stays.
        with Live(console=console, auto_refresh=False, screen=True) as live:
            for interval in client.telemetry(rate_hz, axes):
                shown = view.update(interval, known.of(interval.faults))
                live.update(shown, refresh=True)
    finally:
        console.print(shown)  # the last view stays


class _Faults:
    """The faults with their remedies, which are asked for when other faults appear."""

    def __init__(self, client: StageClient) -> None:
        self._client = client
        self._ids: Sequence[str] = ()  # of the last interval
        self._found: Sequence[Fault] = ()

    def of(self, ids: Sequence[str]) -> Sequence[Fault]:
        """Return the faults of an interval, as far as they are known."""
        if ids != self._ids:
            try:
                self._ids, self._found = ids, self._client.faults().faults
            except ClientError:
                self._found = ()  # their ids are shown; the telemetry reports a daemon that is gone
        return self._found
