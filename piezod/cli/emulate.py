"""`piezod emulate`: a rig in a process of its own."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from piezod.cli.options import JsonOption
from piezod.cli.paths import existing_file

if TYPE_CHECKING:
    from pydantic import BaseModel

    from piezod.devices.interface import Wiring


def emulate(
    driver: Annotated[str, typer.Argument(metavar="DRIVER", help="Driver of the rig: simulated.")],
    socket: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Socket to serve; left out: where clients look."),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            metavar="CONFIG",
            help="Configuration of a daemon with this rig: its options, axes and seed. "
            "Left out: one axis x, default options.",
            callback=existing_file,
        ),
    ] = None,
    device: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which device of CONFIG; needed if there are several."),
    ] = None,
    trace: Annotated[
        Path | None, typer.Option(metavar="CSV", help="Write down every voltage that is written.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Host a rig until Ctrl-C, for devices with `driver: emulated`.

    It goes on in real time and keeps its voltage when the client dies, as a real amplifier does.
    Serves one client at a time.
    """
    from piezod.cli.output import new_console, print_json
    from piezod.devices import emulators, registry

    host = emulators.load(driver)
    options, wiring, seed = _default_rig(driver) if config is None else _rig(driver, config, device)

    axes = wiring.channels

    def ready(where: Path) -> None:
        if json:
            print_json({"socket": str(where), "driver": driver, "axes": axes})
        else:
            named = f"{driver} rig, axes {', '.join(axes)}"
            new_console().print(f"{named}: serving {where}, Ctrl-C ends it", soft_wrap=True)

    host(registry.load(driver).create(options, wiring, seed), axes, socket, trace, ready)


class _Rig(NamedTuple):
    options: "BaseModel"
    wiring: "Wiring"
    seed: int


def _default_rig(driver: str) -> _Rig:
    from piezod.devices import registry
    from piezod.devices.interface import Wiring

    return _Rig(registry.load(driver).options_model(), Wiring.both(("x",)), 1)


def _rig(driver: str, config: Path, device: str | None) -> _Rig:
    from piezod.config.daemon import load_daemon
    from piezod.devices import registry
    from piezod.devices.channels import pairs_of, wiring_of

    stage = load_daemon(config, registry)
    found = [name for name, each in stage.devices.items() if each.driver == driver]
    if device is None and len(found) == 1:
        device = found[0]
    if device not in found:
        known = ", ".join(found) or "none"
        what = f"devices of {config} with driver {driver}: {known} (got {device or 'none'})"
        raise typer.BadParameter(what, param_hint="--device")
    wiring = wiring_of(device, pairs_of(stage.axes))
    return _Rig(stage.devices[device].options, wiring, stage.seed)
