"""A solution of the problem of a response, and its parameters by their meaning."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


class Parts(NamedTuple):
    """The parameters by their meaning.

    Attributes:
        fixed: Gains, phase, creep, delay.
        frequencies_hz: (n,) frequencies, in Hz.
        dampings: (n,) damping ratios.
        shares: (n,) shares, which add up to one.
    """

    fixed: FloatArray
    frequencies_hz: FloatArray
    dampings: FloatArray
    shares: FloatArray


@dataclass(frozen=True, eq=False)
class Solution:
    """A minimum.

    Attributes:
        parameters: The parameters.
        cost: Half of the sum of squares.
        jacobian: (residuals, parameters) derivatives.
        count: Number of resonances.
    """

    parameters: FloatArray
    cost: float
    jacobian: FloatArray
    count: int
