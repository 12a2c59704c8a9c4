"""Turning points of a displacement over time; nothing here needs piezod."""

from typing import NamedTuple

import numpy as np

from benchmarks.peers.method import FloatArray


class Turns(NamedTuple):
    """The turning points that are known at each sample."""

    last: FloatArray  #: (n, k) last turning points, the latest first.
    direction: FloatArray  #: (n,) 1 after a minimum, -1 after a maximum.


def turning_points(positions: FloatArray, count: int, threshold: float, *, wipe: bool) -> Turns:
    """Return the last turning points at each sample, from samples up to it.

    If there are fewer, the first position and the present extremum stand for the others, in turn.

    Args:
        positions: (n,) displacement.
        count: Number of turning points, k.
        threshold: Way back from an extremum that makes it a turning point.
        wipe: Whether a larger motion deletes the turning points of smaller loops (E. Madelung,
            Ann. Phys. 322 (1905) 861).
    """
    last, direction = np.empty((positions.size, count)), np.empty(positions.size)
    values = positions.tolist()
    turns: list[float] = [values[0]]
    sign, extremum = 1.0, values[0]
    for k, value in enumerate(values):
        if sign * (extremum - value) > threshold:
            turns.append(extremum)
            sign, extremum = -sign, value
        elif sign * (value - extremum) > 0.0:
            extremum = value
        while wipe and len(turns) > 2 and sign * (extremum - turns[-2]) >= 0.0:
            del turns[-2:]
        known = turns[: -count - 1 : -1]
        # So nothing jumps when a motion exceeds all turning points.
        missing = [turns[0] if j % 2 == 0 else extremum for j in range(len(known), count)]
        last[k] = known + missing
        direction[k] = sign
    return Turns(last, direction)
