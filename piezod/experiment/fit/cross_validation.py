"""Cross-validation: prediction errors on blocks of the record, each held out once.

Blocks are contiguous, because neighbouring samples are similar. Memory and creep run through the
whole record; only the fit leaves the block out.
"""

from dataclasses import dataclass

import numpy as np

from piezod.control.law.model import StageModel
from piezod.experiment.fit.fit import Fit, errors_of
from piezod.hysteresis.memory import FloatArray

BLOCKS = 5


@dataclass(frozen=True)
class Block:
    """One block of a record, and the model that was fitted to the others.

    Attributes:
        start_s: Time of its first sample, in s.
        end_s: Time of its last sample, in s.
        model: The model.
        residuals_pct: (k,) predicted minus actual voltage, in % of its range.
    """

    start_s: float
    end_s: float
    model: StageModel
    residuals_pct: FloatArray

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms error of the block, by name."""
        return errors_of(self.residuals_pct)


@dataclass(frozen=True)
class CrossValidation:
    """Errors over all blocks.

    Attributes:
        blocks: The blocks, in the order of time.
    """

    blocks: tuple[Block, ...]

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms error of the predicted voltage, in %, by name."""
        return errors_of(np.concatenate([block.residuals_pct for block in self.blocks]))

    @property
    def rms_pct(self) -> float:
        """Rms error, in %."""
        return self.errors["voltage_error_rms_pct"]

    @property
    def rms_with_standard_error_pct(self) -> float:
        """Rms error plus one standard error of its mean square over the blocks, in %."""
        squares = [float(np.mean(block.residuals_pct**2)) for block in self.blocks]
        standard_error = float(np.std(squares, ddof=1)) / np.sqrt(len(squares))
        return float(np.sqrt(np.mean(squares) + standard_error))


def cross_validate(fit: Fit, blocks: int = BLOCKS) -> CrossValidation:
    """Return the errors of a fit on blocks of its record, each held out once.

    Args:
        fit: The fit.
        blocks: Number of blocks.
    """
    record = fit.record
    counted = np.flatnonzero(record.counted(fit.model.delay_s))
    held_out = []
    for places in np.array_split(np.arange(counted.size), blocks):
        rows = np.zeros(record.t_s.size, dtype=np.bool_)
        rows[counted[places]] = True
        model = fit.without(rows)
        held_out.append(
            Block(
                start_s=float(record.t_s[counted[places[0]]]),
                end_s=float(record.t_s[counted[places[-1]]]),
                model=model,
                residuals_pct=fit.residuals_pct(record, model)[places],
            )
        )
    return CrossValidation(tuple(held_out))
