"""Normalised least mean squares: stable for any gain below 2 and any number of operators."""

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis.lms import GradientIdentifier
from piezod.hysteresis.memory import DEFAULT_CAPACITY, FloatArray


class NLMSIdentifier(GradientIdentifier):
    """Normalised LMS: each step removes the same share of the error of its own pair.

    Source: Haykin, Adaptive Filter Theory, chapter on normalised LMS.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        gain: μ, above 0 and below 2.
        floor: ε added to ‖E - x‖², above 0; without it pairs near the ends of the range, where ‖E -
            x‖ vanishes, would teach noise.
        deadband: Width of the backlash before the memory, in units of the range; larger than the
            noise.
        capacity: Extrema stored on each side.

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
            message = f"the gain of a normalised LMS must be above 0 and below 2, got {gain:g}"
            raise ModelError(message)
        if not 0.0 < floor < np.inf:
            message = f"the floor of a normalised LMS must be finite and above 0, got {floor:g}"
            raise ModelError(message)
        super().__init__(bank, gain, floor, deadband, capacity)
