"""Residuals of a model, as a whole and block by block.

A residual is predicted minus recorded voltage, or predicted minus recorded position. The blocks of
a record are contiguous, because neighbouring samples are similar; each is held out of a fit once.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from piezod.experiment.fit.problem import LinearProblem
from piezod.experiment.fit.record import Rows
from piezod.hysteresis.memory import FloatArray

BLOCKS = 5
CLEAR_GAIN = 0.9
"""Largest ratio of the rms errors with and without a part of a model that needs evidence."""


class Residuals(NamedTuple):
    """Residuals of the samples that count, shape (k,) each."""

    #: Voltage predicted from the position, minus the recorded one, in % of its range.
    voltage_pct: FloatArray
    #: Position predicted from the voltage, minus the recorded one, in % of its range.
    position_pct: FloatArray

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms error of both, by name."""
        return {
            "voltage_error_max_pct": float(np.max(np.abs(self.voltage_pct))),
            "voltage_error_rms_pct": rms_of(self.voltage_pct),
            "position_error_max_pct": float(np.max(np.abs(self.position_pct))),
            "position_error_rms_pct": rms_of(self.position_pct),
        }

    @property
    def offsets_pct(self) -> tuple[float, float]:
        """Constant part of both, in %."""
        return float(np.mean(self.voltage_pct)), float(np.mean(self.position_pct))

    def without_offsets(self) -> "Residuals":
        """Return the residuals without their constant parts."""
        voltage_pct, position_pct = self.offsets_pct
        return Residuals(self.voltage_pct - voltage_pct, self.position_pct - position_pct)

    def at(self, places: Rows) -> "Residuals":
        """Return the residuals of some samples; mask of shape (k,)."""
        return Residuals(self.voltage_pct[places], self.position_pct[places])

    @classmethod
    def joined(cls, parts: "list[Residuals]") -> "Residuals":
        """Return the residuals of several parts, one after the other."""
        voltages_pct, positions_pct = zip(*parts, strict=True)
        return cls(np.concatenate(voltages_pct), np.concatenate(positions_pct))


def rms_of(values: FloatArray) -> float:
    """Return the rms of values."""
    return float(np.sqrt(np.mean(values**2)))


def blocks_of(counted: Rows, blocks: int = BLOCKS) -> Iterator[Rows]:
    """Yield the mask of each block, shape (n,), in the order of time.

    Args:
        counted: (n,) mask of the samples that count.
        blocks: Number of blocks.
    """
    for places in np.array_split(np.flatnonzero(counted), blocks):
        rows = np.zeros_like(counted)
        rows[places] = True
        yield rows


def held_out_squares(fit: LinearProblem) -> FloatArray:
    """Return the mean squared miss of each block by the fit to the others, shape (blocks,)."""
    squares = []
    for rows in blocks_of(fit.counted):
        moved = fit.solved(fit.counted & ~rows) - fit.parameters
        squares.append(np.mean((fit.misses[rows] + fit.regressors[rows] @ moved) ** 2))
    return np.array(squares)


def clearly_better(
    squares: FloatArray, others: FloatArray, ratio: float, standard_errors: float
) -> bool:
    """Return whether the rms error of all blocks is smaller, and not by chance.

    The mean is mostly that of the most difficult block, which may become better by accident while
    others become worse. So the gain of each block counts as the logarithm of the ratio of its
    errors. If one block alone gains, the mean gain is one standard error.

    Args:
        squares: (blocks,) mean squared errors, above 0.
        others: (blocks,) those to compare with, above 0.
        ratio: Largest ratio of the rms errors.
        standard_errors: The mean gain must exceed this number of its standard errors.
    """
    gains = np.log(others / squares)
    smaller = float(np.mean(squares)) <= ratio**2 * float(np.mean(others))
    return smaller and float(np.mean(gains)) > standard_errors * standard_error(gains)


def standard_error(values: FloatArray) -> float:
    """Return the standard error of the mean of values, shape (n,)."""
    return float(np.std(values, ddof=1)) / float(np.sqrt(values.size))
