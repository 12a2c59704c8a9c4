"""Recursive least squares on the coefficients of a surface, with an offset.

This is the Kalman filter of `rls`, in forward form. The regressors come from the drive, which is
known without noise:

    displacement = Σ c_ij b_ij + offset,   K = P b / (R + b' P b),
    c ← c + K e,   P ← P - K b' P + Q.

A change of gain moves all coefficients in proportion. P and Q have a part along the coefficients
for it, so that it is learned faster than a change of shape; a scale of its own is not needed.
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis import surface_rls_kernel as kernel
from piezod.hysteresis.adaptation import LearnedModel
from piezod.hysteresis.bank import checked_deadband, checked_pairs
from piezod.hysteresis.covariance import (
    DECAY,
    MEASUREMENT_VARIANCE,
    OFFSET_BOUND,
    OFFSET_VARIANCE,
    OFFSET_WALK,
)
from piezod.hysteresis.everett import SIZE
from piezod.hysteresis.everett_bounds import slope_rows
from piezod.hysteresis.everett_memory import new_surface_memory, relax_surface
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    MERGED,
    SEEN,
    FloatArray,
    Memory,
    assign_memory,
    relax,
)
from piezod.hysteresis.surface_form import SurfaceForm

SHAPE_VARIANCE, SHAPE_BOUND, SHAPE_WALK = 1e-5, 1e-4, 1e-10
"""Initial and largest variance of a coefficient, and the variance that it gains per step."""
GAIN_VARIANCE, GAIN_WALK = 1e-6, 1e-9
"""Initial variance of a common factor of all coefficients, and its growth per step."""


class SurfaceIdentifier:
    """Adapts coefficients and offset, each at the rate that its random walk and the pairs allow.

    Args:
        weights: (24,) coefficients of an identified surface.
        form: Form of the surface; without optional terms by default.
        pace: Factor of all random walks and of the information of a pair, above 0.
        deadband: Width of the backlash before the memory of drives, in units of the range.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If an argument is outside its range, or the surface cannot be inverted.
    """

    def __init__(
        self,
        weights: npt.ArrayLike,
        form: SurfaceForm | None = None,
        *,
        pace: float = 1.0,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        self._weights, self._scalars = np.zeros(SIZE), np.zeros(5)
        self._form = form or SurfaceForm()
        self._scalars[kernel.FLOOR] = kernel.SMALLEST - self._form.least_slope_beside
        self._memory = new_surface_memory(capacity)
        self._deadband = checked_deadband(deadband)
        if not pace > 0.0:
            raise ModelError(f"the pace is above 0, got {pace:g}")
        self._covariance, self._walk = np.zeros((2, SIZE + 1, SIZE + 1))
        vectors = np.zeros((3, SIZE + 1))
        vectors[DECAY] = np.sqrt(1.0 - SHAPE_WALK * pace / SHAPE_BOUND)
        vectors[DECAY, -1] = np.sqrt(1.0 - OFFSET_WALK * pace / OFFSET_BOUND)
        self._pace = pace
        rows = slope_rows()
        self._arguments = (
            *self._memory,
            self._weights,
            self._scalars,
            self._covariance,
            self._walk,
            vectors,
            rows,
            np.abs(rows).max(axis=0),
            self._deadband,
        )
        self._terms, self._variance = self._form.terms, MEASUREMENT_VARIANCE / pace
        self.adopt(weights)

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, both values normalised; return the error. Real-time safe.

        Args:
            position: Displacement without creep; if it is not finite, nothing is learned.
            drive: Drive in force when `position` was sampled.
            learn: Whether to learn from the pair; the memory advances in either case.

        Returns:
            Drive minus the drive that the model before this step expects at the displacement. It is
            not finite if the pair is not.
        """
        return kernel.step(
            *self._arguments, self._variance, self._terms, float(position), float(drive), learn
        )

    def run(self, positions: npt.ArrayLike, drives: npt.ArrayLike) -> FloatArray:
        """Adapt to a record of pairs, shape (n,) each; return the errors, shape (n,).

        Raises:
            ModelError: If the shapes differ.
        """
        pairs = zip(*checked_pairs(positions, drives), strict=True)
        return np.array([self.step(float(x), float(v)) for x, v in pairs])

    def predict(self, weights: FloatArray, offset: float, scale: float) -> float:  # noqa: ARG002 - a surface has no scale
        """Return the drive that another model expects at the last displacement. Real-time safe."""
        return kernel.predicted_drive(self._memory.now, self._scalars, weights, float(offset))

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace coefficients and offset, and restart their uncertainty.

        Raises:
            ModelError: If they are not 24 finite coefficients of a surface that can be inverted and
                a finite offset, or if there is a scale, which a surface does not have.
        """
        array = np.asarray(weights, dtype=np.float64)
        if array.shape != (SIZE,) or not np.all(np.isfinite(array + offset)) or scale:
            message = f"need {SIZE} finite weights, a finite offset and no scale, got {array}"
            raise ModelError(f"{message}, {offset:g} and {scale:g}")
        self._weights[:] = self._form.projected(array)
        self._scalars[kernel.OFFSET], self._scalars[kernel.MARGIN] = offset, 0.0
        pace, along = self._pace, np.outer(array, array)
        for matrix, shape, gain, drift in (
            (self._covariance, SHAPE_VARIANCE, GAIN_VARIANCE, OFFSET_VARIANCE),
            (self._walk, SHAPE_WALK * pace, GAIN_WALK * pace, OFFSET_WALK * pace),
        ):
            matrix[:SIZE, :SIZE] = shape * np.eye(SIZE) + gain * along
            matrix[:SIZE, SIZE] = matrix[SIZE, :SIZE] = 0.0
            matrix[SIZE, SIZE] = drift

    def approach(self, model: LearnedModel, share: float) -> None:
        """Go a share of the way to another model; the uncertainty stays. Real-time safe.

        Args:
            model: Surface that can be inverted, without a scale.
            share: Share of the way, in [0, 1].
        """
        self._weights += share * (model.weights - self._weights)
        self._scalars[kernel.OFFSET] += share * (model.offset - self._scalars[kernel.OFFSET])
        self._scalars[kernel.MARGIN] = 0.0

    def expect_noise(self, variance: float) -> None:
        """Trust the next pairs less if they have more noise than usual. Real-time safe."""
        self._variance = max(variance, MEASUREMENT_VARIANCE) / self._pace

    def take_over(self, memory: Memory) -> None:
        """Take over the hysteresis memory of a stage of the same form, see `past`."""
        assign_memory(self._memory, memory)

    def reset(self) -> None:
        """Clear the hysteresis memory; the learned model stays."""
        relax(self._memory)
        relax_surface(self._memory)

    @property
    def weights(self) -> FloatArray:
        """Coefficients, shape (24,); always the same array, which changes in place."""
        return self._weights

    @property
    def offset(self) -> float:
        """Offset of the displacement, in units of the range."""
        return float(self._scalars[kernel.OFFSET])

    @property
    def scale(self) -> float:
        """0: a change of gain is part of the coefficients."""
        return 0.0

    @property
    def position(self) -> float:
        """Drive at the input of the memory, after the dead-band. Real-time safe."""
        return float(self._memory.last[SEEN])

    @property
    def covariance(self) -> FloatArray:
        """P of [coefficients, offset], shape (25, 25), symmetric; changes in place."""
        return self._covariance

    @property
    def merged_pairs(self) -> int:
        """Number of pairs of extrema that a full memory has removed."""
        return int(self._memory.counts[MERGED])
