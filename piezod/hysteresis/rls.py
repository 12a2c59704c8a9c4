"""Recursive least squares on the slopes of the inverse model, with an offset that drifts.

This is the Kalman filter of slopes that walk at random: each pair weighs as much as it tells anew,
and the covariance P says what is not known. In slope coordinates the regressor u of a displacement
y comes straight from the plays, u_J = r_J E_J - r_{J-1} E_{J-1} with r E^l = y - (1 - r) F^r, and
is far better conditioned than that of the weights:

    drive = Σ s_J u_J - y,   K = P u / (R + u' P u),   s ← s + K e,   P ← P - K u' P + Q.

The slopes of a side keep Σ s c = 1, and so P and Q live on the plane across its cells c. The offset
of the displacement is one more state, with the regressor -1: the slope is near one.

Forgetting winds up: where pairs tell nothing, P grows without end, and the first that does throws
the weights off. Here P decays towards a bound of its own by the share Q / bound at each step, so
that no variance exceeds it, and where nothing moves nothing is learned at all.

Source: Ljung, System Identification, 2nd ed., section 11.2 (the Kalman filter interpretation).
"""

import numpy as np
import numpy.typing as npt

from piezod.errors import ModelError
from piezod.hysteresis.bank import THRESHOLDS
from piezod.hysteresis.memory import (
    DEFAULT_CAPACITY,
    RAW,
    SEEN,
    FloatArray,
    IntArray,
    Memory,
)
from piezod.hysteresis.online import (
    OFFSET,
    Learner,
    OnlineIdentifier,
    is_finite,
    observe,
    prediction,
    taught,
)
from piezod.hysteresis.slopes import fill_slopes, fill_weights, keep_invertible
from piezod.jit import compiled

REGRESSOR, GAIN, DECAY = 0, 1, 2
"""Rows of vectors, shape (3, N): u, K, and the root of what is left of each variance in a step."""

SLOPE_VARIANCE, SLOPE_BOUND = 1e-4, 1e-3
"""Variance of a slope at the start, and the largest it can have."""
OFFSET_VARIANCE, OFFSET_BOUND = 1e-6, 1e-4
"""Variance of the offset at the start, and the largest it can have; in units of the range."""


@compiled
def _fill_regressor(memory: Memory, bank: FloatArray, regressor: FloatArray) -> None:
    """Write u of both sides, then that of the offset."""
    position, order = memory.last[RAW], memory.now.size // 2
    place = 0
    for side in range(2):
        before = 0.0
        for j in range(side * order, (side + 1) * order):
            height = position - (1.0 - bank[THRESHOLDS, j]) * memory.now[j]
            regressor[place] = height - before
            before = height
            place += 1
        regressor[place] = position - before
        place += 1
    regressor[place] = -1.0


@compiled
def _fill_gain(covariance: FloatArray, vectors: FloatArray) -> float:
    """Write P u; return u' P u.

    The sum runs row by row, which P being symmetric allows and the processor prefers.
    """
    regressor, gain = vectors[REGRESSOR], vectors[GAIN]
    for j in range(gain.size):
        gain[j] = 0.0
    for i in range(gain.size):
        for j in range(gain.size):
            gain[j] += covariance[i, j] * regressor[i]
    told = 0.0
    for j in range(gain.size):
        told += regressor[j] * gain[j]
    return told


@compiled
def _update_covariance(
    covariance: FloatArray, walk: FloatArray, vectors: FloatArray, told: float
) -> None:
    """P ← D (P - (P u) (P u)' / (R + u' P u)) D + Q, symmetric to the bit."""
    gain, decay = vectors[GAIN], vectors[DECAY]
    root = 1.0 / np.sqrt(told)
    for j in range(gain.size):
        gain[j] *= root
    for i in range(gain.size):
        for j in range(gain.size):
            left = covariance[i, j] - gain[i] * gain[j]
            covariance[i, j] = left * (decay[i] * decay[j]) + walk[i, j]


@compiled
def _learn(
    memory: Memory,
    learner: Learner,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    variance: float,
    error: float,
) -> None:
    bank, slopes, shift = learner.bank, learner.slopes, learner.shift
    _fill_regressor(memory, bank, vectors[REGRESSOR])
    told = variance + _fill_gain(covariance, vectors)
    scale, gain = error / told, vectors[GAIN]
    fill_slopes(bank, learner.weights, slopes)
    cells_of_side = slopes.shape[1]
    for side in range(2):
        for j in range(cells_of_side):
            slopes[side, j] += scale * gain[side * cells_of_side + j]
    keep_invertible(slopes, learner.cells)
    fill_weights(bank, slopes, learner.weights)
    offset = shift[OFFSET] + scale * gain[gain.size - 1]
    shift[OFFSET] = min(max(offset, -1.0), 1.0)  # no drift exceeds the range
    _update_covariance(covariance, walk, vectors, told)


