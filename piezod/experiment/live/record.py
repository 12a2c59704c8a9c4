"""Cuts a waveform out of a recording of a running stage, and finds its errors."""

from typing import NamedTuple

import numpy as np

from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.config.waveforms.waveform import Waveform
from piezod.control.reference.motion import Reference
from piezod.errors import DataError
from piezod.experiment.live.late import late_indices
from piezod.experiment.live.setup import LiveAxis
from piezod.experiment.session.runs import with_errors
from piezod.hysteresis.forms import right_first
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import Recording
from piezod.records.recording.reader import RecordedTelemetry

SAME_UM = 1e-5
"""Largest difference of a recorded and a requested command, in µm."""
OTHER_SHARE = 0.01
"""This share of the samples may differ more: at a step, the last digit of the time decides on which
side a sample is."""


class LiveRun(NamedTuple):
    """A run on a stage."""

    case: CaseConfig  #: The case.
    mode: Mode  #: The mode.
    metrics: tuple[str, ...]  #: Names of the errors.


def cut_waveform(
    telemetry: RecordedTelemetry, name: str, axis: LiveAxis, waveform: Waveform, run: LiveRun
) -> Recording:
    """Return the recording of the waveform that was the last movement of an axis.

    Raises:
        DataError: If the recording does not contain the waveform as it was commanded, from its
            start to its end.
    """
    columns, t_s = telemetry.axes[name], telemetry.cycles["t_s"]
    # The movement number rises by one with each movement, so its first cycle is found by bisection.
    first = int(np.searchsorted(columns["motion"], columns["motion"][-1]))
    if not first:
        raise DataError(f"axis {name}: the recording does not start before the movement")
    # A request is carried out at the end of a cycle, with the time of that cycle.
    started_s, start_um = float(t_s[first - 1]), float(columns["command_um"][first - 1])
    case = run.case
    motion = axis.motion(waveform, case.duration_s, start_um)
    check_followed(
        name, motion.reference_um, t_s[first:] - started_s, columns["command_um"][first:]
    )
    begin_s = started_s + motion.duration_s - case.duration_s
    begin, end = np.searchsorted(t_s, [begin_s - 1e-9, begin_s + case.duration_s - 1e-9])
    if end == t_s.size:
        raise DataError(f"axis {name}: the recording ends before the waveform")
    part = slice(int(begin), int(end))
    cut_s, position_um = t_s[part] - begin_s, columns["position_um"][part]
    command_um, true_um = columns["command_um"][part], np.full(cut_s.size, np.nan)
    end_s = begin_s + case.duration_s
    weights, weights_t_s, surface = telemetry.first_weights(name, begin_s, end_s)
    recording = Recording(
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
        weights=weights if surface else right_first(weights),
        weights_t_s=weights_t_s - begin_s,
        surface=surface,
        first_metric_index=int(np.searchsorted(cut_s, case.period_s)),
        late_t_s=cut_s[late_indices(telemetry.cycles["skipped"][part])],
    )
    return with_errors(recording, run.metrics, 1.0 / telemetry.header.rate_hz)


def missing_cycles(telemetry: RecordedTelemetry) -> int:
    """Return the number of cycles that a recording lacks: skipped by the loop, or lost."""
    skipped = telemetry.cycles["skipped"]
    return int(skipped[-1] - skipped[0]) + telemetry.lost


def check_followed(
    name: str, reference_um: Reference, since_s: FloatArray, command_um: FloatArray
) -> None:
    """Check that an axis was commanded a movement, in nearly all of its cycles.

    Args:
        name: Name of the axis.
        reference_um: Position over time since the start of the movement, in µm.
        since_s: (n,) instants of cycles since then, in s.
        command_um: (n,) their commands, in µm.

    Raises:
        DataError: If it was commanded another one.
    """
    # The same functions compute the reference in the daemon, so both agree up to rounding.
    expected_um = np.fromiter(map(reference_um, since_s.tolist()), float, since_s.size)
    other = np.count_nonzero(~(np.abs(command_um - expected_um) <= SAME_UM))
    if other > OTHER_SHARE * since_s.size + 1:
        raise DataError(
            f"axis {name}: in {other} of {since_s.size} cycles the recorded command is not that of "
            "the waveform; check whether another client moved the stage or changed its "
            "configuration"
        )
