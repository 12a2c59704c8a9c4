"""A sensor that usually has noise, and has none now: what it shows may not be the stage."""

from math import nan
from typing import Final

STILL_SAMPLES: Final = 200
"""So many samples that are the same to the bit are still."""
USUALLY: Final = 0.5
"""Where less than this part of the samples differs from the one before, none is expected to."""

_AVERAGED_SAMPLES = 1000


class StillSensor:
    """Watches one sensor; fixed memory."""

    def __init__(self) -> None:
        self._position = nan
        self.samples = 0
        """How many samples in a row have been the same."""
        self._changing = 0.0
        self.still = False
        """Whether the sensor stands still though it usually does not."""

    def update(self, position: float) -> None:
        """Take a sample; may be called in the loop."""
        if position != self._position:
            self._position, self.samples, self.still = position, 1, False
            self._changing += (1.0 - self._changing) / _AVERAGED_SAMPLES
            return
        self.samples += 1
        self._changing -= self._changing / _AVERAGED_SAMPLES
        if self.samples == STILL_SAMPLES:
            self.still = self._changing > USUALLY
