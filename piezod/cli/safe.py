"""`piezod safe`: ramp a stage to its safe voltage without its daemon."""

from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from piezod.cli.options import ConfigArgument, JsonOption
from piezod.cli.owned_stage import LOCK_WAIT_S

if TYPE_CHECKING:
    from piezod.config.daemon import DaemonConfig
    from piezod.daemon.paths import StagePaths
    from piezod.daemon.safe.ramp import AxisOutcome


def safe(
    config: ConfigArgument,
    unless_clean: Annotated[
        bool,
        typer.Option("--unless-clean", help="Do nothing if the daemon ended in order."),
    ] = False,
    confirm_output: Annotated[
        bool,
        typer.Option(
            "--confirm-output",
            help="You have seen that the read-back is right, whatever was written last.",
        ),
    ] = False,
    json: JsonOption = False,
) -> None:
    """Ramp a stage to its safe voltage after its daemon has died.

    The ramp starts from the read-back voltage or, without a read-back, from the voltage that the
    daemon wrote last. If the two differ, nothing is written unless you confirm the read-back. The
    ramp waits up to 30 s for an output that does not follow. Nothing is written to another
    amplifier than the daemon's. Exits with 0 if all axes are at the safe voltage; otherwise it
    prints UNKNOWN with the reason and exits with 1. Exits with 75 if the daemon runs, or its loop
    process does not end.
    """
    from piezod.daemon.paths import stage_paths

    paths = stage_paths(config)
    if unless_clean and not paths.running.exists():
        _print_outcomes({}, json=json)
        return
    paths.make_folders()
    outcomes = _ramp_down_alone(config, paths, confirmed=confirm_output)
    _print_outcomes(outcomes, json=json)
    _raise_unknown(outcomes)


def _ramp_down_alone(
    config: Path, paths: "StagePaths", *, confirmed: bool
) -> "dict[str, AxisOutcome]":
    import signal

    from piezod.daemon.durations import loop_gone_within_s
    from piezod.daemon.lock import Lock, device_lock, taken_within

    with taken_within(lambda: Lock(paths.lock), LOCK_WAIT_S):
        in_force = _in_force(config, paths)
        # A loop process whose supervisor died, and lost that lock, drives until it has ramped down.
        within_s = loop_gone_within_s(in_force)
        with taken_within(lambda: device_lock(paths.loop_lock), within_s):
            # A service manager that stops a daemon also signals its children; the ramp must
            # continue to its end.
            before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
            try:
                return _ramp_down(in_force, paths, within_s, confirmed=confirmed)
            finally:
                signal.signal(signal.SIGTERM, before)


def _in_force(config: Path, paths: "StagePaths") -> "DaemonConfig":
    """Load the configuration that the dead daemon ran; the file may have changed since."""
    from piezod.config.daemon import load_daemon
    from piezod.devices import registry
    from piezod.errors import ConfigError

    # The daemon keeps a copy of its accepted configuration, in one of two folders.
    copies = list(paths.runtime.glob(f"config-*/{config.stem}.yaml"))
    if config not in copies and copies and paths.running.exists():
        try:
            return load_daemon(max(copies, key=lambda copy: copy.stat().st_mtime), registry)
        except ConfigError:
            pass  # the daemon died while it wrote this copy
    return load_daemon(config, registry)


def _ramp_down(
    config: "DaemonConfig", paths: "StagePaths", within_s: float, *, confirmed: bool
) -> "dict[str, AxisOutcome]":
    from piezod.daemon.clock import MonotonicClock
    from piezod.daemon.last_output import LastOutputWriter, read_last_output
    from piezod.daemon.noted_identities import noted_identities
    from piezod.daemon.safe.ramp_down import Noted, ramp_down

    noted = read_last_output(paths.output_map)
    noted_v: dict[str, float] = {}
    if len(noted) == len(config.axes):
        noted_v = {name: each.drive_v for name, each in zip(config.axes, noted, strict=True)}
    known = Noted(noted_v, noted_identities(paths.identities))
    clock = MonotonicClock()
    outcomes = ramp_down(config, known, within_s, clock, confirmed=confirmed)
    # For the next daemon: what it starts from is what was written here.
    written_v = [
        each.safe_v if not each.why else noted_v.get(name, nan) for name, each in outcomes.items()
    ]
    LastOutputWriter(paths.output_map, len(written_v)).note(written_v, clock.now_ns())
    return outcomes


def _print_outcomes(outcomes: "dict[str, AxisOutcome]", *, json: bool) -> None:
    if json:
        from piezod.cli.output import print_json

        axes = {name: each._asdict() for name, each in outcomes.items()}
        print_json({"safe": not any(each.why for each in outcomes.values()), "axes": axes})
        return
    if not outcomes:
        typer.echo("the daemon ended in order: nothing to do")
    for name, (from_v, noted, safe_v, read_back_v, why) in outcomes.items():
        if not why:
            source = "last written; the amplifier has no read-back" if noted else "read back"
            end = "not read back" if isnan(read_back_v) else f"{read_back_v:.2f} V read back"
            typer.echo(f"{name}: from {from_v:.2f} V ({source}) to {safe_v:g} V, {end}")


def _raise_unknown(outcomes: "dict[str, AxisOutcome]") -> None:
    from piezod.errors import DeviceError

    unknown = [
        f"axis {name}: the voltage is UNKNOWN: {each.why}"
        for name, each in outcomes.items()
        if each.why
    ]
    if unknown:
        raise DeviceError("\n".join(unknown))
