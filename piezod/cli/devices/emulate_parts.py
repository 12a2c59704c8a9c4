"""The parts of `piezod emulate`: the rig, the devices, and faults typed while it runs."""

import os
import select
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, nullcontext
from pathlib import Path
from typing import Final, NamedTuple, cast

import typer
from pydantic import BaseModel

from piezod.config.daemon import load_daemon
from piezod.devices import emulators, registry
from piezod.devices.emulation.bench import Rig, SharedRig, step_ns_of
from piezod.devices.emulation.faults import WireFault, WireFaults, parse
from piezod.devices.emulation.rig_clock import RigClock
from piezod.devices.emulation.trace import Trace
from piezod.devices.emulators import EmulationRequest
from piezod.devices.interface import Wiring
from piezod.devices.wiring import pairs_of, wiring_of

_DRIVER: Final = "simulated"
_FIRST_AXES: Final = ("x", "y", "z")
_STDIN: Final = 0
_POLL_MS: Final = 100
"""Time between two checks whether to stop, in ms."""


class RigPlan(NamedTuple):
    """What is needed to make a simulated rig."""

    options: BaseModel  #: Options of its driver.
    axes: tuple[str, ...]  #: Names of its axes.
    seed: int  #: Seed of its random numbers.


def default_rig(n_axes: int) -> RigPlan:
    """Return the rig with default options, seed 1 and axes x, y, z, a4, a5 and so on."""
    axes = (*_FIRST_AXES, *(f"a{number}" for number in range(4, n_axes + 1)))[:n_axes]
    return RigPlan(registry.load(_DRIVER).options_model(), axes, 1)


def rig_of(config: Path, device: str | None, n_axes: int | None) -> RigPlan:
    """Return the rig of a configuration.

    Args:
        config: The configuration of a stage.
        device: Name of the simulated device; None for the only one.
        n_axes: Number of its axes; None for all.

    Raises:
        PiezodError: If the configuration is not valid.
        typer.BadParameter: If it has no such device, several and no name is given, or fewer axes.
    """
    stage = load_daemon(config, registry)
    found = [name for name, each in stage.devices.items() if each.driver == _DRIVER]
    if device is None and len(found) == 1:
        device = found[0]
    if device not in found:
        known = ", ".join(found) or "none"
        what = f"name a device of {config} with driver {_DRIVER}: {known} (got {device or 'none'})"
        raise typer.BadParameter(what, param_hint="--device")
    axes = wiring_of(device, pairs_of(stage.axes)).channels
    if n_axes is not None and n_axes > len(axes):
        what = f"{device} of {config} has {len(axes)} axes (got {n_axes})"
        raise typer.BadParameter(what, param_hint="--axes")
    return RigPlan(stage.devices[device].options, axes[:n_axes], stage.seed)


@contextmanager
def bench(plan: RigPlan, trace: Path | None) -> Iterator[SharedRig]:
    """Make the rig and run it in real time until the block ends.

    Raises:
        OSError: If the trace cannot be written.
    """
    inputs = tuple(name for axis in plan.axes for name in (axis, f"{axis}_v"))
    wiring = Wiring(inputs, plan.axes)
    rig = cast("Rig", registry.load(_DRIVER).create(plan.options, wiring, plan.seed))
    writing = nullcontext() if trace is None else Trace(trace, plan.axes)
    with closing(rig), writing as written:
        identity = rig.open()
        now_ns = time.monotonic_ns()
        rig.activate(now_ns - now_ns % step_ns_of(rig))
        yield SharedRig(rig, RigClock(time.monotonic_ns), written, identity)


def posts_of(
    profiles: Sequence[str], where: str | None, faults: Sequence[str]
) -> list[EmulationRequest]:
    """Return the devices that a command line names.

    Args:
        profiles: The devices, each as PROFILE or PROFILE=WHERE.
        where: Place of a single device; None for the default.
        faults: Wire faults of each device.

    Raises:
        RegistryError: If a profile has no emulator.
        typer.BadParameter: If a place is given twice, or a fault is not well formed.
    """
    named = [each.partition("=")[::2] for each in profiles]
    if where is not None:
        if len(named) > 1 or named[0][1]:
            what = "is for a single PROFILE; with several, write PROFILE=WHERE for each"
            raise typer.BadParameter(what, param_hint="--port")
        named = [(named[0][0], where)]
    try:
        wrong = [parse(text) for text in faults]
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--fault") from error
    posts = [
        EmulationRequest(emulators.load(name), place, WireFaults(wrong)) for name, place in named
    ]
    if wrong and any(post.plugin.wire == "socket" for post in posts):
        raise typer.BadParameter("a rig at a socket has no wire", param_hint="--fault")
    return posts


@contextmanager
def stop_requested() -> Iterator[Callable[[], bool]]:
    """Take SIGINT and SIGTERM as requests to stop, until the block ends.

    Yields:
        A function that returns whether a signal has come.
    """
    requested = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: requested.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield requested.is_set
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def watch_input(
    wires: Sequence[WireFaults], stopping: Callable[[], bool], report: Callable[[str], None]
) -> None:
    """Set the faults of all wires from the lines of standard input, until `stopping` is true.

    Args:
        wires: The faults of each wire.
        stopping: Whether to stop; called every 0.1 s.
        report: Receives the faults in force after each line, or why the line is not valid.
    """
    typed = select.poll()
    typed.register(_STDIN, select.POLLIN)
    rest = b""
    while not stopping():
        if not typed.poll(_POLL_MS) or not _may_read():
            continue
        data = os.read(_STDIN, 4096)
        if not data:
            typed.unregister(_STDIN)
        *lines, rest = (rest + data).split(b"\n")
        for line in lines:
            report(_set(wires, line.decode(errors="replace")))


def _may_read() -> bool:
    """Return False if reading would stop the process, as for a background job at a terminal."""
    return not os.isatty(_STDIN) or os.tcgetpgrp(_STDIN) == os.getpgrp()


def _set(wires: Sequence[WireFaults], line: str) -> str:
    texts = [text.strip() for text in line.split(",") if text.strip()]
    try:
        faults: list[WireFault] = [parse(text) for text in texts]
    except ValueError as error:
        return f"unchanged, {error}"
    for wire in wires:
        wire.set(faults)
    return ", ".join(texts)
