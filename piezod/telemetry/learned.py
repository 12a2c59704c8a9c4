"""Learned parameters of each axis, published by the loop about 20 times per second."""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

from piezod.telemetry.layout import LEARNED_HEADER, MAX_WEIGHTS
from piezod.telemetry.shared_map import SharedMap

_ATTEMPTS: Final = 1000
AREA: Final = LEARNED_HEADER + MAX_WEIGHTS
"""Words of an axis: turn begun, turn done, number of weights, offset, scale, sensor zero, 1 for a
surface, distance from the identified model, lowest and highest position, a gap, and from
`LEARNED_HEADER` on the weights."""
LearnedValues: TypeAlias = tuple[Any, float, float, float, bool, float, float, float]
"""The values of a `LearnedAxis`, whose weights are any sequence of numbers."""


class LearnedAxis(NamedTuple):
    """Learned parameters of an axis."""

    weights: Sequence[float]  #: Weights of the model, in the order of the compensator.
    offset: float  #: Offset of the displacement, normalised.
    scale: float  #: Scale of the displacement.
    zero_um: float  #: Sensor zero, in µm as the sensor shows it.
    surface: bool  #: Whether the weights are the coefficients of a surface, and not those of stops.
    #: How far the model is from the identified one, as a share of the range: the largest difference
    #: of their drives; NaN without an identified one.
    distance: float
    low_um: float  #: Lowest position that may be commanded, in µm.
    high_um: float  #: Highest position that may be commanded, in µm.


class LearnedReader:
    """End of a reader; any number of readers is possible."""

    def __init__(self, shared: SharedMap) -> None:
        part = shared.part("learned")
        self._words, self._values = part.cast("q"), part.cast("d")

    def read(self, axis: int) -> LearnedAxis | None:
        """Return the parameters of an axis, None before they were first published."""
        at = axis * AREA
        for _ in range(_ATTEMPTS):
            done, count = self._words[at + 1], self._words[at + 2]
            offset, scale, zero_um = self._values[at + 3 : at + 6]
            surface = bool(self._words[at + 6])
            distance, low_um, high_um = self._values[at + 7 : at + 10]
            begin = at + LEARNED_HEADER
            weights = self._values[begin : begin + count].tolist()
            if done and self._words[at] == done:
                return LearnedAxis(
                    weights, offset, scale, zero_um, surface, distance, low_um, high_um
                )
        return None
