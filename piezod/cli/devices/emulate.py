"""`piezod emulate`: emulated devices in their own process, connected to the simulated rig."""

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from piezod.cli.options import JsonOption
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


def emulate(  # noqa: PLR0913, PLR0917 - each argument is an option
    profile: ProfilesArgument,
    port: PortOption = None,
    config: RigOption = None,
    device: DeviceOption = None,
    axes: AxesOption = None,
    serial_number: SerialNumberOption = "",
    fault: FaultOption = None,
    trace: TraceOption = None,
    json: JsonOption = False,
) -> None:
    """Emulate devices until Ctrl-C, connected to a simulated rig.

    The rig runs in real time and keeps its voltage if the client dies, as a real amplifier does.
    Each device serves one client at a time. `piezod emulate simulated` serves the rig itself, for
    devices with `driver: emulated`.

    A line on standard input replaces all faults: faults separated by commas, or an empty line for
    none. Replies are then counted from 1 again.
    """
    # The rig and the emulators take long to import.
    from piezod.cli.devices.emulate_run import chosen_posts, chosen_rig, serve

    posts = chosen_posts(profile, port, fault or ())
    rig = chosen_rig(posts, config, device, axes)
    serve(posts, rig, serial_number, trace, json=json)
