"""The form of a model that is a surface: displacement = hysteresis of the drive."""

from dataclasses import dataclass, replace

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.everett_bounds import least_surface_slope
from piezod.hysteresis.everett_memory import (
    advance_displacement,
    advance_drive,
    drive_for,
    new_displacement_memory,
    new_surface_memory,
)
from piezod.hysteresis.memory import (
    MAXIMUM,
    MINIMUM,
    RAW,
    RISING,
    SEEN,
    FloatArray,
    Memory,
)
from piezod.hysteresis.rate_lag import new_lag
from piezod.jit import compiled


class SurfaceStage:
    """A stage without creep whose hysteresis is a surface, relaxed at first.

    Args:
        coefficients: (24,) coefficients.
        lag: (3,) lag behind the drive, from `new_lag`.
    """

    def __init__(self, coefficients: FloatArray, lag: FloatArray) -> None:
        self._coefficients, self._lag = coefficients.copy(), lag
        self._memory = new_displacement_memory(self._coefficients)

    def step(self, drive: float, /) -> float:
        """Return the displacement for the next drive in [0, 1]. Real-time safe."""
        return advance_displacement(self._memory, self._coefficients, self._lag, drive)


@dataclass(frozen=True)
class SurfaceForm:
    """A smooth Everett surface on a memory of drives, see `everett`; weights are coefficients.

    Attributes:
        activation: w of `rate_lag`, in units of the range; 0 for a hysteresis without rate.
        prompt_slope: Slope of the part that does not lag, dimensionless.
        period_s: Sample period of records and steps.
    """

    activation: float = 0.0
    prompt_slope: float = 0.0
    period_s: float = 1.0

    @property
    def lag(self) -> FloatArray:
        """Lag behind the drive, shape (3,), for the kernels."""
        return new_lag(self.activation, self.prompt_slope, self.period_s)

    def sampled(self, period_s: float) -> "SurfaceForm":
        """Return the form for records and steps of this period, in s."""
        return replace(self, period_s=period_s)

    @property
    def size(self) -> int:
        """Number of coefficients, 24."""
        return SIZE

    @property
    def two_sided(self) -> bool:
        """False: every coefficient serves both branches."""
        return False

    def straight_line(self) -> FloatArray:
        """Return the coefficients, shape (24,), with which drive and displacement agree."""
        return np.eye(SIZE)[0]

    def smallest_slope(self, weights: FloatArray) -> float:
        """Return a lower bound of the slopes on all loops; it is monotone if positive."""
        return least_surface_slope(weights)

    def projected(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients, shape (24,), if the surface can be inverted.

        Raises:
            ModelError: If it cannot: a surface is identified such that it can.
        """
        slope = least_surface_slope(weights)
        if slope <= 0.0:
            message = f"the surface is not monotone: its smallest slope may be {slope:.3g}"
            raise ModelError(f"{message}, allowed is above 0; identify again")
        return weights.copy()

    def drives_at(
        self, weights: FloatArray, positions: FloatArray, deadband: float = 0.0
    ) -> FloatArray:
        """Return the drives for a record of displacements, shape (n,).

        Args:
            weights: (24,) coefficients.
            positions: (n,) displacements in [0, 1].
            deadband: Width of the backlash before the memory, in units of the range.
        """
        drives = np.empty_like(positions)
        memory = new_surface_memory()
        _invert(memory, weights, self.lag, deadband, np.ascontiguousarray(positions), drives)
        return drives

    def positions_at(self, weights: FloatArray, drives: FloatArray) -> FloatArray:
        """Return the displacements for a record of drives in [0, 1], shape (n,)."""
        positions = np.empty_like(drives)
        memory = new_displacement_memory(weights)
        _follow(memory, weights, self.lag, np.ascontiguousarray(drives), positions)
        return positions

    def stage(self, weights: FloatArray) -> SurfaceStage:
        """Return a relaxed stage, which makes `positions_at` step by step."""
        return SurfaceStage(weights, self.lag)

    def widest_loop(
        self, weights: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the drives on both branches of the widest slow loop, shape (n,) each."""
        slow = SurfaceForm()
        drives = slow.drives_at(weights, np.concatenate((positions, positions[::-1])))
        return drives[: positions.size], drives[positions.size :][::-1]

    def drive_gradient(self, weights: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the change of the drives per change of each coefficient, shape (n, 24)."""
        memory, rows, slow = new_surface_memory(), [], new_lag(0.0, 0.0, 1.0)
        for position in positions.tolist():
            drive = drive_for(memory, weights, slow, position)
            advance_drive(memory, slow, 0.0, drive)
            rows.append(-memory.now / _branch_slope(memory, weights))  # the position stays
        return np.array(rows)

    def as_recorded(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients, shape (..., 24)."""
        return weights


def surface_regressors(drives: FloatArray, activation: float, period_s: float) -> FloatArray:
    """Return the factors of the coefficients and of the prompt slope, shape (n, 25).

    Args:
        drives: (n,) drives in [0, 1], evenly in time; the memory is relaxed before the first.
        activation: w of `rate_lag`, in units of the range.
        period_s: Sample period, in s.
    """
    regressors, lag = np.empty((drives.size, SIZE + 1)), new_lag(activation, 0.0, period_s)
    _fill_regressors(new_surface_memory(), lag, np.ascontiguousarray(drives), regressors)
    return regressors


def branch_slopes(
    coefficients: FloatArray, drives: FloatArray, activation: float, period_s: float
) -> FloatArray:
    """Return the slope of the present branch at each drive of a record, shape (n,).

    Args:
        coefficients: (24,) coefficients.
        drives: (n,) drives in [0, 1], evenly in time; the memory is relaxed before the first.
        activation: w of `rate_lag`, in units of the range.
        period_s: Sample period, in s.
    """
    slopes, lag = np.empty_like(drives), new_lag(activation, 0.0, period_s)
    memory = new_surface_memory()
    _fill_slopes(memory, coefficients, lag, np.ascontiguousarray(drives), slopes)
    return slopes


@compiled
def _fill_slopes(
    memory: Memory,
    coefficients: FloatArray,
    lag: FloatArray,
    drives: FloatArray,
    slopes: FloatArray,
) -> None:
    for k in range(drives.size):
        advance_drive(memory, lag, 0.0, drives[k])
        slopes[k] = _branch_slope(memory, coefficients)


@compiled
def _branch_slope(memory: Memory, coefficients: FloatArray) -> float:
    """Return the slope of the branch of the last drive."""
    levels, counts, drive = memory.levels, memory.counts, memory.last[SEEN]
    if counts[RISING] == 1:
        _, slope, _ = surface(coefficients, drive, levels[MINIMUM, counts[MINIMUM] - 1])
    else:
        _, _, slope = surface(coefficients, levels[MAXIMUM, counts[MAXIMUM] - 1], drive)
    return slope


@compiled
def _fill_regressors(
    memory: Memory, lag: FloatArray, drives: FloatArray, regressors: FloatArray
) -> None:
    now, last = memory.now, memory.last
    for k in range(drives.size):
        advance_drive(memory, lag, 0.0, drives[k])
        for j in range(now.size):
            regressors[k, j] = now[j]
        regressors[k, now.size] = last[RAW] - last[SEEN]


@compiled
def _follow(
    memory: Memory,
    coefficients: FloatArray,
    lag: FloatArray,
    drives: FloatArray,
    positions: FloatArray,
) -> None:
    for k in range(drives.size):
        positions[k] = advance_displacement(memory, coefficients, lag, drives[k])


@compiled
def _invert(
    memory: Memory,
    coefficients: FloatArray,
    lag: FloatArray,
    deadband: float,
    positions: FloatArray,
    drives: FloatArray,
) -> None:
    for k in range(positions.size):
        drives[k] = drive_for(memory, coefficients, lag, positions[k])
        advance_drive(memory, lag, deadband, drives[k])
