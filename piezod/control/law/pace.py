"""How fast an axis may learn, so that learning cannot make the first mode oscillate.

What an identifier learns from a sample reaches the drive, and the drive rings the first mode, which
is in the next samples: a feedback loop. The identifier integrates its errors, which turns the phase
by 90°. At the mode the stage turns it by another 90° and amplifies by 1/(2ζ). So the loop
oscillates if its gain at the mode exceeds one, however good the model is.

In each sample an identifier removes the share k of its error, and the compensator goes the share σ
of the way to the learned model. At the angular frequency ω these two filters leave k σ / (ω T)² of
an error, for samples of period T. With a pace p both work p times as fast, and the gain is p² k σ /
(ω T)² / (2ζ). This holds for a sharp mode. For a damped one the poles of the linear loop decide.
"""

from cmath import exp
from math import pi, sqrt
from typing import Final

import numpy as np

from piezod.config.first_mode import FirstModeConfig

FULL_PACE_PERIOD_S: Final = 1e-3
"""The constants of identifiers and compensator are for samples of this period. More frequent
samples do not make the stage change faster, so that each of them counts less."""
RLS_SHARE: Final = 0.1
"""k of recursive least squares: share of its error that it removes in a sample, while it moves."""
FOLLOWED_SHARE: Final = 0.3
"""σ: share of the distance to the learned model that the compensator goes in a cycle. The full
distance, as in the paper, would pass the noise of the sensor on to the drive."""
LARGEST_LOOP_GAIN: Final = 0.5
"""Largest gain of the loop at the first mode, for a gain margin of two."""
_SLOWER: Final = 0.95
"""Ratio of the paces that are tried one after the other."""


def learning_pace(period_s: float, mode: FirstModeConfig | None, learned_share: float) -> float:
    """Return the pace p of learning, in (0, 1]: 1 is that of the constants.

    Args:
        period_s: Period of the loop, in s.
        mode: First mode; None if it is unknown.
        learned_share: k, the share of its error that the identifier removes in a sample at pace 1.
    """
    pace = min(1.0, period_s / FULL_PACE_PERIOD_S)
    if mode is None or learned_share == 0.0:
        return pace
    angle = 2.0 * pi * mode.frequency_hz * period_s  # ω T
    pace = min(pace, angle * _largest_pace_per_angle(mode.damping, learned_share))
    while angle < pi and _oscillates(angle, mode.damping, learned_share / LARGEST_LOOP_GAIN, pace):
        pace *= _SLOWER
    return pace


def slowest_unknown_mode_hz(period_s: float, damping: float, learned_share: float) -> float:
    """Return the frequency below which the pace would be lower if the mode were known.

    Args:
        period_s: Period of the loop, in s.
        damping: ζ of the mode.
        learned_share: k, the share of its error that the identifier removes in a sample at pace 1.
    """
    pace = learning_pace(period_s, None, learned_share)
    return pace / (_largest_pace_per_angle(damping, learned_share) * 2.0 * pi * period_s)


def _largest_pace_per_angle(damping: float, learned_share: float) -> float:
    """Return the largest pace per ω T at a sharp mode, for the gain `LARGEST_LOOP_GAIN`."""
    return sqrt(LARGEST_LOOP_GAIN * 2.0 * damping / (learned_share * FOLLOWED_SHARE))


def _oscillates(angle: float, damping: float, learned_share: float, pace: float) -> bool:
    """Return whether the linear loop of mode, identifier and compensator has a pole outside.

    The states are position and velocity of the mode under a held drive, the learned offset, and the
    offset in use.

    Args:
        angle: Phase by which the mode advances in a period, ω T, below π.
        damping: ζ of the mode, below 1.
        learned_share: k, the share of its error that the identifier removes in a sample at pace 1.
        pace: The pace.
    """
    turns = angle * sqrt(1.0 - damping**2)
    pole = exp(-damping * angle + 1j * turns)
    c, s = pole.real, pole.imag / turns * angle  # s is scaled so that velocity is in position units
    lead = damping * s
    free = np.array([[c + lead, s], [-s, c - lead]])
    step = np.zeros((4, 4))
    step[:2, :2] = free
    step[:2, 3] = (free - np.eye(2)) @ [1.0, 0.0]  # the drive is the command minus the offset
    learn, follow = pace * learned_share, pace * FOLLOWED_SHARE
    step[2] = [learn, 0.0, 1.0 - learn, learn]
    step[3] = [0.0, 0.0, follow, 1.0 - follow]
    return bool(np.max(np.abs(np.linalg.eigvals(step))) >= 1.0)
