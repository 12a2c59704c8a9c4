"""Recognises an amplifier that limits its slew rate while it reports the command.

A lag of a filter grows with the speed of the drive. A limited slew rate makes the displacement move
at one speed, whatever the drive asks for: its speed over time has a flat top.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

FAST_PCT: Final = 99.0
"""The speed that the fastest hundredth of the samples exceeds counts as the highest one."""
SLOWER: Final = 0.85
"""A displacement that keeps up with its drive reaches this share of its speed: branches are steeper
in their middle than on average."""
FLAT: Final = 0.1
"""The top of a speed is flat within this share of it."""
FLAT_SHARE: Final = 0.6
"""Where the drive is beyond the flat top, the displacement is at it in at least this share of the
samples. Of a sine that a filter makes smaller, a third is there."""


def slew_warnings(record: Record) -> Iterator[str]:
    """Yield the warning about a displacement whose speed has a flat top.

    Args:
        record: The record; its displacement without noise.
    """
    counted = record.counted()
    drive_v, position_um = record.drive_v[counted], record.position_um[counted]
    um_per_v = float(np.ptp(position_um) / np.ptp(drive_v))
    asked, moved = (
        np.abs(np.gradient(values, record.period_s)) for values in (um_per_v * drive_v, position_um)
    )
    highest_asked, highest = (float(np.percentile(speed, FAST_PCT)) for speed in (asked, moved))
    if highest >= SLOWER * highest_asked:
        return
    beyond = asked > (1.0 + FLAT) * highest
    if np.mean(_near(moved, highest)[beyond]) < FLAT_SHARE:
        return
    yield (
        f"The displacement never moves faster than by {highest / um_per_v:.3g} V/s of the drive, "
        f"which has up to {highest_asked / um_per_v:.3g} V/s: the amplifier limits its slew rate, "
        "and the record has the voltages that were asked for. No model describes that. State the "
        "rate as `slew_v_per_s` in the `limits` of the axis, and record a slower drive."
    )


def _near(speed: FloatArray, highest: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    near: np.ndarray[tuple[int], np.dtype[np.bool_]] = np.abs(speed - highest) <= FLAT * highest
    return near
