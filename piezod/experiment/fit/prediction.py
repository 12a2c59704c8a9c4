"""Predictions of a model: the voltage from recorded displacements, and the reverse."""

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from piezod.control.law.creep import CreepLaw
from piezod.control.law.model import StageModel
from piezod.experiment.fit.record import Record
from piezod.hysteresis.creep import add_creep, remove_creep
from piezod.hysteresis.memory import FloatArray

LAG_SPREAD: Final = 0.25
"""Usual deviation of a lag from its assumed start, where the past of a record is not known, in
units of the range."""


def quick_positions(model: StageModel, record: Record) -> FloatArray:
    """Return recorded displacements without creep and first mode, normalised, shape (n,).

    If the stage had not rested before, its creep then is the one that fits best. The motion of the
    mode is the one that follows from the recorded voltage: its inverse, the second
    derivative of the displacement, would be mostly noise.
    """
    ringing_um: FloatArray | float = 0.0
    if model.mode is not None:
        ringing_um = predicted_um(model, record) - predicted_um(replace(model, mode=None), record)
    x = model.position_um.to_unit(record.position_um - ringing_um)
    if not model.creep.weights.size:
        return x
    before, lags = _past_of(model, record)
    return remove_creep(model.creep.at(record.period_s), x, lags, before)


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
    y = _hysteresis(model, record)
    if model.creep.weights.size:
        before, lags = _past_of(model, record)
        y = add_creep(model.creep.at(record.period_s), y, lags, before)
    if model.mode is not None:
        y = model.mode.shown(y, model.delay_s, record.period_s)
    return model.position_um.from_unit(y)


def _hysteresis(model: StageModel, record: Record) -> FloatArray:
    """Return the displacement of the hysteresis for a recorded voltage, normalised, shape (n,)."""
    # With a mode, the delay is part of its motion, because a held drive jumps between two samples.
    delay_s = model.delay_s if model.mode is None else 0.0
    drives = model.drive_v.to_unit(record.drive_delayed_by(delay_s))
    form = model.form.sampled(record.period_s)
    return form.positions_at(model.weights, np.clip(drives, 0.0, 1.0))


class _Past(NamedTuple):
    """Creep before a record, normalised."""

    before: float  #: Displacement before it, without its creep.
    lags: FloatArray  #: (K,) lags at the first sample.


def _past_of(model: StageModel, record: Record) -> _Past:
    """Return the creep before a record.

    If it is not known whether the stage had rested, it had, or it moved as in the record, whichever
    fits better. What the lags then differ by is that which fits best beside a constant, which may
    be the zero of another day: it decays. Lags that the record does not show stay.
    """
    x = model.position_um.to_unit(record.position_um)
    rested, moved = float(x[0]), float(np.mean(x))
    if record.from_rest:
        return _after(model, rested)
    counted, y = record.counted(model.delay_s), _hysteresis(model, record)
    creep = model.creep.at(record.period_s)

    def missing(past: _Past) -> FloatArray:
        misses = (x - add_creep(creep, y, past.lags.copy(), past.before))[counted]
        return np.asarray(misses - np.mean(misses))

    pasts = [_after(model, before) for before in (rested, moved)]
    past = min(pasts, key=lambda each: float(np.sum(missing(each) ** 2)))
    misses, times_s = missing(past), (record.t_s - record.t_s[0])[counted]
    left = creep.weights * np.exp(-times_s[:, np.newaxis] / model.creep.time_constants_s)
    left -= np.mean(left, axis=0)
    usual = float(np.mean(misses**2)) / LAG_SPREAD**2 * np.eye(past.lags.size)
    return past._replace(lags=past.lags + np.linalg.solve(left.T @ left + usual, left.T @ misses))


def _after(model: StageModel, position: float) -> _Past:
    """Return the past of a stage that had been at a displacement for long, with its creep."""
    # After a long rest the creep is complete: before = quick (1 + Σ w).
    before = position / (1.0 + float(np.sum(model.creep.weights)))
    return _Past(before, np.full(model.creep.weights.size, before))


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
