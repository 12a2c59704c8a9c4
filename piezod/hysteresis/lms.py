"""Least mean squares on the stops of the measured displacement: the identification of the paper.

The paper calls it recursive least squares, but paper eq. (29) is LMS. It needs no initial model and
follows a stage that changes. Its constant gain forgets: the final weights fit the last loops.
"""

from dataclasses import dataclass

import numpy as np

from piezod.errors import ModelError
from piezod.hysteresis import lms_kernel
from piezod.hysteresis.bank import GAINS, THRESHOLDS
from piezod.hysteresis.memory import DEFAULT_CAPACITY, FloatArray
from piezod.hysteresis.online import OnlineIdentifier


def largest_stable_gain(bank: FloatArray) -> float:
    """Return the gain γ below which LMS on a bank cannot diverge, for any displacement.

    The update is stable while 2γ ‖E - x‖² < 2. A right play lies below x by at most x and by at
    most (1 - x) r / (1 - r). A left play lies above x by at most the mirrored amounts. ‖E - x‖² is
    at most the largest sum of their squares over x. For the paper's 19 thresholds a side this bound
    is 5.9.
    """
    # (E - x) is g (x - F): g times the bounds above, each on a grid of x.
    left, right = np.split(bank, 2, axis=1)
    x = np.linspace(0.0, 1.0, 1001)[:, np.newaxis]
    below = np.minimum(left[GAINS] * x, 1.0 - x)
    above = np.minimum(x, right[GAINS] * (1.0 - x))
    return 1.0 / float(np.max(np.sum(below**2, axis=1) + np.sum(above**2, axis=1)))


def _slope_sensitivity(bank: FloatArray, deadband: float) -> float:
    """Return the largest change of the slopes of both sides if E - x is added to the weights.

    A slope is 1 plus some weights times g minus the other weights. |E - x| is at most 1 - r; a
    dead-band of width δ adds at most g δ / 2.
    """
    largest = 1.0 - bank[THRESHOLDS] + 0.5 * deadband * bank[GAINS]
    # A weight enters the slopes before its threshold with g and those after it with -1.
    return float(np.sum(np.maximum(bank[GAINS], 1.0) * largest))


class GradientIdentifier(OnlineIdentifier):
    """Moves the weights along the regressor of each pair; a floor above 0 normalises the step."""

    def __init__(
        self, bank: FloatArray, gain: float, floor: float, deadband: float, capacity: int
    ) -> None:
        super().__init__(bank, np.zeros(bank.shape[1]), deadband, capacity)
        self._arguments = (
            *self._memory,
            *self._learner,
            gain,
            floor,
            _slope_sensitivity(bank, deadband),
            self._deadband,
        )

    def step(self, position: float, drive: float, learn: bool = True) -> float:
        """Adapt to one pair, as in `OnlineIdentifier`. Real-time safe."""
        return lms_kernel.step(*self._arguments, float(position), float(drive), learn)

    def expect_noise(self, variance: float) -> None:
        """Change nothing: the gain of a gradient is the one that was chosen."""

    def _run(self, positions: FloatArray, drives: FloatArray, errors: FloatArray) -> None:
        lms_kernel.run(*self._arguments, positions, drives, errors)


class LMSIdentifier(GradientIdentifier):
    """The identifier of the paper, eq. (29) and eq. (30): initial weights zero, constant gain.

    Args:
        bank: Thresholds and gains of the stops, from `new_bank`.
        gain: γ, from 0 to below `largest_stable_gain`.
        deadband: Width of the backlash before the memory, in units of the range; larger than the
            noise.
        capacity: Extrema stored on each side.

    Raises:
        ModelError: If the gain is outside its range.
    """

    def __init__(
        self,
        bank: FloatArray,
        *,
        gain: float = 0.1,
        deadband: float = 0.0,
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        if not 0.0 <= gain < largest_stable_gain(bank):
            message = (
                f"an LMS gain of {gain:g} is out of range: with {bank.shape[1] // 2} operators on "
                f"each side it must be from 0 to below {largest_stable_gain(bank):.3g}"
            )
            raise ModelError(message)
        super().__init__(bank, gain, 0.0, deadband, capacity)


@dataclass
class Convergence:
    """The paper's criterion of convergence, |e_k - e_{k-1}| below a tolerance, over a whole window.

    One sample proves nothing, because one difference can be small by chance. Samples of a stage at
    rest prove nothing either; the caller must leave them out.
    """

    tolerance: float
    window: int
    _quiet: int = 0
    _previous: float = np.inf

    def update(self, error: float) -> bool:
        """Add the next error; return whether the last `window` differences were all small."""
        # NaN and infinite errors compare as not small and start the window anew.
        small = abs(error - self._previous) < self.tolerance
        self._quiet = self._quiet + 1 if small else 0
        self._previous = error
        return self._quiet >= self.window
