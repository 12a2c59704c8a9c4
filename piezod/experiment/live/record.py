"""What a recording of a running stage has of a waveform: from its start to its end, judged."""

from typing import NamedTuple

import numpy as np

from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.control.reference.motion import Motion
from piezod.control.reference.waveforms import Waveform
from piezod.errors import DataError
from piezod.experiment.error_rows import errors_pct
from piezod.experiment.live.setup import LiveAxis
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording import Recording
from piezod.records.telemetry_reader import RecordedTelemetry

SAME_UM = 1e-5
"""A recorded command is the one that was asked for within this,"""
OTHER_SHARE = 0.01
"""but for this part of the samples: at a step, time's last digit decides on which side one is."""


class LiveRun(NamedTuple):
    """What was run.

    Attributes:
        case: The case.
        mode: Its mode.
        metrics: Names of the errors to find.
    """

    case: CaseConfig
    mode: Mode
    metrics: tuple[str, ...]


def cut(
    told: RecordedTelemetry, name: str, axis: LiveAxis, waveform: Waveform, run: LiveRun
) -> Recording:
    """Return what a recording has of the waveform that was its last movement.

    Args:
        told: The recording; it begins before the movement.
        name: Name of the axis.
        axis: The axis.
        waveform: What it was to follow, in µm.
        run: What was run.

    Raises:
        DataError: If the waveform is not in it as it was commanded, from its start to its end.
    """
    columns, t_s = told.axes[name], told.cycles["t_s"]
    first = int(np.searchsorted(columns["motion"], columns["motion"][-1]))
    if not first:
        raise DataError(f"axis {name}: the recording does not begin before the movement")
    # A request is carried out at the end of a cycle, and at its time.
    started_s, start_um = float(t_s[first - 1]), float(columns["command_um"][first - 1])
    case = run.case
    motion = axis.motion(waveform, case.duration_s, start_um)
    _check_command(name, motion, t_s[first:] - started_s, columns["command_um"][first:])
    begin_s = started_s + motion.duration_s - case.duration_s
    begin, end = np.searchsorted(t_s, [begin_s - 1e-9, begin_s + case.duration_s - 1e-9])
    if end == t_s.size:
        raise DataError(f"axis {name}: the recording ends before the waveform")
    part = slice(int(begin), int(end))
    cut_s, position_um = t_s[part] - begin_s, columns["position_um"][part]
    command_um, true_um = columns["command_um"][part], np.full(cut_s.size, np.nan)
    judged = int(np.searchsorted(cut_s, case.period_s))
    weights, weights_t_s = _weights(told, name, begin_s, begin_s + case.duration_s)
    return Recording(
        axis=name,
        case=case.name,
        mode=run.mode.value,
        title=case.title,
        t_s=cut_s,
        drive_v=columns["in_force_v"][part],
        position_um=position_um,
        command_um=command_um,
        uncompensated_v=columns["uncompensated_v"][part],
        true_um=true_um,
        weights=weights,
        weights_t_s=weights_t_s,
        metrics=errors_pct(
            run.metrics, *(values[judged:] for values in (command_um, position_um, true_um))
        ),
        first_metric_index=judged,
    )


def missing_cycles(told: RecordedTelemetry) -> int:
    """Return how many cycles a recording lacks: those that the loop skipped, and those lost."""
    skipped = told.cycles["skipped"]
    return int(skipped[-1] - skipped[0]) + told.lost


def _check_command(name: str, motion: Motion, since_s: FloatArray, command_um: FloatArray) -> None:
    expected_um = np.fromiter(map(motion.reference_um, since_s.tolist()), float, since_s.size)
    other = np.count_nonzero(~(np.abs(command_um - expected_um) <= SAME_UM))
    if other > OTHER_SHARE * since_s.size + 1:
        raise DataError(
            f"axis {name}: in {other} of {since_s.size} cycles the recorded command is not that of "
            "the waveform; has somebody else moved the stage, or is its configuration another now?"
        )


def _weights(
    told: RecordedTelemetry, name: str, begin_s: float, end_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weights with those of the right operators first, and when they were so."""
    weights, t_s = told.weights[name]["weights"], told.weights[name]["weights_t_s"]
    within = (t_s >= begin_s) & (t_s < end_s)
    left, right = np.split(weights[within], 2, axis=1)
    return np.concatenate((right, left), axis=1), t_s[within] - begin_s
