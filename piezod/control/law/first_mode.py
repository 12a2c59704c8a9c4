"""The first mode of a stage: a second-order resonance between drive and displacement.

A drive is held between two samples, and so is the displacement without the mode, from which the
mode follows. The discretisation is exact for that. A delay that is no whole period splits the held
value in two, as in `piezod.dynamics.loop`.
"""

from math import floor
from typing import NamedTuple

import numpy as np

from piezod.dynamics import Resonance
from piezod.dynamics.loop import free_motion
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


class FirstMode(NamedTuple):
    """The first mode of a stage.

    Attributes:
        frequency_hz: Undamped frequency, in Hz.
        damping: Damping ratio, in (0, 1).
    """

    frequency_hz: float
    damping: float

    def free_motion(self, over_s: float) -> FloatArray:
        """Return the transition matrix of displacement and speed (per radian), shape (2, 2)."""
        return free_motion(Resonance(self.frequency_hz, self.damping), over_s)

    def shown(self, values: FloatArray, delay_s: float, period_s: float) -> FloatArray:
        """Return the motion of the mode at the samples, for held values; same shape.

        The mode has settled at the first values before. The delay is that of the middle of a held
        value, half a period after its start: a slow motion is then shown as late as by linear
        interpolation.

        Args:
            values: (n,) or (n, p) displacement without the mode, evenly in time.
            delay_s: Delay of either sign, in s.
            period_s: Sample period, in s.
        """
        late = delay_s / period_s - 0.5
        whole = floor(late)
        after = self.free_motion(period_s * (1.0 - (late - whole)))
        settled = np.array([1.0, 0.0])  # final state of a held value of 1; the rest decays freely
        free = self.free_motion(period_s)
        old, new = (after - free) @ settled, settled - after @ settled
        columns = np.ascontiguousarray(values.reshape(values.shape[0], -1))
        motion = np.empty_like(columns)
        state = np.zeros((2, columns.shape[1]))
        state[0] = columns[0]
        _follow(columns, whole, free, old, new, state, motion)
        return motion.reshape(values.shape)


@compiled
def _follow(
    values: FloatArray,
    whole: int,
    free: FloatArray,
    old: FloatArray,
    new: FloatArray,
    state: FloatArray,
    motion: FloatArray,
) -> None:
    """Fill the motion; the state of each column is a displacement and a speed.

    Args:
        values: (n, p) held values.
        whole: Whole periods of the delay.
        free: (2, 2) transition over a period.
        old: (2,) effect of the held value before, in a period.
        new: (2,) effect of the present one.
        state: (2, p) state at the first sample; it advances in place.
        motion: (n, p) displacement at the samples.
    """
    last = values.shape[0] - 1
    for k in range(values.shape[0]):
        before = min(max(k - whole - 2, 0), last)
        here = min(max(k - whole - 1, 0), last)
        for j in range(values.shape[1]):
            if k > 0:
                x, speed = state[0, j], state[1, j]
                a, b = values[before, j], values[here, j]
                state[0, j] = free[0, 0] * x + free[0, 1] * speed + old[0] * a + new[0] * b
                state[1, j] = free[1, 0] * x + free[1, 1] * speed + old[1] * a + new[1] * b
            motion[k, j] = state[0, j]
