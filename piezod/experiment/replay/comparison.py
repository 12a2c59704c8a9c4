"""Replays a recording, and compares drive and error with what was recorded."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.control.law.compensated import in_loop, learning_modes
from piezod.control.law.gains import prefix_errors
from piezod.control.law.model import StageModel
from piezod.errors import DataError
from piezod.experiment.fit.fit import fit_model
from piezod.experiment.fit.method import Spacing
from piezod.experiment.fit.prediction import predicted_um
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.settings import FitSettings
from piezod.experiment.fit.source import read_source
from piezod.experiment.fit.thinning import thinned
from piezod.experiment.replay.recorded_axis import modes_to_replay, recorded_axis
from piezod.experiment.replay.run import Replay, replay
from piezod.records.recording.reader import RecordedTelemetry

REPEATED_RMS = 0.001
"""A replay repeats a recording if its drive differs by at most this share of the drive's range,
rms. Instants between two cycles, at which a request arrived, are not recorded."""


class ModeRow(NamedTuple):
    """Errors of one recorded mode."""

    recorded: str  #: The recorded mode.
    replayed: str  #: The mode in the replay.
    duration_s: float  #: Time with an error, in s.
    recorded_rms_um: float  #: Rms of the recorded error, in µm.
    recorded_worst_um: float  #: Largest recorded error, in µm.
    rms_um: float  #: Rms of the error in the replay, in µm.
    worst_um: float  #: Largest error in the replay, in µm.
    drive_rms_v: float  #: Rms of the difference of the drives, in V.
    drive_worst_v: float  #: Largest difference of the drives, in V.


@dataclass(frozen=True)
class Comparison:
    """A replay beside its recording."""

    replay: Replay  #: The replay.
    rows: tuple[ModeRow, ...]  #: One row for each recorded mode.
    repeats: bool  #: Whether the drive is that of the recording.
    stand_in: Literal["replayed", "fitted"]  #: The model that stands in for the stage.
    #: Rms error with which that model describes the positions of the record, without a constant, in
    #: µm; smaller differences of errors mean nothing. NaN if it was not chosen.
    stand_in_um: float
    warnings: tuple[str, ...]  #: Reservations, a sentence each.


def replay_recording(
    path: Path,
    telemetry: RecordedTelemetry,
    axis: str,
    config: AxisConfig,
    model: StageModel,
    *,
    mode: Mode | None = None,
    learned: bool = False,
) -> Comparison:
    """Replay one axis of a recording.

    Args:
        path: The recording.
        telemetry: The recording, or the part of it to replay.
        axis: Name of the axis.
        config: Configuration of the axis.
        model: Model for the control law.
        mode: Mode for the whole recording; the recorded modes if None.
        learned: Whether the model is the recorded one, so that recorded weights apply.

    Raises:
        DataError: If the recording cannot be replayed.
        ModelError: If a gain of the configuration is not safe with this model.
    """
    recorded = recorded_axis(telemetry, axis)
    modes = modes_to_replay(recorded, mode)
    with prefix_errors(axis):
        zeroed = model.zeroed_at(config.limits.rest_v)
    model = in_loop(config, zeroed, None, 1.0 / telemetry.header.rate_hz)
    if learned:
        model = _with_recorded_weights(model, telemetry, axis, config, str(modes[0]))
    stand_in, stand_in_um = _stand_in(path, axis, model)
    replayed = replay(recorded, config, model, stand_in, modes, telemetry.header.rate_hz)
    judged, range_v = recorded.judged, float(np.ptp(recorded.in_force_v))
    difference_v = replayed.drive_difference_v[judged]
    return Comparison(
        replay=replayed,
        rows=tuple(_rows(replayed, telemetry.header.rate_hz)),
        repeats=_rms(difference_v) <= REPEATED_RMS * range_v,
        stand_in="replayed" if stand_in is model else "fitted",
        stand_in_um=stand_in_um,
        warnings=tuple(_warnings(replayed, config)),
    )


def _with_recorded_weights(
    model: StageModel, telemetry: RecordedTelemetry, axis: str, config: AxisConfig, mode: str
) -> StageModel:
    """Return the model with the weights in use at the start, where the mode follows them."""
    weights, _, surface = telemetry.first_weights(axis)
    # In a part of a recording the first weights may be those of a model that was adopted before.
    fits = weights.shape[1:] == model.weights.shape and surface != model.form.two_sided
    if not (mode in learning_modes(config) and fits and len(weights)):
        return model
    return replace(model, weights=np.array(weights[0]))


def _stand_in(path: Path, axis: str, model: StageModel) -> tuple[StageModel, float]:
    """Return the model that describes the recording best, and its rms error in µm.

    It is the model of the control law, or stops that are fitted to the recording. A record that
    does not support a fit is described by the model of the control law.
    """
    settings = FitSettings(spacing=Spacing.GRADED, delay_s=model.delay_s)
    try:
        record = thinned(read_source(path, 0.0, axis).record)
        fitted = fit_model(record, settings).model
    except DataError:
        return model, float("nan")
    return min(((each, _error_um(each, record)) for each in (fitted, model)), key=itemgetter(1))


def _error_um(model: StageModel, record: Record) -> float:
    """Return the rms error of predicted positions, in µm; a constant changes no difference.

    The first mode is left out, as `StandIn` does.
    """
    errors_um = predicted_um(replace(model, mode=None), record) - record.position_um
    return float(np.std(errors_um[record.counted(model.delay_s)]))


def _rows(replayed: Replay, rate_hz: float) -> Iterator[ModeRow]:
    recorded = replayed.recorded
    for mode in dict.fromkeys(recorded.modes[recorded.judged].tolist()):
        rows = recorded.judged & (recorded.modes == mode)
        before_um, after_um = replayed.recorded_error_um[rows], replayed.error_um[rows]
        difference_v = replayed.drive_difference_v[rows]
        yield ModeRow(
            recorded=mode,
            replayed=str(replayed.modes[rows][0]),
            duration_s=float(np.count_nonzero(rows) / rate_hz),
            recorded_rms_um=_rms(before_um),
            recorded_worst_um=float(np.max(np.abs(before_um))),
            rms_um=_rms(after_um),
            worst_um=float(np.max(np.abs(after_um))),
            drive_rms_v=_rms(difference_v),
            drive_worst_v=float(np.max(np.abs(difference_v))),
        )


def _warnings(replayed: Replay, config: AxisConfig) -> Iterator[str]:
    recorded, rest_v = replayed.recorded, config.limits.rest_v
    low_v, high_v = float(np.min(recorded.in_force_v)), float(np.max(recorded.in_force_v))
    slack_v = 0.01 * (high_v - low_v)
    if abs(recorded.in_force_v[0] - rest_v) > slack_v:
        yield (
            f"The recording starts at {recorded.in_force_v[0]:.4g} V and not at rest: the "
            "hysteresis memory before it is not known, and the replay starts with a relaxed one. "
            "Record from before `piezod arm`."
        )
    beyond = (replayed.next_v < low_v - slack_v) | (replayed.next_v > high_v + slack_v)
    if share := float(np.mean(beyond[recorded.follows])):
        yield (
            f"In {100 * share:.2g} % of the cycles the replay drives beyond the recorded voltages, "
            f"{low_v:.4g} to {high_v:.4g} V, where the recording shows nothing of the stage: the "
            "errors may be too small or too large there."
        )
    skipped = int(np.sum(recorded.skipped))
    if skipped:
        yield f"The loop skipped {skipped} periods, in which the voltage was held."


def _rms(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(values**2)))
