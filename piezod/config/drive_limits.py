"""What limits a drive, by the texts that records and status use."""

from enum import StrEnum


class DriveLimit(StrEnum):
    """What limits the requested drive in a cycle."""

    NONE = "none"
    RANGE = "range"
    """It is at an end of its range, or of its model, and should go beyond."""
    SLEW = "slew rate"
    """It should change faster."""
