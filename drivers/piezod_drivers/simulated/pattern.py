"""The test pattern under a simulated detector: a star whose arms become narrow towards its centre.

Its arms show whether lines fit each other, its rings whether the picture is straight.
"""

from typing import Final

import numpy as np

from piezod_drivers.simulated.axis import FloatArray

CENTRE_UM: Final = 13.0
"""Position of the centre, on each axis, in µm."""
_ARMS, _RING_UM = 18, 2.0
_DARK, _BRIGHT = 20.0, 220.0


def counts_at(positions_um: FloatArray) -> FloatArray:
    """Return the counts of the detector, shape (n,).

    Args:
        positions_um: (n, axes) true displacements; those of the first two axes count, in µm. With
            one axis the pattern is that along its centre.
    """
    x = positions_um[:, 0] - CENTRE_UM
    y = positions_um[:, 1] - CENTRE_UM if positions_um.shape[1] > 1 else np.zeros(x.size)
    radius = np.hypot(x, y)
    arms = 0.5 + 0.5 * np.tanh(4.0 * np.sin(_ARMS * np.arctan2(y, x)))
    rings = np.cos(2.0 * np.pi * radius / _RING_UM) > 0.8
    return np.asarray(_DARK + (_BRIGHT - _DARK) * np.where(rings, 1.0 - arms, arms))
