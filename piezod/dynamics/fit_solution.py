"""A solution of the problem of a response, and its parameters by their meaning."""

from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

PER_RESONANCE: Final = 3
"""Parameters of a resonance; the share of the last one follows from the others."""


class Parts(NamedTuple):
    """The parameters by their meaning."""

    fixed: FloatArray  #: Gains, phase, creep, delay.
    frequencies_hz: FloatArray  #: (n,) frequencies, in Hz.
    dampings: FloatArray  #: (n,) damping ratios.
    shares: FloatArray  #: (n,) shares, which add up to one.

    @classmethod
    def of(cls, parameters: FloatArray, fixed: int) -> Self:
        """Return the parts of parameters, in the order of `fit_lines`.

        Args:
            parameters: The parameters.
            fixed: Number of gains, phase, creep and delay.
        """
        count = (parameters.size - fixed + 1) // PER_RESONANCE
        own_end = fixed + 2 * count
        free, own = parameters[own_end:], np.exp(parameters[fixed:own_end])
        shares = np.append(free, 1.0 - free.sum()) if count else np.empty(0)
        return cls(parameters[:fixed], own[::2], own[1::2], shares)


@dataclass(frozen=True, eq=False)
class Solution:
    """A minimum."""

    parameters: FloatArray  #: The parameters.
    parts: Parts  #: The same by their meaning.
    cost: float  #: Half of the sum of squares.
    jacobian: FloatArray  #: (residuals, parameters) derivatives.

    @property
    def count(self) -> int:
        """Number of resonances."""
        return self.parts.shares.size
