"""The work of `piezod voltages`."""

from collections.abc import Sequence
from math import inf, isfinite
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from piezod.cli.output import new_console, print_json, print_warnings
from piezod.config.axes import AxisConfig
from piezod.config.daemon import load_daemon
from piezod.config.drive_limits import DriveLimit
from piezod.devices import registry
from piezod.errors import DataError
from piezod.inverse.loaded_model import LoadedModel, Plan, even_rate_hz, load_model
from piezod.reading.choices import DRIVE, TIME, TRAJECTORY, Choices, Role
from piezod.reading.record import ReadRecord, read_record
from piezod.records.csv_file import write_csv

_LIMITS: Final = (DriveLimit.RANGE, DriveLimit.SLEW)


class Job(NamedTuple):
    """What `piezod voltages` is asked for."""

    model: Path
    trajectory: Path
    out: Path
    loop_hz: float | None  #: Rate of the voltages, in Hz; None for that of the trajectory.
    from_v: float | None  #: Voltage at the start, in V; None for rest.
    after: Path | None  #: Voltages before.
    config: Path | None  #: Configuration of the stage.
    axis: str | None  #: Axis in it.
    choices: Choices  #: What the command line says about the columns of the trajectory.


def write_voltages(job: Job, *, json: bool) -> None:
    """Compute the voltages for a trajectory, write them, and print a summary."""
    model = load_model(job.model, axis=axis_of(job.config, job.axis))
    read = _table(job.trajectory, TRAJECTORY, job.choices)
    t_s, position_um = read.columns["t_s"], read.columns["command_um"]
    rate_hz = job.loop_hz or even_rate_hz(t_s)
    after_v = None
    if job.after is not None:
        after_v = _table(job.after, (TIME, DRIVE), Choices()).columns["drive_v"]
    plan = model.plan(t_s, position_um, rate_hz=rate_hz, from_v=job.from_v, after_v=after_v)
    columns = plan._asdict()
    del columns["merged_pairs"]
    write_csv(job.out, columns)
    low_v, high_v = float(np.min(plan.drive_v)), float(np.max(plan.drive_v))
    slew_v_per_s = float(np.max(np.abs(plan.slew_v_per_s)))
    lookahead_s, warnings = model.lookahead_s(rate_hz), _warnings(model, plan)
    if json:
        print_json(
            {
                **{"model": str(job.model), "trajectory": str(job.trajectory)},
                **{"out": str(job.out), "samples": plan.t_s.size},
                **{"rate_hz": rate_hz, "lookahead_s": lookahead_s},
                **{"drive_v": [low_v, high_v], "largest_slew_v_per_s": slew_v_per_s},
                "limited": {
                    kind.value: int(np.sum(plan.limited == kind.value)) for kind in _LIMITS
                },
                "uncertainty": model.uncertainty._asdict(),
                "understood": read.understood,
                "warnings": warnings,
            }
        )
        return
    console = new_console()
    for sentence in read.understood:
        console.print(sentence, soft_wrap=True)
    console.print(
        f"{job.out}: {plan.t_s.size} voltages at {rate_hz:.6g} Hz, {low_v:.4g} to {high_v:.4g} V, "
        f"largest slew {slew_v_per_s:.4g} V/s\n"
        f"They come {1e3 * lookahead_s:.3g} ms early, by a period and the delay.\n"
        f"{_errors_of(model)}",
        soft_wrap=True,
    )
    print_warnings(console, warnings)


def axis_of(config: Path | None, name: str | None) -> AxisConfig | None:
    """Return an axis of a configuration; None without one.

    Raises:
        ConfigError: If the configuration cannot be used.
        DataError: If it has no such axis, or several and none is named.
    """
    if config is None:
        return None
    axes = load_daemon(config, registry).axes
    if name is None and len(axes) == 1:
        (name,) = axes
    if name not in axes:
        raise DataError(f"{config}: give --axis, one of {', '.join(axes)} (got {name})")
    return axes[name]


def _table(path: Path, roles: Sequence[Role], choices: Choices) -> ReadRecord:
    """Return columns over time, which need not be even, in a file of any known format."""
    return read_record(
        path, choices, roles=roles, min_samples=2, max_step_periods=inf, command="voltages"
    )


def _errors_of(model: LoadedModel) -> str:
    known = model.uncertainty
    voltage = f"{known.voltage_max_v:.2g} V worst, {known.voltage_rms_v:.2g} V rms"
    position = ""
    if isfinite(known.position_max_um):
        position = f"; {known.position_max_um:.2g} µm worst, {known.position_rms_um:.2g} µm rms"
    return f"Errors of the model on the record of its identification: {voltage}{position}"


def _warnings(model: LoadedModel, plan: Plan) -> list[str]:
    warnings = []
    (low_um, high_um), limits = model.position_range_um, model.limits
    for kind, allowed in zip(
        _LIMITS,
        (
            f"reachable are {low_um:.4g} to {high_um:.4g} µm",
            f"allowed are {limits.slew_v_per_s:.4g} V/s",
        ),
        strict=True,
    ):
        rows = np.flatnonzero(plan.limited == kind.value)
        if rows.size:
            first = f"the first at {plan.t_s[rows[0]]:.6g} s"
            warnings.append(f"the {kind.value} cuts {rows.size} voltages, {first}: {allowed}")
    if plan.merged_pairs:
        what = f"the memory was full and has dropped {plan.merged_pairs} pairs of turning points"
        warnings.append(f"{what}, as the loop would")
    return warnings