@compiled
def _adapt(
    memory: Memory,
    learner: Learner,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    variance: float,
    deadband: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    """Update slopes, offset and covariance with one pair; return the error before."""
    if not is_finite(position):
        return np.nan
    before = memory.last[SEEN]
    observe(memory, learner, deadband, position)
    error = drive - prediction(memory, learner, learner.weights, learner.shift[OFFSET])
    if learn and is_finite(error) and memory.last[SEEN] != before:
        _learn(memory, learner, covariance, walk, vectors, variance, taught(error))
    return error


@compiled
def _step(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    shift: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    deadband: float,
    variance: float,
    position: float,
    drive: float,
    learn: bool,
) -> float:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, shift, slopes, cells)
    return _adapt(
        memory, learner, covariance, walk, vectors, variance, deadband, position, drive, learn
    )


@compiled
def _run(
    levels: FloatArray,
    values: FloatArray,
    now: FloatArray,
    last: FloatArray,
    counts: IntArray,
    bank: FloatArray,
    weights: FloatArray,
    shift: FloatArray,
    slopes: FloatArray,
    cells: FloatArray,
    covariance: FloatArray,
    walk: FloatArray,
    vectors: FloatArray,
    deadband: float,
    variance: float,
    positions: FloatArray,
    drives: FloatArray,
    errors: FloatArray,
) -> None:
    memory = Memory(levels, values, now, last, counts)
    learner = Learner(bank, weights, shift, slopes, cells)
    for k in range(errors.size):
        position, drive = positions[k], drives[k]
        errors[k] = _adapt(
            memory, learner, covariance, walk, vectors, variance, deadband, position, drive, True
        )


def _on_planes(cells: FloatArray, slope_variance: float, offset_variance: float) -> FloatArray:
    """Return a covariance, shape (N, N): slopes vary alike, but for Σ s c; the offset by itself."""
    count = cells.shape[1]
    covariance = np.zeros((2 * count + 1, 2 * count + 1))
    for side, across in enumerate(cells):
        plane = np.eye(count) - np.outer(across, across) / (across @ across)
        block = slice(side * count, (side + 1) * count)
        covariance[block, block] = slope_variance * plane
    covariance[-1, -1] = offset_variance
    return covariance


def _checked_walk(name: str, walk: float, bound: float) -> float:
    if not 0.0 <= walk < bound:
        message = f"the walk of {name} is from 0 to below its bound of {bound:g}, got {walk:g}"
        raise ModelError(message)
    return walk


class RLSIdentifier(OnlineIdentifier):
    """Follows slopes and an offset, each as fast as the pairs tell and its walk allows.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        weights: (2 M,) weights [a^l, a^r] to start from, of a model that was identified.
        weight_walk: Variance that each slope gains in a learning step, in [0, `SLOPE_BOUND`).
        offset_walk: The same of the offset, in [0, `OFFSET_BOUND`), in units of the range squared.
        measurement_variance: R, variance of the error that no model explains, above 0.
        deadband: Width of the backlash before the memory, in units of the range; above the noise.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If an argument is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        weights: npt.ArrayLike,
        *,
        weight_walk: float = 1e-8,
        offset_walk: float = 3e-9,
        measurement_variance: float = 1e-6,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        super().__init__(bank, weights, deadband, capacity)
        if not 0.0 < measurement_variance < np.inf:
            message = f"a variance is finite and above 0, got {measurement_variance:g}"
            raise ModelError(message)
        self.measurement_variance = float(measurement_variance)
        """R; may be set in the loop, above 0, for pairs that are worth less or more."""
        _checked_walk("weights", weight_walk, SLOPE_BOUND)
        _checked_walk("the offset", offset_walk, OFFSET_BOUND)
        cells = self._learner.cells
        self._start = _on_planes(cells, SLOPE_VARIANCE, OFFSET_VARIANCE)
        self._covariance = self._start.copy()
        vectors = np.zeros((3, len(self._start)))
        vectors[DECAY] = np.sqrt(1.0 - weight_walk / SLOPE_BOUND)
        vectors[DECAY, -1] = np.sqrt(1.0 - offset_walk / OFFSET_BOUND)
        walk = _on_planes(cells, weight_walk, offset_walk)
        self._arguments = (
            *self._memory,
            *self._learner,
            self._covariance,
            walk,
            vectors,
            self._deadband,
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`; may be called in the loop.

        A pair teaches only when it moves the operators; else it tells nothing of the slopes.
        """
        return _step(
            *self._arguments, self.measurement_variance, float(position), float(drive), learn
        )

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        _run(*self._arguments, self.measurement_variance, positions, drives, errors)

    def adopt(self, weights: npt.ArrayLike, offset: float = 0.0) -> None:
        """Take over weights and an offset, and trust them as little as at the start.

        Weights that no inverse belongs to are projected onto the nearest that have one.

        Raises:
            ModelError: If they are not 2 M finite weights and a finite offset.
        """
        super().adopt(weights, offset)
        self._covariance[:] = self._start

    @property
    def covariance(self) -> FloatArray:
        """P of [slopes, offset], shape (2 M + 3, 2 M + 3), symmetric; changes in place."""
        return self._covariance
