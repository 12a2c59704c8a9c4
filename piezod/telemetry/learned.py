"""Learned parameters of each axis, published by the loop about 20 times per second."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from piezod.telemetry.layout import LEARNED_HEADER, MAX_WEIGHTS
from piezod.telemetry.shared_map import SharedMap

_ATTEMPTS: Final = 1000
_AREA: Final = np.dtype(
    [
        ("begun", "<i8"),
        ("done", "<i8"),
        ("count", "<i8"),
        ("offset", "<f8"),
        ("scale", "<f8"),
        ("zero_um", "<f8"),
        ("_gap", "V8", (LEARNED_HEADER - 6,)),
        ("weights", "<f8", (MAX_WEIGHTS,)),
    ]
)


class LearnedAxis(NamedTuple):
    """Learned parameters of an axis.

    Attributes:
        weights: Weights of the model, in the order of the compensator.
        offset: Offset of the displacement, normalised.
        scale: Scale of the displacement.
        zero_um: Sensor zero, in µm as the sensor shows it.
    """

    weights: NDArray[np.float64]
    offset: float
    scale: float
    zero_um: float


class LearnedWriter:
    """End of the loop.

    Args:
        shared: The memory, writable; it has one writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        areas = shared.array("learned", _AREA)
        self._weights = [area["weights"] for area in areas]
        part = shared.part("learned")
        self._words, self._values = part.cast("q"), part.cast("d")

    def publish(
        self, axis: int, weights: ArrayLike, offset: float, scale: float, zero_um: float
    ) -> None:
        """Publish the parameters of an axis, up to 2048 weights. Real-time safe."""
        count = len(weights)  # type: ignore[arg-type] # any sequence of numbers
        at = axis * _AREA.itemsize // 8
        # The turn is written before and after the values, so that a reader can detect a write in
        # between.
        self._words[at] = turn = self._words[at] + 1
        self._words[at + 2] = count
        self._values[at + 3] = offset
        self._values[at + 4] = scale
        self._values[at + 5] = zero_um
        self._weights[axis][:count] = weights
        self._words[at + 1] = turn


class LearnedReader:
    """End of a reader; any number of readers is possible.

    Args:
        shared: The memory.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._areas = shared.array("learned", _AREA)

    def read(self, axis: int) -> LearnedAxis | None:
        """Return the parameters of an axis, None before they were first published."""
        for _ in range(_ATTEMPTS):
            done = int(self._areas[axis]["done"])
            area: Any = self._areas[axis].copy()
            if done and int(self._areas[axis]["begun"]) == done:
                weights = area["weights"][: area["count"]]
                numbers = (float(area[name]) for name in ("offset", "scale", "zero_um"))
                return LearnedAxis(weights, *numbers)
        return None
