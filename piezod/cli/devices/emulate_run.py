"""The work of `piezod emulate`."""

from collections.abc import Callable, Sequence
from pathlib import Path

import typer

from piezod.cli.devices.emulate_parts import (
    RigPlan,
    bench,
    default_rig,
    posts_of,
    rig_of,
    stop_requested,
    watch_input,
)
from piezod.cli.output import new_console, print_json_line
from piezod.devices.emulation.faults import ON_A_BUS, parse
from piezod.devices.emulators import Emulation, EmulationRequest


def chosen_posts(
    profiles: Sequence[str], port: str | None, faults: Sequence[str]
) -> list[EmulationRequest]:
    """Return the devices of a command line, which have a wire for its faults."""
    posts = posts_of(profiles, port, faults)
    _check_faults(posts, faults)
    return posts


def chosen_rig(
    posts: Sequence[EmulationRequest], config: Path | None, device: str | None, axes: int | None
) -> RigPlan:
    """Return the rig of a configuration, or one that has an axis for each channel of a device."""
    if config is not None:
        return rig_of(config, device, axes)
    return default_rig(axes or max(post.plugin.channels for post in posts))


def serve(
    posts: Sequence[EmulationRequest],
    rig: RigPlan,
    serial_number: str,
    trace: Path | None,
    *,
    json: bool,
) -> None:
    """Emulate the devices until a signal comes."""
    with stop_requested() as stopping, bench(rig, trace) as on_bench:
        emulation = Emulation(posts, on_bench, serial_number)
        try:
            _print_places(posts, emulation.start(), rig, json=json)
            _serve(posts, lambda: stopping() or not emulation.running(), json=json)
        finally:
            emulation.stop()


def _check_faults(posts: Sequence[EmulationRequest], faults: Sequence[str]) -> None:
    if all(post.plugin.wire == "can" for post in posts):
        return
    for text in faults:
        if parse(text).kind in ON_A_BUS:
            what = f"{text} needs a CAN bus: every PROFILE must be a CAN device"
            raise typer.BadParameter(what, param_hint="--fault")


def _print_places(
    posts: Sequence[EmulationRequest], places: Sequence[str], rig: RigPlan, *, json: bool
) -> None:
    served = [(post.plugin.name, place) for post, place in zip(posts, places, strict=True)]
    if json:
        found = [{"profile": name, "where": where} for name, where in served]
        print_json_line({"serving": found, "axes": rig.axes})
        return
    for name, where in served:
        what = f"{name}, axes {', '.join(rig.axes)}: serving {where}, Ctrl-C ends it"
        new_console().print(what, soft_wrap=True)


def _serve(posts: Sequence[EmulationRequest], stopping: Callable[[], bool], *, json: bool) -> None:
    def report(faults: str) -> None:
        if json:
            print_json_line({"faults": faults})
        else:
            new_console().print(f"faults: {faults or 'none'}", soft_wrap=True)

    watch_input([post.faults for post in posts], stopping, report)
