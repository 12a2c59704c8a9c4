"""The modes of compensation, by the names that files, commands and records use."""

from enum import StrEnum


class Mode(StrEnum):
    """How the drive is made from the command; later modes are added, these stay."""

    UNCOMPENSATED = "uncompensated"
    """The drive is proportional to the command."""
    FEEDFORWARD = "feedforward"
    """The inverse model with fixed parameters."""
    ADAPTIVE = "adaptive"
    """The inverse model with parameters that follow the identifier at each step."""
    TRIMMED = "trimmed"
    """An inverse model, and a slow integral of the measured error on top of it."""
