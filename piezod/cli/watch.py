"""`piezod watch`: a stage as it moves."""

from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.interrupt import Interrupted
from piezod.cli.options import JsonLinesOption
from piezod.cli.stage_options import AxesOption, SocketOption, StageOption, connect

if TYPE_CHECKING:
    from piezod.client import StageClient


def watch(
    rate: Annotated[
        float, typer.Option(metavar="HZ", min=1.0, max=50.0, help="Updates per second.")
    ] = 10.0,
    axis: AxesOption = None,
    stage: StageOption = None,
    socket: SocketOption = None,
    json: JsonLinesOption = False,
) -> None:
    """Show what the stage does, until Ctrl-C.

    Between two updates no spike is lost: the worst error of all cycles is shown. With --json, and
    where stdout is no terminal, each update is one line.
    """
    axes = [axis] if axis else []
    with connect(stage, socket) as client:
        try:
            if json:
                _print_lines(client, rate, axes)
            else:
                _show(client, rate, axes)
        except Interrupted:
            return  # this is how watching ends


def _print_lines(client: "StageClient", rate_hz: float, axes: list[str]) -> None:
    from piezod.cli.output import print_json_line

    for told in client.telemetry(rate_hz, axes):
        print_json_line(told.document)


def _show(client: "StageClient", rate_hz: float, axes: list[str]) -> None:
    from rich.live import Live

    from piezod.cli.output import new_console
    from piezod.cli.watch_view import LoopRate, ranges_of, view, view_line

    console = new_console()
    if console.is_terminal:
        ranges, loop_rate = ranges_of(client.config()), LoopRate()
        with Live(console=console, auto_refresh=False) as live:
            for told in client.telemetry(rate_hz, axes):
                live.update(view(told, ranges, loop_rate.hz(told)), refresh=True)
    else:
        for told in client.telemetry(rate_hz, axes):
            console.print(view_line(told), soft_wrap=True)
