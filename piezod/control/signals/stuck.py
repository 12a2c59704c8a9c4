"""A sensor whose samples stay the same to the bit while the drive moves."""

from math import nan
from typing import Final

STUCK_SAMPLES: Final = 20
"""A sensor is stuck when this many samples are the same."""


class StuckSensor:
    """Watches for samples that stay the same while the drive moves.

    Args:
        swing: By more than this the drive has to move meanwhile, as a share of its range.
    """

    def __init__(self, swing: float) -> None:
        self._swing = swing
        self._position = nan
        self._samples = 0
        self._low = self._high = 0.0

    @property
    def repeated(self) -> bool:
        """Whether the last sample was the same as the one before: it may be the first of many."""
        return self._samples > 1

    def forget(self) -> None:
        """Begin anew; may be called in the loop."""
        self._position = nan

    def update(self, position: float, drive: float) -> bool:
        """Take a sample and the drive in force; return whether the sensor is stuck.

        May be called in the loop.
        """
        if position != self._position:
            self._position, self._samples = position, 0
            self._low = self._high = drive
        self._samples += 1
        self._low, self._high = min(self._low, drive), max(self._high, drive)
        return self._samples >= STUCK_SAMPLES and self._high - self._low > self._swing
