"""The identification of the paper, section 2.3: LMS over a record, again and again."""

from typing import Final

import numpy as np

from piezod.hysteresis import LMSIdentifier, largest_stable_gain
from piezod.hysteresis.memory import FloatArray

PAPER_GAIN: Final = 0.1
"""γ of paper eq. (29)."""
MOST_PASSES: Final = 30
"""Largest number of passes over the record. Paper, section 2.3: the procedure "can be repeated for
several times until satisfactory results are obtained"."""
SETTLED: Final = 0.99
"""The weights have settled if a pass leaves more than this part of the rms error of the last."""


def repeated_lms(
    bank: FloatArray,
    positions: FloatArray,
    drives: FloatArray,
    gain: float | None,
    deadband: float,
) -> FloatArray:
    """Return the weights [a^l, a^r] of the update of paper eq. (29), shape (2 M,).

    Args:
        bank: (2, 2 M) thresholds and gains of the stops.
        positions: (n,) displacement, normalised.
        drives: (n,) drive, normalised; a NaN advances the memory only.
        gain: γ; None for the paper's, or a smaller one if that is not stable.
        deadband: Width of the dead-band of the memory, in units of the range.

    Raises:
        ModelError: If the gain is not stable.
    """
    if gain is None:
        # LMS is stable while 2 γ |φ|² < 2; that bound falls with the number of operators.
        gain = min(PAPER_GAIN, 0.9 * largest_stable_gain(bank))
    identifier = LMSIdentifier(bank, gain=gain, deadband=deadband)
    within, before = np.clip(positions, 0.0, 1.0), np.inf
    for _ in range(MOST_PASSES):
        identifier.reset()
        rms = float(np.sqrt(np.nanmean(identifier.run(within, drives) ** 2)))
        if rms > SETTLED * before:
            break
        before = rms
    return identifier.weights
