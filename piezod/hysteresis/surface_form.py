"""The form of a model that is a surface: displacement = hysteresis of the drive.

A model has one of two forms (`forms`). The one of the paper, a sum of stops, gives the drive for a
displacement, and so is its own inverse model. This one gives the displacement for a drive: it fits
stages of which a sum of stops cannot make the loops, and its inverse is found by a search. This
file makes it a `ModelForm`, so that identification, experiments and the loop need not know which
form a model has.
"""

from dataclasses import dataclass, replace

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.everett import SIZE, surface
from piezod.hysteresis.everett_bounds import least_surface_slope
from piezod.hysteresis.everett_memory import (
    advance_displacement,
    advance_drive,
    invert_record,
    new_displacement_memory,
    new_surface_memory,
)
from piezod.hysteresis.loop_drives import SurfaceLoop
from piezod.hysteresis.memory import (
    CHANGE,
    MAXIMUM,
    MINIMUM,
    RAW,
    RISING,
    SEEN,
    FloatArray,
    Memory,
)
from piezod.hysteresis.past import SurfacePast
from piezod.hysteresis.path_relaxation import (
    NO_PATH,
    WEIGHT,
    PathRelaxation,
    relaxation_slope,
)
from piezod.hysteresis.rate_lag import new_lag
from piezod.jit import compiled


class SurfaceStage:
    """A stage without creep whose hysteresis is a surface, relaxed at first.

    Args:
        coefficients: (24,) coefficients.
        terms: (8,) constants of the optional terms, from `SurfaceForm.terms`.
    """

    def __init__(self, coefficients: FloatArray, terms: FloatArray) -> None:
        self._coefficients, self._terms = coefficients.copy(), terms
        self._memory = new_displacement_memory(self._coefficients)

    def step(self, drive: float, /) -> float:
        """Return the displacement for the next drive in [0, 1]. Real-time safe."""
        return advance_displacement(self._memory, self._coefficients, self._terms, drive)


