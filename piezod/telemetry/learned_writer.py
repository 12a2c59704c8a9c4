"""Publishes the learned parameters of each axis; `learned` reads them."""

import numpy as np

from piezod.telemetry.layout import LEARNED_HEADER
from piezod.telemetry.learned import AREA, LearnedValues
from piezod.telemetry.shared_map import SharedMap


class LearnedWriter:
    """Publishes the parameters; the end of the loop.

    Args:
        shared: The memory, writable; it has one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("learned")
        self._words, self._values = part.cast("q"), part.cast("d")
        self._areas = np.frombuffer(part, np.float64).reshape(-1, AREA)

    def publish(self, axis: int, learned: LearnedValues) -> None:
        """Publish the parameters of an axis, up to 2048 weights. Real-time safe."""
        weights, offset, scale, zero_um, surface, distance, low_um, high_um = learned
        count = len(weights)
        at = axis * AREA
        # The turn is written before and after the values, so that a reader can detect a write in
        # between.
        self._words[at] = turn = self._words[at] + 1
        self._words[at + 2] = count
        self._values[at + 3] = offset
        self._values[at + 4] = scale
        self._values[at + 5] = zero_um
        self._words[at + 6] = surface
        self._values[at + 7] = distance
        self._values[at + 8] = low_um
        self._values[at + 9] = high_um
        self._areas[axis, LEARNED_HEADER : LEARNED_HEADER + count] = weights
        self._words[at + 1] = turn
