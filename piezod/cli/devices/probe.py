"""`piezod probe`: identity, capabilities and speed of the devices of a stage."""

from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from piezod.cli.devices.commission_steps import print_note, walk
from piezod.cli.devices.guardian import Guardian, guardian
from piezod.cli.devices.owned_stage import owning
from piezod.cli.interrupt import unwinding
from piezod.cli.options import ConfigArgument, JsonOption

if TYPE_CHECKING:
    from collections.abc import Mapping

    from piezod.commission.probe import Probed
    from piezod.config.daemon import DaemonConfig
    from piezod.daemon.output_notes import OutputNotes

WiggleOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--wiggle", help="Then move each axis by a few volts, within its limits, and back."
    ),
]
YesOption: TypeAlias = Annotated[
    bool, typer.Option("--yes", help="Wiggle without a confirmation of each step.")
]
TraceOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--trace",
        help="Print all bytes on serial ports and TCP connections to stderr, as text and as "
        "hexadecimal numbers; only a few exchanges are then timed.",
    ),
]


def probe(
    config: ConfigArgument,
    wiggle: WiggleOption = False,
    yes: YesOption = False,
    trace: TraceOption = False,
    json: JsonOption = False,
) -> None:
    """Inspect the devices of a stage; moves nothing without --wiggle.

    Opens each device and prints its identity, its capabilities, the values of its channels, the
    duration of an exchange, and the rate that this allows: for the device alone, and for all
    together. Exits with 69 if a device is absent.
    """
    from piezod.cli.output import print_json
    from piezod.commission.probe import EXCHANGES, TRACED_EXCHANGES, together_hz
    from piezod.commission.probe import probe as inspect
    from piezod.config.daemon import load_daemon
    from piezod.daemon.clock import MonotonicClock
    from piezod.daemon.output_notes import OutputNotes
    from piezod.daemon.paths import stage_paths
    from piezod.devices import registry
    from piezod.devices.bus.byte_trace import tracing
    from piezod.devices.wiring import pairs_of

    stage = load_daemon(config, registry)
    exchanges = TRACED_EXCHANGES if trace else EXCHANGES
    with owning(config), tracing(_print_line) if trace else nullcontext():
        found = inspect(stage, pairs_of(stage.axes), MonotonicClock(), exchanges)
        wiggled: dict[str, object] = {}
        complete = not any(each.error for each in found.values())
        all_hz = together_hz(found.values()) if complete else 0.0
        if not json:
            _print_text(found, all_hz, stage.rate_hz)
        if wiggle and complete:
            with unwinding(), guardian(config) as guard:
                notes = OutputNotes(stage, stage_paths(config))
                wiggled = _wiggle(stage, notes, guard, asking=not yes, err=json)
    if json:
        devices = {name: _document(each) for name, each in found.items()}
        print_json({"devices": devices, "together_hz": all_hz, "wiggled": wiggled})
    _raise_absent(found)


def _print_line(line: str) -> None:
    typer.echo(line, err=True)


def _print_text(found: "Mapping[str, Probed]", all_hz: float, stage_rate_hz: float) -> None:
    from piezod.cli.devices.probe_view import device_text, rate_text
    from piezod.cli.output import new_console

    console = new_console()
    for name, each in found.items():
        console.print(device_text(name, each, stage_rate_hz), soft_wrap=True)
    if all_hz and len(found) > 1:
        console.print(f"all together allow {rate_text(all_hz, stage_rate_hz)}", soft_wrap=True)


def _wiggle(
    stage: "DaemonConfig", notes: "OutputNotes", guard: Guardian, *, asking: bool, err: bool
) -> dict[str, object]:
    """Do the first two steps of `piezod commission` with each axis."""
    from itertools import islice

    from piezod.commission.bench import one_axis
    from piezod.commission.procedure import Findings, steps_of

    moved: dict[str, object] = {}
    for axis in stage.axes:
        findings = Findings()
        with one_axis(stage, axis, notes) as opened:
            guard.watch(axis, opened)
            session = opened.session
            steps = islice(steps_of(session, findings, print_note), 2)
            walk(session, steps, [], asking=asking, prefix=f"axis {axis}: ", err=err)
        if findings.polarity is not None:
            moved[axis] = findings.polarity._asdict()
    return moved


def _document(found: "Probed") -> dict[str, object]:
    document = found._asdict()
    for key in ("identity", "capabilities", "units", "read", "read_back"):
        if document[key] is not None:
            document[key] = document[key]._asdict()
    return document


def _raise_absent(found: "Mapping[str, Probed]") -> None:
    from piezod.errors import DeviceUnavailableError

    errors = [f"device {name}: {each.error}" for name, each in found.items() if each.error]
    if errors:
        raise DeviceUnavailableError("\n".join(errors))
