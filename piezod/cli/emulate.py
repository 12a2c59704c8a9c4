"""`piezod emulate`: devices in a process of their own, with the simulated rig behind them."""

from pathlib import Path
from typing import Annotated

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file


def emulate(  # noqa: PLR0913, PLR0917 - the options of a command
    profile: Annotated[
        list[str],
        typer.Argument(
            metavar="PROFILE[=WHERE]",
            help="Devices, each with the path of its port or its HOST:PORT; several are connected "
            "to the same stage, axis by axis.",
        ),
    ],
    port: Annotated[
        str | None,
        typer.Option(
            "--port",
            "--socket",
            metavar="WHERE",
            help="Where a single PROFILE is served; left out: a usual place, which is printed.",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="CONFIG",
            help="Configuration of a daemon with a simulated rig: its options, axes and seed. "
            "Left out: default options, seed 1.",
            callback=existing_file,
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which device of CONFIG; needed if there are several."),
    ] = None,
    axes: Annotated[
        int | None,
        typer.Option(min=1, max=16, metavar="N", help="Axes; left out: as many as are needed."),
    ] = None,
    serial_number: Annotated[
        str, typer.Option(metavar="TEXT", help="Serial number that the devices tell.")
    ] = "",
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND[:WHICH][:VALUE]",
            help="What goes wrong on every wire; may be repeated. KIND: late (VALUE s), lost, "
            "garbled (bit VALUE), partial (first VALUE bytes come), duplicated, noise (VALUE bytes "
            "before the reply); disconnect, wrong-identity (both: away for VALUE s), restart (off "
            "for VALUE s); on a CAN bus also foreign (a frame of the host's that it has not sent), "
            "bus-off (for VALUE s). WHICH reply, counted from 1: 7, 7-9, 7-, 'every 7', left out: "
            "every one; or now, for disconnect, wrong-identity, restart and bus-off. VALUE may be "
            "a range, 0.01-0.2.",
        ),
    ] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Write down every voltage that is written.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Emulate devices until Ctrl-C, with a simulated rig behind them.

    It goes on in real time and keeps its voltage when the client dies, as a real amplifier does.
    Each device serves one client at a time. `piezod emulate simulated` hosts the rig itself, for
    devices with `driver: emulated`.

    While it runs, a line on standard input stands for all faults from then on, separated by commas,
    and replies are counted from 1 again; an empty line ends them all.
    """
    from piezod.cli.emulate_parts import bench, default_rig, posts_of, rig_of, told_to_end, watch
    from piezod.cli.output import new_console, print_json_line
    from piezod.devices.emulation.faults import ON_A_BUS, parse
    from piezod.devices.emulators import Emulation

    posts = posts_of(profile, port, fault or ())
    if any(post.plugin.wire != "can" for post in posts):
        for text in fault or ():
            if parse(text).kind in ON_A_BUS:
                what = f"{text} needs a CAN bus, where every PROFILE is on one"
                raise typer.BadParameter(what, param_hint="--fault")
    needed = axes or max(post.plugin.channels for post in posts)
    rig = default_rig(needed) if config is None else rig_of(config, device, axes)

    def tell(faults: str) -> None:
        if json:
            print_json_line({"faults": faults})
        else:
            new_console().print(f"faults: {faults or 'none'}", soft_wrap=True)

    with told_to_end() as stopping, bench(rig, trace) as on_bench:
        emulation = Emulation(posts, on_bench, serial_number)
        try:
            places = emulation.start()
            served = [(post.plugin.name, place) for post, place in zip(posts, places, strict=True)]
            if json:
                found = [{"profile": name, "where": where} for name, where in served]
                print_json_line({"serving": found, "axes": rig.axes})
            else:
                for name, where in served:
                    what = f"{name}, axes {', '.join(rig.axes)}: serving {where}, Ctrl-C ends it"
                    new_console().print(what, soft_wrap=True)
            every = [post.faults for post in posts]
            watch(every, lambda: stopping() or not emulation.running(), tell)
        finally:
            emulation.stop()
