"""Predictions of a model: the voltage from recorded displacements, and the reverse."""

from dataclasses import replace

import numpy as np

from piezod.control.law.creep import CreepLaw
from piezod.control.law.model import StageModel
from piezod.experiment.fit.record import Record
from piezod.hysteresis.creep import add_creep, remove_creep
from piezod.hysteresis.memory import FloatArray


def quick_positions(model: StageModel, record: Record) -> FloatArray:
    """Return recorded displacements without creep and first mode, normalised, shape (n,).

    If the stage had not rested before, its past is taken to be like the record on average. The
    motion of the mode is the one that follows from the recorded voltage: its inverse, the second
    derivative of the displacement, would be mostly noise.
    """
    ringing_um: FloatArray | float = 0.0
    if model.mode is not None:
        ringing_um = predicted_um(model, record) - predicted_um(replace(model, mode=None), record)
    x = model.position_um.to_unit(record.position_um - ringing_um)
    return without_creep(x, model.creep, record.period_s, from_rest=record.from_rest)


def predicted_v(model: StageModel, record: Record, deadband: float = 0.0) -> FloatArray:
    """Return the voltage of a model for a recorded displacement, in V, shape (n,).

    Args:
        model: The model.
        record: The record; the memory starts relaxed at its first sample.
        deadband: Width of the backlash before the memory, in units of the range.
    """
    form = model.form.sampled(record.period_s)
    y = form.reachable(quick_positions(model, record))
    return model.drive_v.from_unit(form.drives_at(model.weights, y, deadband))


def predicted_um(model: StageModel, record: Record) -> FloatArray:
    """Return the displacement of a model for a recorded voltage, in µm, shape (n,).

    Args:
        model: The model.
        record: The record; the memory starts relaxed at its first sample, and the creep of the past
            follows from the first position. Voltages outside the range of the model count as its
            ends.
    """
    # With a mode, the delay is part of its motion, because a held drive jumps between two samples.
    delay_s = model.delay_s if model.mode is None else 0.0
    drives = model.drive_v.to_unit(record.drive_delayed_by(delay_s))
    form = model.form.sampled(record.period_s)
    y = form.positions_at(model.weights, np.clip(drives, 0.0, 1.0))
    if model.creep.weights.size:
        # As in `without_creep`: the creep before the record is that of the recorded position.
        x = model.position_um.to_unit(record.position_um)
        before = float(x[0] if record.from_rest else np.mean(x))
        quick = before / (1.0 + float(np.sum(model.creep.weights)))
        lags = np.full(model.creep.weights.size, quick)
        y = add_creep(model.creep.at(record.period_s), y, lags, quick)
    if model.mode is not None:
        y = model.mode.shown(y, model.delay_s, record.period_s)
    return model.position_um.from_unit(y)


def without_creep(
    positions: FloatArray, creep: CreepLaw, period_s: float, *, from_rest: bool
) -> FloatArray:
    """Return displacements over time without creep, in the same unit, shape (n,).

    Args:
        positions: (n,) displacement, evenly in time.
        creep: Law of the creep.
        period_s: Sample period, in s.
        from_rest: Whether the lags start at the first displacement; otherwise at the mean.
    """
    if not creep.weights.size:
        return positions
    before = float(positions[0] if from_rest else np.mean(positions))
    # After a long rest the creep is complete: before = quick (1 + Σ w).
    quick = before / (1.0 + float(np.sum(creep.weights)))
    lags = np.full(creep.weights.size, quick)
    return remove_creep(creep.at(period_s), positions, lags, quick)
