"""`piezod emulate`: emulated devices in their own process, connected to the simulated rig."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import typer

from piezod.cli.devices.emulate_options import (
    AxesOption,
    DeviceOption,
    FaultOption,
    PortOption,
    ProfilesArgument,
    RigOption,
    SerialNumberOption,
    TraceOption,
)
from piezod.cli.options import JsonOption

if TYPE_CHECKING:
    from piezod.cli.devices.emulate_parts import RigPlan
    from piezod.devices.emulators import EmulationRequest


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
    from piezod.cli.devices.emulate_parts import (
        bench,
        default_rig,
        posts_of,
        rig_of,
        stop_requested,
    )
    from piezod.devices.emulators import Emulation

    posts = posts_of(profile, port, fault or ())
    _check_faults(posts, fault or ())
    needed = axes or max(post.plugin.channels for post in posts)
    rig = default_rig(needed) if config is None else rig_of(config, device, axes)
    with stop_requested() as stopping, bench(rig, trace) as on_bench:
        emulation = Emulation(posts, on_bench, serial_number)
        try:
            _print_places(posts, emulation.start(), rig, json=json)
            _serve(posts, lambda: stopping() or not emulation.running(), json=json)
        finally:
            emulation.stop()


def _check_faults(posts: "Sequence[EmulationRequest]", faults: Sequence[str]) -> None:
    from piezod.devices.emulation.faults import ON_A_BUS, parse

    if all(post.plugin.wire == "can" for post in posts):
        return
    for text in faults:
        if parse(text).kind in ON_A_BUS:
            what = f"{text} needs a CAN bus: every PROFILE must be a CAN device"
            raise typer.BadParameter(what, param_hint="--fault")


def _print_places(
    posts: "Sequence[EmulationRequest]", places: Sequence[str], rig: "RigPlan", *, json: bool
) -> None:
    from piezod.cli.output import new_console, print_json_line

    served = [(post.plugin.name, place) for post, place in zip(posts, places, strict=True)]
    if json:
        found = [{"profile": name, "where": where} for name, where in served]
        print_json_line({"serving": found, "axes": rig.axes})
        return
    for name, where in served:
        what = f"{name}, axes {', '.join(rig.axes)}: serving {where}, Ctrl-C ends it"
        new_console().print(what, soft_wrap=True)


def _serve(
    posts: "Sequence[EmulationRequest]", stopping: Callable[[], bool], *, json: bool
) -> None:
    from piezod.cli.devices.emulate_parts import watch_input
    from piezod.cli.output import new_console, print_json_line

    def report(faults: str) -> None:
        if json:
            print_json_line({"faults": faults})
        else:
            new_console().print(f"faults: {faults or 'none'}", soft_wrap=True)

    watch_input([post.faults for post in posts], stopping, report)
