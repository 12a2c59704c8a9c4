"""The work of `piezod probe`."""

from collections.abc import Mapping
from contextlib import nullcontext
from itertools import islice
from pathlib import Path

import typer

from piezod.cli.devices.commission_steps import print_note, walk
from piezod.cli.devices.guardian import Guardian, guardian
from piezod.cli.devices.owned_stage import owning
from piezod.cli.devices.probe_view import device_text, rate_text
from piezod.cli.interrupt import unwinding
from piezod.cli.output import new_console, print_json
from piezod.commission.bench import one_axis
from piezod.commission.probe import EXCHANGES, TRACED_EXCHANGES, Probed, together_hz
from piezod.commission.probe import probe as inspect
from piezod.commission.procedure import Findings, steps_of
from piezod.config.daemon import DaemonConfig, load_daemon
from piezod.daemon.clock import MonotonicClock
from piezod.daemon.output_notes import OutputNotes
from piezod.daemon.paths import stage_paths
from piezod.devices import registry
from piezod.devices.bus.byte_trace import tracing
from piezod.devices.wiring import pairs_of
from piezod.errors import DeviceUnavailableError


def run(config: Path, *, wiggle: bool, yes: bool, trace: bool, json: bool) -> None:
    """Inspect the devices of a stage, and print what was found.

    Raises:
        DeviceUnavailableError: If a device is absent.
    """
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
        devices = {name: document(each) for name, each in found.items()}
        print_json({"devices": devices, "together_hz": all_hz, "wiggled": wiggled})
    _raise_absent(found)


def _print_line(line: str) -> None:
    typer.echo(line, err=True)


def _print_text(found: Mapping[str, Probed], all_hz: float, stage_rate_hz: float) -> None:
    console = new_console()
    for name, each in found.items():
        console.print(device_text(name, each, stage_rate_hz), soft_wrap=True)
    if all_hz and len(found) > 1:
        console.print(f"all together allow {rate_text(all_hz, stage_rate_hz)}", soft_wrap=True)


def _wiggle(
    stage: DaemonConfig, notes: OutputNotes, guard: Guardian, *, asking: bool, err: bool
) -> dict[str, object]:
    """Do the first two steps of `piezod commission` with each axis."""
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


def document(found: Probed) -> dict[str, object]:
    """Return a result as a document of JSON."""
    parts = found._asdict()
    for key in ("identity", "capabilities", "units", "read", "read_back"):
        if parts[key] is not None:
            parts[key] = parts[key]._asdict()
    return parts


def _raise_absent(found: Mapping[str, Probed]) -> None:
    errors = [f"device {name}: {each.error}" for name, each in found.items() if each.error]
    if errors:
        raise DeviceUnavailableError("\n".join(errors))
