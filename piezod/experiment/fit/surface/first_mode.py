"""Searches the first mode of a stage in a record, as a start for the fit of a surface.

A mode is a resonance: it rings at its own frequency after each jump of the drive. Candidates on a
grid are compared by the displacement that they show for the surface fitted without a mode.
"""

from itertools import product
from typing import Final, NamedTuple

import numpy as np

from piezod.control.law.first_mode import FirstMode
from piezod.experiment.fit.problem import LinearProblem
from piezod.experiment.fit.record import Rows
from piezod.experiment.fit.residuals import CLEAR_GAIN, clearly_better, held_out_squares
from piezod.experiment.fit.surface.parameters import FREQUENCIES, HIGHEST_DAMPING
from piezod.hysteresis.memory import FloatArray

STEP: Final = 1.05
"""Ratio of neighbouring frequencies; the fit then finds the frequency in between."""
DAMPINGS: Final = (0.01, 0.05, 0.2)
EARLIER: Final = (0.0, 0.125, 0.25)
"""Parts of a period of the mode by which the delay is shorter: a fit without a mode takes a part of
its rise for a delay."""
STANDARD_ERRORS: Final = 1.0
"""Least mean gain of the blocks. A mode rings only after jumps, which some blocks may not have."""
SAMPLES: Final = 8_000
"""Samples of the record that are searched: those in a row with the largest errors."""
LOWEST_HZ: Final = 10.0
"""Lowest frequency of a mode, in Hz: what is slower is the drive, or creep."""


class ShownMode(NamedTuple):
    """How clearly a record shows a mode: errors of the position on held-out blocks.

    They are rms errors, in % of the range of the model.
    """

    with_pct: float  #: Error of the fit with the mode.
    without_pct: float  #: Error of the fit without it.


class ModeGuess(NamedTuple):
    """A mode that the record may show."""

    frequency: float  #: Undamped frequency, in cycles per sample.
    damping: float  #: Damping ratio.
    delay_s: float  #: Delay with which it explains most, in s.


def guess_mode(
    held: FloatArray, positions: FloatArray, counted: Rows, period_s: float, delay_s: float
) -> ModeGuess | None:
    """Return the mode that explains a record best, None if none is clear.

    Args:
        held: (n,) displacement without mode and delay, of a fit without a mode.
        positions: (n,) recorded displacement, in the same unit, not smoothed.
        counted: (n,) mask of the samples that count.
        period_s: Sample period, in s.
        delay_s: Delay of that fit, in s.
    """
    late = np.interp(np.arange(held.size) - delay_s / period_s, np.arange(held.size), held)
    plain = (late - positions) * counted
    part = _worst_part(plain)
    held, positions, counted = held[part], positions[part], counted[part]
    best, least = None, CLEAR_GAIN * float(np.std(plain[part][counted]))
    lowest, highest = max(FREQUENCIES[0], LOWEST_HZ * period_s), FREQUENCIES[1]
    count = max(0, round(np.log(highest / lowest) / np.log(STEP)))
    frequencies = np.geomspace(lowest, highest, count)
    for frequency, damping, earlier in product(frequencies.tolist(), DAMPINGS, EARLIER):
        mode = FirstMode(frequency / period_s, damping)
        guess = ModeGuess(frequency, damping, delay_s - earlier / mode.frequency_hz)
        misses = (mode.shown(held, guess.delay_s, period_s) - positions)[counted]
        if (rms := float(np.std(misses))) < least:
            best, least = guess, rms
    return best


def shown_mode(
    mode: FirstMode, with_mode: LinearProblem, plain: LinearProblem, unit: float
) -> ShownMode | None:
    """Return how clearly a record shows a mode, None if it does not.

    Args:
        mode: The mode that was fitted.
        with_mode: The fit with it.
        plain: The fit without, to the same record.
        unit: Unit of their misses, as a share of the range of the model: a vibration makes the
            range of the record larger.
    """
    if mode.frequency_hz < LOWEST_HZ or mode.damping >= HIGHEST_DAMPING:
        return None
    with_mode_s, plain_s = held_out_squares(with_mode), held_out_squares(plain)
    rms = (float(np.sqrt(np.mean(each))) for each in (with_mode_s, plain_s))
    shown = ShownMode(*(100.0 * unit * each for each in rms))
    clear = clearly_better(with_mode_s, plain_s, CLEAR_GAIN, STANDARD_ERRORS)
    return shown if clear else None


def _worst_part(misses: FloatArray) -> slice:
    """Return the samples in a row with the largest errors."""
    if misses.size <= SAMPLES:
        return slice(None)
    power = np.concatenate(([0.0], np.cumsum(misses**2)))
    start = int(np.argmax(power[SAMPLES:] - power[:-SAMPLES]))
    return slice(start, start + SAMPLES)
