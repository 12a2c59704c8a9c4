"""Normalised least mean squares: stable for any gain below 2, however many operators there are."""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.lms import GradientIdentifier
from piezod.hysteresis.memory import DEFAULT_CAPACITY, FloatArray


class NLMSIdentifier(GradientIdentifier):
    """Normalised LMS: a step moves the error of its own pair by the same part whatever the pair.

    Source: Haykin, Adaptive Filter Theory, chapter on normalised LMS.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        gain: μ, above 0 and below 2.
        floor: ε added to ‖E - x‖², above 0, so that pairs near the ends do not teach noise.
        deadband: Width of the backlash before the memory, in units of the range; above the noise.
        capacity: Extrema remembered on each side.

    Raises:
        ModelError: If the gain or the floor is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        *,
        gain: float = 0.2,
        floor: float = 0.01,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        if not 0.0 < gain < 2.0:
            message = f"a normalised gain is above 0 and below 2, got {gain:g}"
            raise ModelError(message)
        if not 0.0 < floor < np.inf:
            message = f"a floor under the power is finite and above 0, got {floor:g}"
            raise ModelError(message)
        super().__init__(bank, gain, floor, deadband, capacity)
