"""`piezod watch`: telemetry of a stage."""

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
    """Print updates until Ctrl-C: a table on a terminal, otherwise one line each."""
    axes = [axis] if axis else []
    with connect(stage, socket) as client:
        try:
            if json:
                _print_lines(client, rate, axes)
            else:
                _show(client, rate, axes)
        except Interrupted:
            return  # Ctrl-C is the normal end


def _print_lines(client: "StageClient", rate_hz: float, axes: list[str]) -> None:
    from piezod.cli.output import print_json_line

    for interval in client.telemetry(rate_hz, axes):
        print_json_line(interval.document)


def _show(client: "StageClient", rate_hz: float, axes: list[str]) -> None:
    from rich.live import Live

    from piezod.cli.output import new_console
    from piezod.cli.watch_view import LoopRate, ranges_of, view, view_line

    console = new_console()
    if console.is_terminal:
        ranges, loop_rate = ranges_of(client.config()), LoopRate()
        with Live(console=console, auto_refresh=False) as live:
            for interval in client.telemetry(rate_hz, axes):
                live.update(view(interval, ranges, loop_rate.hz(interval)), refresh=True)
    else:
        for interval in client.telemetry(rate_hz, axes):
            console.print(view_line(interval), soft_wrap=True)
