"""Runs a soak, and judges it."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Final, NamedTuple

from piezod.config.model_file import load_model
from piezod.control.law.model_files import from_model_file
from piezod.errors import ClientError
from tests.control.surface_rig import VARIANTS, model_path
from tests.daemon.daemons import configuration
from tests.soak.commands import Commands
from tests.soak.machine import Machine
from tests.soak.observer import LEARNED_PCT, Observer, Row
from tests.soak.rig import CheckedRig

RATE_HZ: Final = 20.0
RANGE_UM: Final = 26.0
GROWN_MB: Final = 8.0
GROWS: Final = {"rss_mb": GROWN_MB, "descriptors": 2, "threads": 2}
"""Allowed growth from the second fifth of the time to the last."""
FEW_MINUTES: Final = 60
ERROR_RMS_PCT: Final = 1.0
"""Largest allowed error of a minute, root mean square, in % of the range."""


class Result(NamedTuple):
    """What a soak has shown."""

    seed: int  #: Its seed.
    rows: list[Row]  #: One for each simulated minute.
    observer: Observer  #: The observer.
    commands: Commands  #: The commands.
    rig: CheckedRig  #: The rig.
    violations: list[str]  #: What must not happen; empty if all is well.
    #: How long it took, in s of the clock on the wall, and of the processor.
    took_s: tuple[float, float]


def _changes(rate_hz: float, model: str) -> dict[str, str]:
    """Return changes of the shipped configuration: the stage, and what a slow loop can do."""
    return {
        "rig": f"{{driver: simulated, options: {{variant: {VARIANTS[model]}}}}}",
        "model": str(model_path(model)),
        "rate_hz": f"{rate_hz:g}",
        "speed_um_per_s": "5",
        "limits": "{drive_min_v: 0, drive_max_v: 150, slew_v_per_s: 400, rest_v: 0}",
        "trim": f"{{base: feedforward, gain_per_s: {rate_hz / 10:g}, authority_pct: 5}}",
    }


def soak(
    duration_s: float,
    seed: int,
    log: Path,
    rate_hz: float = RATE_HZ,
    model: str = "stops",
    progress: Callable[[float, list[Row]], None] = lambda *_: None,
    ended: Callable[[], bool] = bool,
) -> Result:
    """Run a stage for a simulated time.

    `progress` takes the simulated time in s, and the minutes so far, at the end of each daemon;
    `ended` returns whether to end early.
    """
    began_s, began_cpu_s = perf_counter(), process_time()
    # In memory where possible: a daemon syncs its files, and virtual time does not wait for a disk.
    memory = "/dev/shm" if Path("/dev/shm").is_dir() else None  # noqa: S108 - a folder in it
    with tempfile.TemporaryDirectory(prefix="pz-", dir=memory) as name, log.open("w") as stream:
        folder = Path(name)
        source = configuration(folder, **_changes(rate_hz, model))
        identified = from_model_file(load_model(model_path(model)))
        observer = Observer(RANGE_UM, folder, identified)
        machine = Machine(source, folder, seed, observer.take)
        observer.device = machine.rig
        commands = Commands(machine, observer, seed, duration_s, ended)
        found: list[str] = []
        with machine.installed(stream):
            while not commands.over and not found:
                found += _run(machine, commands)
                progress(machine.clock.elapsed_s, observer.rows)
    found += observer.violations + machine.rig.broken + machine.rig.violations
    found += grown(observer.rows)
    violations = found + logged(log.read_text(encoding="utf-8"))
    took_s = perf_counter() - began_s, process_time() - began_cpu_s
    return Result(seed, observer.rows, observer, commands, machine.rig, violations, took_s)


def _run(machine: Machine, commands: Commands) -> list[str]:
    """Run one daemon; return what went wrong."""
    try:
        in_order = machine.run_daemon(commands)
    except (ClientError, RuntimeError) as error:
        return [f"at {machine.clock.t_ns / 1e9:.2f} s: {error}"]
    if in_order is commands.killed and not commands.doubtful_end:
        what = "ended in order" if in_order else "was lost"
        return [f"at {machine.clock.t_ns / 1e9:.2f} s: the daemon {what} unexpectedly"]
    return []


def logged(text: str) -> list[str]:
    """Return what the log of the daemons must not have: an exception that nobody expected."""
    _, *tracebacks = text.split("Traceback (most recent call last):\n")
    if not tracebacks:
        return []
    first = next(line for line in tracebacks[0].splitlines() if not line.startswith(" "))
    return [f"the log has {len(tracebacks)} tracebacks, the first with {first}"]


def grown(rows: list[Row]) -> list[str]:
    """Return the bounds that memory, descriptors, threads, errors or the learned model exceed.

    Args:
        rows: One for each minute; from less than an hour, growth cannot be judged, because the
            first fault and the first recording load libraries.
    """
    found = []
    if worst := [row for row in rows if row.error_rms_pct > ERROR_RMS_PCT]:
        found.append(
            f"in {len(worst)} of {len(rows)} minutes the error is above {ERROR_RMS_PCT:g} %, "
            f"first at hour {worst[0].hour:.2f}"
        )
    if far := [row for row in rows if row.drift_pct > LEARNED_PCT]:
        found.append(
            f"in {len(far)} of {len(rows)} minutes the learned model is farther than "
            f"{LEARNED_PCT:g} % from the identified one, first at hour {far[0].hour:.2f}"
        )
    if len(rows) < FEW_MINUTES:
        return found
    part = len(rows) // 5
    early, late = rows[part : 2 * part], rows[-part:]
    for field, most in GROWS.items():
        before, after = (median(getattr(row, field) for row in of) for of in (early, late))
        if after - before > most:
            found.append(f"{field} grew from {before:g} to {after:g}, allowed: {most:g} more")
    return found
