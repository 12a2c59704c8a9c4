"""The values of `piezod identify --method`."""

from enum import StrEnum
from typing import Final

from piezod.experiment.fit.method import Method

DEFAULT_ORDER: Final = 19


class MethodChoice(StrEnum):
    """Values of `--method`."""

    LMS = Method.LMS.value
    LEAST_SQUARES = Method.LEAST_SQUARES.value
    SURFACE = Method.SURFACE.value
    AUTO = "auto"
