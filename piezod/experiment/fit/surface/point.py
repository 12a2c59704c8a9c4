"""A point of the search for a surface: the parts of the displacement at given parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Self, TypeAlias

import numpy as np

from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.surface.creep_regressors import decays, lags_of
from piezod.experiment.fit.surface.parameters import (
    CREEP,
    DELAY,
    OFFSET,
    form_of,
    mode_of,
)
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.memory import FloatArray
from piezod.hysteresis.surface_form import surface_regressors

DrivesAt: TypeAlias = Callable[[float], FloatArray]
"""Returns the normalised drives of a record, delayed by a time in s, shape (n,)."""


@dataclass(frozen=True)
class SurfaceRecord:
    """A normalised record."""

    drives_at: DrivesAt  #: The drives, delayed.
    positions: FloatArray  #: (n,) displacement, in units of its range.
    period_s: float  #: Sample period, in s.
    before: float  #: Displacement before the record, in the same unit.
    counted: Rows  #: (n,) mask of the samples that count; the others only advance the memory.

    @cached_property
    def decay(self) -> FloatArray:
        """Decay of all lags of the creep from one, shape (n, K)."""
        return decays(self.positions.size, self.period_s)


@dataclass(frozen=True)
class Point:
    """A point of the search.

    With a first mode the drives are not delayed: the delay is part of the motion of the mode,
    because a held drive jumps between two samples.
    """

    record: SurfaceRecord  #: The record.
    parameters: FloatArray  #: (43,) parameters.
    drives: FloatArray  #: (n,) drives.
    #: (n, 26) regressors of the coefficients, of the prompt slope and of the weight of the path,
    #: without creep.
    quick: FloatArray
    lags: FloatArray  #: (n, K) lags of the creep.
    started: FloatArray  #: (n,) creep that a start of all lags from one adds.
    start: float  #: Start of all lags.
    crept: FloatArray  #: (n,) displacement with creep, without the mode and the offset.
    predicted: FloatArray  #: (n,) displacement.

    @classmethod
    def at(cls, record: SurfaceRecord, parameters: FloatArray) -> Self:
        """Return the point of these parameters, shape (43,)."""
        period_s, weights = record.period_s, parameters[CREEP:OFFSET]
        rings = mode_of(parameters, period_s) is not None
        drives = record.drives_at(0.0 if rings else float(parameters[DELAY]) * period_s)
        quick = surface_regressors(drives, form_of(parameters, period_s))
        y = quick @ parameters[:CREEP]
        start = (record.before - float(parameters[OFFSET])) / (1.0 + float(np.sum(weights)))
        lags = lags_of(y, period_s) + start * record.decay
        crept = y + lags @ weights
        predicted = shown(crept, parameters, period_s) + parameters[OFFSET]
        started = record.decay @ weights
        return cls(record, parameters, drives, quick, lags, started, start, crept, predicted)

    @property
    def rms(self) -> float:
        """Rms error, in units of the range."""
        misses = (self.predicted - self.record.positions)[self.record.counted]
        return float(np.sqrt(np.mean(misses**2)))

    def shown(self, values: FloatArray) -> FloatArray:
        """Return what the sensor shows of values, shape (n,) or (n, p), at this point."""
        return shown(values, self.parameters, self.record.period_s)

    def quick_gradient(self, place: int, step: float) -> FloatArray:
        """Return the change of the quick displacement with a parameter of the form, shape (n,)."""
        parameters = self._moved(place, step)
        form = form_of(parameters, self.record.period_s)
        there = form.positions_at(parameters[:SIZE], self.drives)
        return (there - self.quick @ self.parameters[:CREEP]) / step

    def gradient(self, place: int, step: float) -> FloatArray:
        """Return the change of the displacement with one parameter, by a difference, shape (n,).

        Args:
            place: The parameter: the delay or one of the mode, if the point has a mode.
            step: Step of the difference.
        """
        there = shown(self.crept, self._moved(place, step), self.record.period_s)
        return (there - self.shown(self.crept)) / step

    def _moved(self, place: int, step: float) -> FloatArray:
        moved = self.parameters.copy()
        moved[place] += step
        return moved


def shown(values: FloatArray, parameters: FloatArray, period_s: float) -> FloatArray:
    """Return the motion of the first mode for values; without a mode the values themselves.

    Args:
        values: (n,) or (n, p) values, evenly in time.
        parameters: (43,) parameters.
        period_s: Sample period, in s.
    """
    mode = mode_of(parameters, period_s)
    if mode is None:
        return values
    return mode.shown(values, float(parameters[DELAY]) * period_s, period_s)
