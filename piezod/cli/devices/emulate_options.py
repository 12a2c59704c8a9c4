"""Arguments and options of `piezod emulate`."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.paths import existing_file

ProfilesArgument: TypeAlias = Annotated[
    list[str],
    typer.Argument(
        metavar="PROFILE[=WHERE]",
        help="Devices, each with the path of its port or its HOST:PORT; several are connected to "
        "the same stage, axis by axis.",
    ),
]
PortOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--port",
        "--socket",
        metavar="WHERE",
        help="Port or socket of a single PROFILE. Default: a usual place, which is printed.",
    ),
]
RigOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="CONFIG",
        help="Configuration of a stage with a simulated rig: its options, axes and seed are used. "
        "Default: default options, seed 1.",
        callback=existing_file,
    ),
]
DeviceOption: TypeAlias = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Rig of CONFIG; required if there are several."),
]
AxesOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=1, max=16, metavar="N", help="Number of axes. Default: as many as the devices have."
    ),
]
SerialNumberOption: TypeAlias = Annotated[
    str, typer.Option(metavar="TEXT", help="Serial number that the devices report.")
]
FaultOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KIND[:WHICH][:VALUE]",
        help="Wire fault of every device; may be repeated. KIND: late (VALUE s), lost, garbled "
        "(bit VALUE), partial (only the first VALUE bytes come), duplicated, noise (VALUE bytes "
        "before the reply); disconnect, wrong-identity (both: absent for VALUE s), restart (off "
        "for VALUE s); on a CAN bus also foreign (another node sends a frame with the host's "
        "identifier), bus-off (for VALUE s). WHICH reply, counted from 1: 7, 7-9, 7-, 'every 7'; "
        "or now, for disconnect, wrong-identity, restart and bus-off; default: every reply. VALUE "
        "may be a range, 0.01-0.2.",
    ),
]
TraceOption: TypeAlias = Annotated[
    Path | None, typer.Option(metavar="CSV", help="Record every written voltage in this file.")
]
