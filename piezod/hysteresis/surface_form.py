"""The form of a model that is a surface: displacement = hysteresis of the drive."""

from dataclasses import dataclass

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
from piezod.hysteresis.memory import MAXIMUM, MINIMUM, RISING, FloatArray, IntArray, Memory
from piezod.jit import compiled


class SurfaceStage:
    """A stage without creep whose hysteresis is a surface, relaxed at first.

    Args:
        coefficients: (24,) coefficients.
    """

    def __init__(self, coefficients: FloatArray) -> None:
        self._coefficients = coefficients.copy()
        self._memory = new_displacement_memory(self._coefficients)

    def step(self, drive: float, /) -> float:
        """Return the displacement for the next drive in [0, 1]. Real-time safe."""
        return advance_displacement(self._memory, self._coefficients, drive)


@dataclass(frozen=True)
class SurfaceForm:
    """A smooth Everett surface on a memory of drives, see `everett`; weights are coefficients."""

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
        _invert(*new_surface_memory(), weights, deadband, np.ascontiguousarray(positions), drives)
        return drives

    def positions_at(self, weights: FloatArray, drives: FloatArray) -> FloatArray:
        """Return the displacements for a record of drives in [0, 1], shape (n,)."""
        positions = np.empty_like(drives)
        memory = new_displacement_memory(weights)
        _follow(*memory, weights, np.ascontiguousarray(drives), positions)
        return positions

    def stage(self, weights: FloatArray) -> SurfaceStage:
        """Return a relaxed stage, which makes `positions_at` step by step."""
        return SurfaceStage(weights)

    def widest_loop(
        self, weights: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the drives on both branches of the widest loop, shape (n,) each."""
        drives = self.drives_at(weights, np.concatenate((positions, positions[::-1])))
        return drives[: positions.size], drives[positions.size :][::-1]

    def drive_gradient(self, weights: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the change of the drives per change of each coefficient, shape (n, 24)."""
        memory, rows = new_surface_memory(), []
        for position in positions.tolist():
            drive = drive_for(memory, weights, position)
            advance_drive(memory, 0.0, drive)
            if memory.counts[RISING]:
                start = memory.levels[MINIMUM, memory.counts[MINIMUM] - 1]
                _, slope, _ = surface(weights, drive, start)
            else:
                start = memory.levels[MAXIMUM, memory.counts[MAXIMUM] - 1]
                _, _, slope = surface(weights, start, drive)
            rows.append(-memory.now / slope)  # the position stays
        return np.array(rows)

    def as_recorded(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients, shape (..., 24)."""
        return weights


@compiled
def _follow(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    coefficients: FloatArray,
    drives: FloatArray,
    positions: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    for k in range(drives.size):
        positions[k] = advance_displacement(memory, coefficients, drives[k])


@compiled
def _invert(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    coefficients: FloatArray,
    deadband: float,
    positions: FloatArray,
    drives: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    for k in range(positions.size):
        drives[k] = drive_for(memory, coefficients, positions[k])
        advance_drive(memory, deadband, drives[k])
