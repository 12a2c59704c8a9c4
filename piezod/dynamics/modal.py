"""The motion of modes in a cycle, in which the static displacement is a straight line."""

from typing import NamedTuple

import numpy as np

from piezod.dynamics.loop import free_motion
from piezod.dynamics.model import Resonance


class ModalStep(NamedTuple):
    """Advances the part of a displacement that a mode adds to the static one, and its speed.

    added' = added_added · added + added_speed · speed + added_step · step
    speed' = speed_added · added + speed_speed · speed + speed_step · step

    `step` is the change of the static displacement in the cycle; speeds are per radian of the mode.

    Attributes:
        added_added, added_speed, added_step: Factors of the first line.
        speed_added, speed_speed, speed_step: Factors of the second line.
        share: Part of the static displacement that belongs to the mode.
    """

    added_added: float
    added_speed: float
    added_step: float
    speed_added: float
    speed_speed: float
    speed_step: float
    share: float


def modal_step(mode: Resonance, period_s: float) -> ModalStep:
    """Return the exact step of a mode over a period, in s.

    On a straight line the mode follows at a constant distance; the difference to that moves freely.
    """
    free = free_motion(mode, period_s)
    slope = 1.0 / (2.0 * np.pi * mode.frequency_hz * period_s)  # per radian, for a step of one
    follows = np.array([-2.0 * mode.damping * slope, slope])
    forced = follows - free @ follows
    (aa, av, au), (va, vv, vu) = np.column_stack([free, forced]).tolist()
    return ModalStep(aa, av, au, va, vv, vu, mode.share)
