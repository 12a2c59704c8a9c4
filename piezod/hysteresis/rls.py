"""Recursive least squares on the slopes of the inverse model, with an offset and a scale.

This is the Kalman filter for slopes that change as random walks. Each pair counts by its
information, and the covariance P holds the remaining uncertainty. In slope coordinates the
regressor of an operator input y comes directly from the plays, u_J = r_J E_J - r_{J-1} E_{J-1} with
r E^l = y - (1 - r) F^r (paper eq. (13), corrected). It is far better conditioned than the regressor
of the weights:

    drive = Σ s_J u_J - y,   K = P u / (R + u' P u),   s ← s + K e,   P ← P - K u' P + Q.

The slopes of a side keep Σ s c = 1, so P and Q live in the plane normal to its cells c. Slopes
cannot describe a drift or a change of gain of the whole stage: the operators see y = (1 + scale) x
- offset. Offset and scale are two further states, with the regressors -1 and x, because the slope
is near one.

A pair that does not move the operators teaches nothing, and `covariance` bounds P: it cannot wind
up.

Source: Ljung, System Identification, 2nd ed., section 11.2 (the Kalman filter interpretation).
"""

from functools import partial

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis import rls_kernel
from piezod.hysteresis.covariance import (
    DECAY,
    MEASUREMENT_VARIANCE,
    OFFSET_BOUND,
    OFFSET_VARIANCE,
    OFFSET_WALK,
    SCALE_BOUND,
    SCALE_VARIANCE,
    SCALE_WALK,
    SLOPE_BOUND,
    SLOPE_VARIANCE,
    WEIGHT_WALK,
    checked_walk,
    constrained_covariance,
)
from piezod.hysteresis.learner import OFFSET, SCALE
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    FloatArray,
)
from piezod.hysteresis.online import OnlineIdentifier


class RLSIdentifier(OnlineIdentifier):
    """Adapts slopes, offset and scale, each at the rate that its random walk and the pairs allow.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) initial weights [a^l, a^r], of an identified model.
        weight_walk: Variance that each slope gains per learning step, in [0, `SLOPE_BOUND`).
        offset_walk: Variance that the offset gains per learning step, in [0, `OFFSET_BOUND`), in
            units of the range squared.
        scale_walk: Variance that the scale gains per learning step, in [0, `SCALE_BOUND`).
        measurement_variance: R, variance of the error that no model explains, above 0.
        deadband: Width of the backlash before the memory, in units of the range; larger than the
            noise.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If an argument is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: npt.ArrayLike,
        *,
        weight_walk: float = WEIGHT_WALK,
        offset_walk: float = OFFSET_WALK,
        scale_walk: float = SCALE_WALK,
        measurement_variance: float = MEASUREMENT_VARIANCE,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        super().__init__(bank, weights, deadband, capacity)
        if not 0.0 < measurement_variance < np.inf:
            message = (
                f"a measurement variance must be finite and above 0, got {measurement_variance:g}"
            )
            raise ModelError(message)
        self.measurement_variance = self._usual_variance = float(measurement_variance)
        """R, above 0; may be set before each step, to give a pair more or less weight."""
        checked_walk("weights", weight_walk, SLOPE_BOUND)
        checked_walk("the offset", offset_walk, OFFSET_BOUND)
        checked_walk("the scale", scale_walk, SCALE_BOUND)
        cells = self._learner.cells
        # Kept for `adopt`, which restarts the covariance.
        self._start = constrained_covariance(cells, SLOPE_VARIANCE, OFFSET_VARIANCE, SCALE_VARIANCE)
        self._covariance = self._start.copy()
        # D of the update: P decays by Q / bound per step. The last two states are offset and scale.
        vectors = np.zeros((3, len(self._start)))
        vectors[DECAY] = np.sqrt(1.0 - weight_walk / SLOPE_BOUND)
        vectors[DECAY, -2] = np.sqrt(1.0 - offset_walk / OFFSET_BOUND)
        vectors[DECAY, -1] = np.sqrt(1.0 - scale_walk / SCALE_BOUND)
        walk = constrained_covariance(cells, weight_walk, offset_walk, scale_walk)
        arguments = (
            *self._memory,
            *self._learner,
            self._covariance,
            walk,
            vectors,
            self._deadband,
        )
        # Bound once: a partial function adds no Python frame.
        self._step, self._run_all = (
            partial(rls_kernel.step, *arguments),
            partial(rls_kernel.run, *arguments),
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`. Real-time safe.

        The identifier learns from a pair only if it moves the operators: otherwise the pair carries
        no information about the slopes.
        """
        # The variance is not in the tuple, because callers change it between steps.
        error = self._step(self.measurement_variance, float(position), float(drive), learn)
        scalars: list[float] = self._learner.scalars.tolist()
        self.offset, self.scale = scalars[OFFSET], scalars[SCALE]
        return error

    def expect_noise(self, variance: float) -> None:
        """Trust the next pairs less if they have more noise than usual. Real-time safe."""
        self.measurement_variance = self._usual_variance * max(variance / MEASUREMENT_VARIANCE, 1.0)

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        self._run_all(self.measurement_variance, positions, drives, errors)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0, scale: float = 0.0) -> None:
        """Replace weights, offset and scale, and restart their covariance.

        Weights without an inverse are projected onto the nearest weights with an inverse.

        Raises:
            ModelError: If they are not 2 M finite weights, a finite offset and a scale within
                `SCALE_LIMIT`.
        """
        super().adopt(weights, offset, scale)
        self._covariance[:] = self._start

    @property
    def covariance(self) -> FloatArray:
        """P of [slopes, offset, scale], shape (2 M + 4, 2 M + 4), symmetric; changes in place."""
        return self._covariance
