"""`piezod probe`: who the devices of a stage are, what they can do, how fast they are."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.commission_steps import walk
from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.owned_stage import owning
from piezod.cli.paths import existing_file

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from piezod.commission.probe import Probed, RoundTrip
    from piezod.config.daemon import DaemonConfig


def probe(
    config: Annotated[
        Path,
        typer.Argument(
            metavar="CONFIG",
            help="Configuration of a daemon, YAML.",
            readable=False,
            callback=existing_file,
        ),
    ],
    wiggle: Annotated[
        bool,
        typer.Option(
            "--wiggle", help="Then move each axis by a few volts, within its limits, and back."
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Wiggle without being asked.")] = False,
    json: JsonOption = False,
) -> None:
    """Look at the devices of a stage; moves nothing, unless --wiggle.

    Opens each device, tells who it is, what it can do, what its channels read, how long an exchange
    takes, and the rates that this allows: of the device alone, and of all together. Exits with
    69 if a device is absent.
    """
    from piezod.cli.output import new_console, print_json
    from piezod.commission.probe import probe as look
    from piezod.commission.probe import together_hz
    from piezod.config.daemon import load_daemon
    from piezod.daemon.clock import MonotonicClock
    from piezod.devices import registry
    from piezod.devices.wiring import pairs_of

    stage = load_daemon(config, registry)
    with owning(config):
        found = look(stage, pairs_of(stage.axes), MonotonicClock())
        wiggled: dict[str, object] = {}
        there = not any(each.error for each in found.values())
        all_hz = together_hz(found.values()) if there else 0.0
        if not json:
            console = new_console()
            for name, each in found.items():
                console.print(_text(name, each, stage), soft_wrap=True)
            if there and len(found) > 1:
                console.print(f"all together allow {_rate(all_hz, stage)}", soft_wrap=True)
        if wiggle and there:
            with unwinding():
                wiggled = _wiggle(stage, asking=not yes, err=json)
    if json:
        devices = {name: _document(each) for name, each in found.items()}
        print_json({"devices": devices, "together_hz": all_hz, "wiggled": wiggled})
    _raise_absent(found)


def _wiggle(stage: "DaemonConfig", *, asking: bool, err: bool) -> dict[str, object]:
    """Do the first two steps of `piezod commission` with each axis."""
    from itertools import islice

    from piezod.commission.bench import one_axis
    from piezod.commission.procedure import Findings, steps_of

    moved: dict[str, object] = {}
    for axis in stage.axes:
        findings = Findings()
        with one_axis(stage, axis) as (session, _):
            steps = islice(steps_of(session, findings), 2)
            walk(session, steps, [], asking=asking, of=f"axis {axis}: ", err=err)
        if findings.polarity is not None:
            moved[axis] = findings.polarity._asdict()
    return moved


def _text(name: str, found: "Probed", stage: "DaemonConfig") -> str:
    lines = [f"{name} (driver {found.driver})"]
    if found.identity is not None:
        lines.append("  is        " + ", ".join(found.identity))
    if (able := found.capabilities) is not None:
        lines.append("  can       " + ", ".join(_abilities(able._asdict())))
        if able.ranges:
            ends = [f"{low:.6g} to {high:.6g}" for low, high in able.ranges]
            lines.append(
                f"  gives     {_each(zip(able.outputs, ends, strict=True), found.units.outputs)}"
            )
    for what, values, units in (
        ("reads", found.readings, found.units.inputs),
        ("in force", found.in_force, found.units.outputs),
    ):
        if values:
            told = ((channel, f"{value:.6g}") for channel, value in values.items())
            lines.append(f"  {what:9} {_each(told, units)}")
    for what, trip in (("read", found.read), ("read back", found.read_back)):
        if trip is not None:
            lines.append(f"  {what:9} {_trip(trip)}")
    if found.error:
        lines.append(f"  ERROR     {found.error}")
    else:
        lines.append(f"  allows    {_rate(found.rate_hz, stage)}")
    return "\n".join(lines)


def _each(told: "Iterable[tuple[str, str]]", units: "Mapping[str, str]") -> str:
    """Return channels with what is told of each, in its unit where that is known."""
    return ", ".join(f"{name} {text} {units.get(name, '')}".rstrip() for name, text in told)


def _rate(allowed_hz: float, stage: "DaemonConfig") -> str:
    fits = "" if stage.rate_hz <= allowed_hz else f"; rate_hz is {stage.rate_hz:g}"
    return f"{allowed_hz:.0f} Hz in the cycle{fits}"


_ABILITIES = {
    "read_back": "read back",
    "enables": "enable outputs",
    "soft_disable": "disable them gently",
    "watchdog": "make outputs safe by itself",
    "quality": "tell bad samples",
    "holds": "hold its outputs when let go of",
}


def _abilities(able: dict[str, object]) -> list[str]:
    return [text for key, text in _ABILITIES.items() if able[key]] or ["nothing of its own"]


def _trip(trip: "RoundTrip") -> str:
    failed = f", {trip.failed_pct:.0f} % failed" if trip.failed_pct else ""
    each = ((trip.median_us, "median"), (trip.p90_us, "p90"), (trip.p99_us, "p99"))
    return ", ".join(f"{took_us:.0f} µs {name}" for took_us, name in each) + failed


def _document(found: "Probed") -> dict[str, object]:
    document = found._asdict()
    for key in ("identity", "capabilities", "units", "read", "read_back"):
        if document[key] is not None:
            document[key] = document[key]._asdict()
    return document


def _raise_absent(found: "dict[str, Probed]") -> None:
    from piezod.errors import DeviceUnavailableError

    errors = [f"device {name}: {each.error}" for name, each in found.items() if each.error]
    if errors:
        raise DeviceUnavailableError("\n".join(errors))
