"""`piezod install-service`: run the daemon as a systemd service."""

import os
import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Annotated

import typer

import piezod as piezod_package
from piezod.cli.daemon.shipped import shipped
from piezod.cli.options import JsonOption
from piezod.cli.output import print_json
from piezod.daemon import service_files
from piezod.errors import PiezodError
from piezod.service_view import SERVICES, who_may_change, why_unreachable

_ACTIVATE = (
    "systemd-sysusers piezod.conf",
    "systemd-tmpfiles --create piezod.conf",
    "udevadm control --reload && udevadm trigger",
    "systemctl daemon-reload",
)
_LONGEST_FIRST_LINE = 4096
_USE = (
    "cp -r CONFIGURATION.yaml models /etc/piezod/   # examples: piezod init",
    "usermod -aG piezod-view,piezod USER   # a user who may move the stage",
    "systemctl enable --now piezod@CONFIGURATION",
    "systemctl enable --now piezod-web   # the page with all stages",
    "systemctl enable --now piezod-ioc   # the stages as EPICS records",
)


def install_service(
    root: Annotated[
        Path, typer.Option(metavar="DIR", help="Write below this folder, for a package.")
    ] = Path("/"),
    piezod: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Command that the service runs. Default: this one."),
    ] = None,
    uninstall: Annotated[
        bool, typer.Option("--uninstall", help="Remove the installed files.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Install the systemd service of the daemon on this machine; needs root.

    Writes the unit `piezod@.service`, of which one instance runs one stage, those of the page and
    of the IOC, the udev rules, and the definitions of users and folders. Then prints the commands
    that activate them.
    """
    service_files.check_root(root)
    if uninstall:
        if root == Path("/") and (used := service_files.units_in_use()):
            stop = f"`systemctl disable --now {' '.join(used)}` first"
            raise PiezodError(f"{', '.join(used)} still running or enabled: {stop}")
        _print_files("removed", service_files.uninstall(root), _ACTIVATE[-1:], json=json)
        return
    command = piezod or _this_command()
    try:
        service_files.check_command(command)
        if root == Path("/"):
            _check_reachable(command)
        written = service_files.install(shipped("systemd"), root, command)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--piezod") from error
    _print_files("written", written, (*_ACTIVATE, *_USE), json=json)
    for place in (command, SERVICES) if root == Path("/") else ():
        for sentence in who_may_change(place):
            typer.echo(f"! {sentence}", err=True)


def _this_command() -> Path:
    places = (Path(sys.executable).parent, Path(sysconfig.get_path("scripts")))
    found = shutil.which("piezod", path=":".join(map(str, places)))
    if found is None:
        what = f"required, because the command is neither in {places[0]} nor in {places[1]}"
        raise typer.BadParameter(what, param_hint="--piezod")
    return Path(found)


def _check_reachable(command: Path) -> None:
    """Refuse a command that the service could not start, before the unit fails to start."""
    if not command.is_file():
        raise typer.BadParameter(f"no such file (got {command})", param_hint="--piezod")
    parts = [command]
    with command.open("rb") as file:
        first = file.readline(_LONGEST_FIRST_LINE)
    if first.startswith(b"#!") and (words := first[2:].split()):
        parts.append(Path(os.fsdecode(words[0])))
    if command == _this_command():
        parts.append(Path(piezod_package.__file__))  # another place, if it was installed with -e
    for part in parts:
        if why := why_unreachable(part):
            raise typer.BadParameter(
                f"{part}: {why}; {service_files.ELSEWHERE}", param_hint="--piezod"
            )


def _print_files(what: str, files: list[Path], commands: tuple[str, ...], *, json: bool) -> None:
    if json:
        print_json({what: [str(file) for file in files], "next": list(commands)})
        return
    for file in files:
        typer.echo(f"{what}: {file}")
    typer.echo("\nNext, as root:")
    for command in commands:
        typer.echo(f"  {command}")
