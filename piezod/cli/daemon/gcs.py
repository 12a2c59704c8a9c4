"""`piezod gcs`: the running stage as a PI GCS 2 controller."""

from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.daemon.limited_report import LimitedReport
from piezod.cli.stage_options import SocketOption, StageOption
from piezod.client.places import find_socket
from piezod.config.modes import Mode
from piezod.gcs.server import GcsPlan, serve


def gcs(
    port: Annotated[
        int, typer.Option(metavar="N", min=0, max=65535, help="TCP port; 0 for any free one.")
    ] = 50000,
    pty: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Also make a serial port (pty) at PATH.")
    ] = None,
    mode: Annotated[
        Mode, typer.Option(help="Mode that `SVO 1` selects: the closed loop of the client.")
    ] = Mode.TRIMMED,
    allow: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ADDRESS",
            help="IPv4 address of another computer that may connect; may be repeated. Default: "
            "this computer only. GCS has no password.",
        ),
    ] = None,
    like: Annotated[
        str,
        typer.Option(
            metavar="MODEL",
            help="Model to name in the identity, as E-754, for clients that look for one.",
        ),
    ] = "",
    stage: StageOption = None,
    socket: SocketOption = None,
) -> None:
    """Serve the running stage as a PI GCS 2 controller until Ctrl-C.

    Programs for such controllers, for example Micro-Manager or pylablib, then move the stage. They
    act as the user of this command. Refusals are printed with their reasons on stderr.
    """
    if stage is not None and socket is not None:
        raise typer.BadParameter("--stage and --socket exclude each other")
    try:
        allowed = [IPv4Address(text) for text in allow or ()]
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--allow") from error
    plan = GcsPlan(socket or find_socket(stage), mode, port, allowed, pty, like)
    serve(plan, announce=typer.echo, report=LimitedReport())
