"""The first mode of a stage: a second-order resonance between drive and displacement.

Amplifier and sensor may add a lag of first order. A drive is held between two samples, and so is
the displacement without the mode, from which the mode follows. The discretisation is exact for
that. A delay that is no whole period splits the held value in two, as in `piezod.dynamics.loop`.
"""

from math import exp, floor
from typing import NamedTuple

import numpy as np

from piezod.dynamics import Resonance
from piezod.dynamics.loop import free_motion
from piezod.hysteresis.memory import FloatArray
from piezod.jit import compiled


class FirstMode(NamedTuple):
    """The first mode of a stage."""

    frequency_hz: float  #: Undamped frequency, in Hz.
    damping: float  #: Damping ratio, in (0, 1).
    lag_s: float = 0.0  #: Time constant of the lag of first order beside it, in s.

    def free_motion(self, over_s: float) -> FloatArray:
        """Return the transition matrix, shape (3, 3).

        The state is the displacement, its speed (per radian), and the lag, which drives both.
        """
        motion = np.zeros((3, 3))
        motion[:2, :2] = free_motion(Resonance(self.frequency_hz, self.damping), over_s)
        if self.lag_s > 0.0:
            # While the lag decays, the mode follows it at a constant ratio; the rest moves freely.
            rate = 1.0 / (2.0 * np.pi * self.frequency_hz * self.lag_s)
            ratio = np.array([1.0, -rate]) / (1.0 - 2.0 * self.damping * rate + rate**2)
            motion[2, 2] = exp(-over_s / self.lag_s)
            motion[:2, 2] = motion[2, 2] * ratio - motion[:2, :2] @ ratio
        return motion

    def shown(self, values: FloatArray, delay_s: float, period_s: float) -> FloatArray:
        """Return the motion of the mode at the samples, for held values; same shape.

        The mode has settled at the first values before. The delay includes the lag, and is that of
        the middle of a held value, half a period after its start: a slow motion is then shown as
        late as by linear interpolation.

        Args:
            values: (n,) or (n, p) displacement without the mode, evenly in time.
            delay_s: Delay of either sign, in s.
            period_s: Sample period, in s.
        """
        late = (delay_s - self.lag_s) / period_s - 0.5
        whole = floor(late)
        after = self.free_motion(period_s * (1.0 - (late - whole)))
        settled = np.array([1.0, 0.0, 1.0])  # for a held value of 1; the rest decays freely
        free = self.free_motion(period_s)
        old, new = (after - free) @ settled, settled - after @ settled
        columns = np.ascontiguousarray(values.reshape(values.shape[0], -1))
        motion = np.empty_like(columns)
        state = settled[:, np.newaxis] * columns[0]
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
    """Fill the motion; the state of each column is a displacement, a speed and a lag.

    Args:
        values: (n, p) held values.
        whole: Whole periods of the delay.
        free: (3, 3) transition over a period.
        old: (3,) effect of the held value before, in a period.
        new: (3,) effect of the present one.
        state: (3, p) state at the first sample; it advances in place.
        motion: (n, p) displacement at the samples.
    """
    last = values.shape[0] - 1
    for k in range(values.shape[0]):
        before = min(max(k - whole - 2, 0), last)
        here = min(max(k - whole - 1, 0), last)
        for j in range(values.shape[1]):
            if k > 0:
                x, speed, lag = state[0, j], state[1, j], state[2, j]
                a, b = values[before, j], values[here, j]
                for i in range(3):
                    moved = free[i, 0] * x + free[i, 1] * speed + free[i, 2] * lag
                    state[i, j] = moved + old[i] * a + new[i] * b
            motion[k, j] = state[0, j]
