"""From the samples of a sweep to its pixels."""

from math import isfinite
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.experiment.scan.plan import ScanPlan
from piezod.hysteresis.memory import FloatArray
from piezod.units import NS_PER_S

Int64Array: TypeAlias = npt.NDArray[np.int64]
MIDDLE = 0.8
"""Share of a line, about its middle, whose errors are told: turns disturb its ends."""


class SweepSamples(NamedTuple):
    """The samples of one sweep, shape (points, columns) each."""

    sweep: int  #: Index of the sweep.
    first_ns: int  #: Time of its first sample since the first sweep, in ns.
    position_um: FloatArray  #: Measured displacement of each axis, in µm.
    true_um: FloatArray  #: True displacement, in µm; NaN if it is not known.
    detected: FloatArray  #: Values of the inputs beside, in their units.
    #: (points,) lateness of each cycle, in ns, if the loop scans; None with the clock of a device.
    late_ns: Int64Array | None = None


class SweepPixels(NamedTuple):
    """The pixels of one sweep, in the order of time."""

    sweep: int  #: Index of the sweep.
    position_um: FloatArray  #: (pixels, axes) mean measured displacement, in µm.
    true_um: FloatArray  #: (pixels, axes) mean true displacement, in µm; NaN if it is not known.
    detected: FloatArray  #: (pixels, inputs) mean of each input beside.
    dwell_s: float  #: Time of a pixel, in s.
    first_ns: Int64Array  #: (pixels,) time of its first sample since the first sweep, in ns.
    last_ns: Int64Array  #: (pixels,) time of its last sample, in ns.
    late_ns: Int64Array | None  #: (pixels,) largest lateness of its cycles, in ns.


def pixels_of(samples: SweepSamples, plan: ScanPlan, sensor_delay_s: FloatArray) -> SweepPixels:
    """Return the pixels of a sweep.

    A sensor shows a displacement late: the samples of a pixel are those later by its delay. An
    input beside is read without a delay.

    Args:
        samples: All samples of the sweep, with those of its turn.
        plan: The plan.
        sensor_delay_s: (axes,) delay of each sensor, in s.
    """
    late = sensor_delay_s * NS_PER_S / plan.interval_ns
    shifted = np.stack(
        [later(samples.position_um[:, i], late[i])[: plan.active] for i in range(late.size)],
        axis=1,
    )
    first_ns = samples.first_ns + np.arange(plan.pixels) * plan.per_pixel * plan.interval_ns
    return SweepPixels(
        samples.sweep,
        plan.pixel_means(shifted),
        plan.pixel_means(samples.true_um[: plan.active]),
        plan.pixel_means(samples.detected[: plan.active]),
        plan.per_pixel * plan.interval_ns / NS_PER_S,
        first_ns,
        first_ns + (plan.per_pixel - 1) * plan.interval_ns,
        None if samples.late_ns is None else _largest(samples.late_ns[: plan.active], plan),
    )


def _largest(values: Int64Array, plan: ScanPlan) -> Int64Array:
    return np.asarray(np.max(values.reshape(plan.pixels, plan.per_pixel), axis=1))


def later(values: FloatArray, points: float) -> FloatArray:
    """Return values some points later, between samples by a line; the last one is repeated."""
    at = np.arange(values.size) + points
    return np.asarray(np.interp(at, np.arange(values.size), values))


class PixelErrors(NamedTuple):
    """Errors of a frame in its middle, in pixels of each axis; NaN if they are not known."""

    fast_max: float  #: Largest error along the line.
    fast_rms: float  #: Its rms value.
    apart_max: float  #: Largest difference of two successive sweeps at the same pixel.
    slow_max: float  #: Largest error across the lines.
    slow_rms: float  #: Its rms value.

    @property
    def has_fast(self) -> bool:
        """Whether the errors along the line are known."""
        return isfinite(self.fast_max)

    @property
    def has_slow(self) -> bool:
        """Whether the errors across the lines are known."""
        return isfinite(self.slow_max)


class ErrorCount:
    """Adds up the errors of the sweeps of a frame, of measured or of true positions."""

    def __init__(self, plan: ScanPlan) -> None:
        self._plan = plan
        margin = round(0.5 * (1.0 - MIDDLE) * plan.pixels)
        self._middle = slice(margin, plan.pixels - margin)
        self._max = np.full(2, -np.inf)
        self._squares, self._count, self._apart = np.zeros(2), 0, -np.inf
        self._before: FloatArray | None = None

    def add(self, sweep: int, position_um: FloatArray) -> None:
        """Add a sweep, with the mean positions of its pixels, shape (pixels, axes)."""
        plan = self._plan
        rows = position_um[::-1] if plan.backward(sweep) else position_um
        rows = rows[self._middle]
        errors = np.full((2, len(rows)), np.nan)
        if plan.is_path:
            errors = self._beside_path(rows)
        elif plan.is_stack:
            errors[1] = (rows[:, 0] - plan.centres_um[0][plan.rows[sweep]]) / plan.pixel_um[0]
        else:
            errors[0] = (rows[:, 0] - plan.centres_um[0][self._middle]) / plan.pixel_um[0]
            if len(plan.axes) > 1:
                errors[1] = (rows[:, 1] - plan.centres_um[1][plan.rows[sweep]]) / plan.pixel_um[1]
            if self._before is not None:
                apart = np.max(np.abs(rows[:, 0] - self._before)) / plan.pixel_um[0]
                self._apart = max(self._apart, float(apart))
            self._before = rows[:, 0]
        self._max = np.maximum(self._max, np.max(np.abs(errors), axis=1))
        self._squares += np.mean(errors**2, axis=1)
        self._count += 1

    def _beside_path(self, position_um: FloatArray) -> FloatArray:
        """Return the errors along and across a path, shape (2, n), in pixels."""
        centres = np.stack(self._plan.centres_um, axis=1) / self._plan.pixel_um
        ahead = np.gradient(centres, axis=0)[self._middle]
        ahead /= np.hypot(*ahead.T)[:, None]
        error = position_um / self._plan.pixel_um - centres[self._middle]
        across = ahead[:, 0] * error[:, 1] - ahead[:, 1] * error[:, 0]
        return np.stack((np.sum(ahead * error, axis=1), across))

    @property
    def errors(self) -> PixelErrors:
        """The errors so far."""
        with np.errstate(invalid="ignore"):
            rms = np.sqrt(self._squares / max(self._count, 1))
        apart = self._apart if np.isfinite(self._apart) else np.nan
        return PixelErrors(
            float(self._max[0]), float(rms[0]), apart, float(self._max[1]), float(rms[1])
        )
