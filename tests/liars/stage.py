"""A stage with hysteresis: straight motion, and a sum of plays."""

import random
from collections.abc import Sequence
from typing import Final

GAIN_UM_PER_V: Final = 0.15
PLAYS: Final = ((4.0, 0.02), (12.0, 0.02), (25.0, 0.015), (45.0, 0.01))
"""Half width in V, and weight in µm/V, of each play."""
NOISE_UM: Final = 0.002


class Stage:
    """A stage at rest, at 0 V, as swings to positive voltages leave it."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)  # noqa: S311 - the noise of a sensor
        self._plays_v = [half_v for half_v, _weight in PLAYS]
        self._drive_v = 0.0

    def drive(self, drive_v: float) -> None:
        """Set the voltage on the stage, in V."""
        self._drive_v = drive_v
        for i, (half_v, _weight) in enumerate(PLAYS):
            self._plays_v[i] = max(drive_v - half_v, min(drive_v + half_v, self._plays_v[i]))

    def position_um(self) -> float:
        """Return what its sensor shows, in µm."""
        return _position_um(self._drive_v, self._plays_v) + self._random.gauss(0.0, NOISE_UM)


def possible_um(drive_v: float, highest_v: float) -> tuple[float, float]:
    """Return the lowest and the highest position at a voltage, of any past up to a voltage."""
    halves_v = [half_v for half_v, _weight in PLAYS]
    # From rest on, no play is below its half width.
    low_v = [max(drive_v - half_v, half_v) for half_v in halves_v]
    high_v = [min(drive_v + half_v, max(highest_v - half_v, half_v)) for half_v in halves_v]
    return _position_um(drive_v, low_v), _position_um(drive_v, high_v)


def _position_um(drive_v: float, plays_v: Sequence[float]) -> float:
    """Return the position, which is 0 after swings to positive voltages."""
    plays = zip(PLAYS, plays_v, strict=True)
    moved_um = sum(weight * (play_v - half_v) for (half_v, weight), play_v in plays)
    return GAIN_UM_PER_V * drive_v + moved_um
