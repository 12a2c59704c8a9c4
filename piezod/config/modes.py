"""The modes of compensation, by the names in files, commands and records."""

from enum import StrEnum
from typing import Final


class Mode(StrEnum):
    """The computation of the drive from the command; later versions may add modes, these stay."""

    UNCOMPENSATED = "uncompensated"
    """The drive is proportional to the command."""
    FEEDFORWARD = "feedforward"
    """The inverse model with fixed parameters."""
    ADAPTIVE = "adaptive"
    """The inverse model with parameters that follow the identifier at each step."""
    TRIMMED = "trimmed"
    """An inverse model plus a slow integral of the measured error."""
    CLOSED = "closed"
    """The adaptive inverse model plus a fast feedback of the measured error."""


SENSED: Final = frozenset({Mode.ADAPTIVE, Mode.TRIMMED, Mode.CLOSED})
"""Modes that need the sensor."""
CORRECTED: Final = (Mode.TRIMMED, Mode.CLOSED)
"""Modes in which a feedback of the measured error is added to the command."""
