"""`piezod probe`: who the devices of a stage are, what they can do, how fast they are."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.interrupt import unwinding
from piezod.cli.options import JsonOption
from piezod.cli.owned_stage import owning
from piezod.cli.paths import existing_file

if TYPE_CHECKING:
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
    takes, and the rate that this allows. Exits with 69 if a device is absent.
    """
    from piezod.cli.output import new_console, print_json
    from piezod.commission.probe import probe as look
    from piezod.config.daemon import load_daemon
    from piezod.daemon.clock import MonotonicClock
    from piezod.devices import registry
    from piezod.devices.wiring import pairs_of

    stage = load_daemon(config, registry)
    with owning(config):
        found = look(stage, pairs_of(stage.axes), MonotonicClock())
        wiggled = {}
        if not json:
            console = new_console()
            for name, each in found.items():
                console.print(_text(name, each, stage), soft_wrap=True)
        if wiggle and not any(each.error for each in found.values()):
            with unwinding():
                wiggled = _wiggle(stage, asking=not yes, telling=not json)
    if json:
        devices = {name: _document(each) for name, each in found.items()}
        print_json({"devices": devices, "wiggled": wiggled})
    _raise_absent(found)


def _wiggle(stage: "DaemonConfig", *, asking: bool, telling: bool) -> dict[str, object]:
    from piezod.cli.output import new_console
    from piezod.commission.bench import one_axis
    from piezod.commission.noise import measure_noise
    from piezod.commission.polarity import find_polarity, step_v

    moved: dict[str, object] = {}
    for axis in stage.axes:
        with one_axis(stage, axis) as (session, _):
            size_v = step_v(session)
            what = (
                f"axis {axis}: {size_v:+.2f} V from {session.drive_v:z.2f} V, three times, and back"
            )
            with session.holding():
                wanted = not asking or typer.confirm(what + "?", default=False, err=True)
            if not wanted:
                continue
            noise, _ = measure_noise(session)
            found, _ = find_polarity(session, noise.rms_um)
        moved[axis] = found._asdict()
        if telling:
            text = (
                f"axis {axis}: {found.um_per_v * 1e3:+.1f} ± "
                f"{found.uncertainty_um_per_v * 1e3:.1f} nm/V, noise {noise.rms_um * 1e3:.1f} nm"
            )
            new_console().print(text)
    return moved


def _text(name: str, found: "Probed", stage: "DaemonConfig") -> str:
    lines = [f"{name} (driver {found.driver})"]
    if found.identity is not None:
        lines.append("  is        " + ", ".join(found.identity))
    if (able := found.capabilities) is not None:
        lines.append("  can       " + ", ".join(_abilities(able._asdict())))
        if able.ranges:
            each = zip(able.outputs, able.ranges, strict=True)
            ends = ", ".join(f"{channel} {low:.6g} to {high:.6g}" for channel, (low, high) in each)
            lines.append(f"  gives     {ends}")
    for what, values in (("reads", found.readings), ("in force", found.in_force)):
        if values:
            told = ", ".join(f"{channel} {value:.6g}" for channel, value in values.items())
            lines.append(f"  {what:9} {told}")
    for what, trip in (("read", found.read), ("read back", found.read_back)):
        if trip is not None:
            lines.append(f"  {what:9} {_trip(trip)}")
    if found.error:
        lines.append(f"  ERROR     {found.error}")
    else:
        fits = "" if stage.rate_hz <= found.rate_hz else f"; rate_hz is {stage.rate_hz:g}"
        lines.append(f"  allows    {found.rate_hz:.0f} Hz in the cycle{fits}")
    return "\n".join(lines)


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
    return f"{trip.median_us:.0f} µs median, {trip.p99_us:.0f} µs p99{failed}"


def _document(found: "Probed") -> dict[str, object]:
    document = found._asdict()
    for key in ("identity", "capabilities", "read", "read_back"):
        if document[key] is not None:
            document[key] = document[key]._asdict()
    return document


def _raise_absent(found: "dict[str, Probed]") -> None:
    from piezod.errors import DeviceUnavailableError

    errors = [f"device {name}: {each.error}" for name, each in found.items() if each.error]
    if errors:
        raise DeviceUnavailableError("\n".join(errors))
