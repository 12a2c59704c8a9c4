"""`piezod ioc`: the running stages as EPICS records."""

from ipaddress import IPv4Address
from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.daemon.limited_report import LimitedReport
from piezod.client.places import find_socket, running_stages
from piezod.errors import NotRunningError
from piezod.ioc.server import IocPlan, serve, write_lists


def ioc(
    stage: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Stage; may be repeated. Default: all stages that run."),
    ] = None,
    prefix: Annotated[
        str,
        typer.Option(
            metavar="TEXT",
            help="Begin of the names of all records; {stage} stands for the name of the stage.",
        ),
    ] = "{stage}:",
    control: Annotated[
        bool, typer.Option("--control", help="Clients may write. Default: they only read.")
    ] = False,
    interface: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ADDRESS",
            help="IPv4 address of this computer to listen on; may be repeated. Default: this "
            "computer only. EPICS has no password.",
        ),
    ] = None,
    write: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write lists for archiver and autosave and a screen for Phoebus into a folder, "
            "and end.",
        ),
    ] = None,
) -> None:
    """Serve the running stages as EPICS records (CA and PVA) until Ctrl-C.

    Screens, archivers and scans for EPICS then work: each axis has a record with the fields of a
    motor record. Clients act as the user of this command. Refusals are printed on stderr.
    """
    try:
        interfaces = [IPv4Address(text) for text in interface or ()]
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--interface") from error
    sockets = {name: find_socket(name) for name in stage} if stage else running_stages()
    if not sockets:
        raise NotRunningError("no daemon is running", "start it with `piezod run CONFIG`")
    if len(sockets) > 1 and "{stage}" not in prefix:
        what = f"needs {{stage}} for several stages ({', '.join(sockets)})"
        raise typer.BadParameter(what, param_hint="--prefix")
    plan = IocPlan(sockets, prefix, control, interfaces)
    if write is not None:
        for file in write_lists(plan, write):
            typer.echo(f"written: {file}")
        return
    serve(plan, announce=typer.echo, report=LimitedReport())