@dataclass(frozen=True)
class SurfaceForm:
    """A smooth Everett surface on a memory of drives, see `everett`; weights are coefficients."""

    #: w of `rate_lag`, in units of the range; 0 for a hysteresis without rate.
    activation: float = 0.0
    prompt_slope: float = 0.0  #: Slope of the part that does not lag, dimensionless.
    period_s: float = 1.0  #: Sample period of records and steps.
    #: Part of the displacement that relaxes along the path of the drive; None without it.
    path: PathRelaxation | None = None

    @property
    def terms(self) -> FloatArray:
        """Constants of the optional terms, shape (8,), for the kernels."""
        path = self.path.constants if self.path else NO_PATH
        return np.concatenate((new_lag(self.activation, self.prompt_slope, self.period_s), path))

    @property
    def slow(self) -> "SurfaceForm":
        """The form of slow motion, which does not lag."""
        return replace(self, activation=0.0, prompt_slope=0.0)

    def rise(self, weights: FloatArray) -> float:
        """Return the displacement of a slow rise of the drive from rest over its range."""
        return surface(weights, 1.0, 0.0)[0] + (self.path.rise if self.path else 0.0)

    def in_units_of(self, unit: float) -> "SurfaceForm":
        """Return the form whose displacements are multiples of a unit."""
        path = self.path and replace(self.path, weight=self.path.weight / unit)
        return replace(self, prompt_slope=self.prompt_slope / unit, path=path)

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

    @property
    def cycles_to_rest(self) -> int:
        """Cycles of the whole range that bring it to rest; 0 if the lowest drive does."""
        return self.path.cycles_to_rest if self.path else 0

    def straight_line(self) -> FloatArray:
        """Return the coefficients, shape (24,), with which drive and displacement agree.

        With a path they agree less, because its part of the displacement is kept.
        """
        return (1.0 - self.least_slope_beside) * np.eye(SIZE)[0]

    def smallest_slope(self, weights: FloatArray) -> float:
        """Return a lower bound of the slopes on all loops; it is monotone if positive."""
        return least_surface_slope(weights) + self.least_slope_beside

    @property
    def least_slope_beside(self) -> float:
        """Lower bound of the slopes that the optional terms add."""
        return self.path.least_slope if self.path else 0.0

    def projected(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients, shape (24,), if the surface can be inverted.

        Raises:
            ModelError: If it cannot: a surface is identified such that it can.
        """
        slope = self.smallest_slope(weights)
        if slope <= 0.0:
            message = f"the surface is not monotone: its smallest slope may be {slope:.3g}"
            raise ModelError(f"{message}, allowed is above 0; identify again")
        return weights.copy()

    def reachable(self, positions: FloatArray) -> FloatArray:
        """Return displacements, shape (n,), or the nearest ones that the form may have.

        Loops that do not close leave [0, 1], at drives inside the range.
        """
        return np.clip(positions, -self._beyond, 1.0 + self._beyond)

    @property
    def _beyond(self) -> float:
        return self.path.reach if self.path else 0.0

    def drives_at(
        self, weights: FloatArray, positions: FloatArray, deadband: float = 0.0
    ) -> FloatArray:
        """Return the drives for a record of displacements, shape (n,).

        Args:
            weights: (24,) coefficients.
            positions: (n,) displacements that are reachable.
            deadband: Width of the backlash before the memory, in units of the range.
        """
        drives = np.empty_like(positions)
        memory = new_surface_memory()
        invert_record(
            memory, weights, self.terms, deadband, np.ascontiguousarray(positions), drives
        )
        return drives

    def positions_at(self, weights: FloatArray, drives: FloatArray) -> FloatArray:
        """Return the displacements for a record of drives in [0, 1], shape (n,)."""
        positions = np.empty_like(drives)
        memory = new_displacement_memory(weights)
        _follow(memory, weights, self.terms, np.ascontiguousarray(drives), positions)
        return positions

    def stage(self, weights: FloatArray) -> SurfaceStage:
        """Return a relaxed stage, which makes `positions_at` step by step."""
        return SurfaceStage(weights, self.terms)

    def past(self, weights: FloatArray) -> SurfacePast:
        """Return the past of a relaxed stage."""
        return SurfacePast(weights, self.terms)

    def widest_loop(
        self, weights: FloatArray, positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the drives on both branches of the widest slow loop, shape (n,) each."""
        drives = self.slow.drives_at(weights, np.concatenate((positions, positions[::-1])))
        return drives[: positions.size], drives[positions.size :][::-1]

    def position_range(
        self, weights: FloatArray, drives: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and the highest displacement at drives, shape (n,) each."""
        widest = surface(weights, 1.0, 0.0)[0]
        rising, falling = np.array(
            [
                (surface(weights, drive, 0.0)[0], widest - surface(weights, 1.0, drive)[0])
                for drive in drives.tolist()
            ]
        ).T
        low, high = self.path.range_at(drives) if self.path else (0.0, 0.0)
        return np.minimum(rising, falling) + low, np.maximum(rising, falling) + high

    def loop(self, positions: FloatArray) -> SurfaceLoop:
        """Return what gives the drives at these displacements, (n,), of slow motion."""
        return SurfaceLoop(self.slow.terms, positions, self._beyond)

    def as_recorded(self, weights: FloatArray) -> FloatArray:
        """Return the coefficients, shape (..., 24)."""
        return weights


def surface_regressors(drives: FloatArray, form: SurfaceForm) -> FloatArray:
    """Return the factors of the coefficients, prompt slope and weight of the path, shape (n, 26).

    Args:
        drives: (n,) drives in [0, 1], evenly in time; the memory is relaxed before the first.
        form: The form; its prompt slope and the weight of its path have no effect.
    """
    regressors = np.empty((drives.size, SIZE + 2))
    _fill_regressors(new_surface_memory(), form.terms, np.ascontiguousarray(drives), regressors)
    return regressors


def branch_slopes(coefficients: FloatArray, drives: FloatArray, form: SurfaceForm) -> FloatArray:
    """Return the slope of the present branch at each drive of a record, shape (n,).

    Args:
        coefficients: (24,) coefficients.
        drives: (n,) drives in [0, 1], evenly in time; the memory is relaxed before the first.
        form: The form.
    """
    slopes, memory = np.empty_like(drives), new_surface_memory()
    _fill_slopes(memory, coefficients, form.terms, np.ascontiguousarray(drives), slopes)
    return slopes


@compiled
def _fill_slopes(
    memory: Memory,
    coefficients: FloatArray,
    terms: FloatArray,
    drives: FloatArray,
    slopes: FloatArray,
) -> None:
    for k in range(drives.size):
        advance_drive(memory, terms, 0.0, drives[k])
        slopes[k] = _branch_slope(memory, coefficients, terms)


@compiled
def _branch_slope(memory: Memory, coefficients: FloatArray, terms: FloatArray) -> float:
    """Return the slope of the branch of the last drive, without the part that does not lag."""
    levels, counts, drive = memory.levels, memory.counts, memory.last[SEEN]
    rising = counts[RISING] == 1
    if rising:
        _, slope, _ = surface(coefficients, drive, levels[MINIMUM, counts[MINIMUM] - 1])
    else:
        _, _, slope = surface(coefficients, levels[MAXIMUM, counts[MAXIMUM] - 1], drive)
    return slope + terms[WEIGHT] * relaxation_slope(terms, memory.last, rising)


@compiled
def _fill_regressors(
    memory: Memory, terms: FloatArray, drives: FloatArray, regressors: FloatArray
) -> None:
    now, last = memory.now, memory.last
    for k in range(drives.size):
        advance_drive(memory, terms, 0.0, drives[k])
        for j in range(now.size):
            regressors[k, j] = now[j]
        regressors[k, now.size] = last[RAW] - last[SEEN]
        regressors[k, now.size + 1] = last[CHANGE]


@compiled
def _follow(
    memory: Memory,
    coefficients: FloatArray,
    terms: FloatArray,
    drives: FloatArray,
    positions: FloatArray,
) -> None:
    for k in range(drives.size):
        positions[k] = advance_displacement(memory, coefficients, terms, drives[k])
