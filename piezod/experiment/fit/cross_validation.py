"""Cross-validation: prediction errors on blocks of the record, each held out once.

Memory and creep run through the whole record; only the fit leaves the block out.
"""

from dataclasses import dataclass

import numpy as np

from piezod.control.law.model import StageModel
from piezod.experiment.fit.blocks import BLOCKS, blocks_of, standard_error
from piezod.experiment.fit.fit import Fit
from piezod.experiment.fit.residuals import Residuals


@dataclass(frozen=True)
class Block:
    """One block of a record, and the model that was fitted to the others."""

    start_s: float  #: Time of its first sample, in s.
    end_s: float  #: Time of its last sample, in s.
    model: StageModel  #: The model.
    residuals: Residuals  #: Residuals of the block.

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms errors of the block, by name."""
        return self.residuals.errors


@dataclass(frozen=True)
class CrossValidation:
    """Errors over all blocks."""

    blocks: tuple[Block, ...]  #: The blocks, in the order of time.

    @property
    def errors(self) -> dict[str, float]:
        """Worst and rms errors of the predicted voltage and position, in %, by name."""
        return Residuals.joined([block.residuals for block in self.blocks]).errors

    @property
    def rms_pct(self) -> float:
        """Rms error of the voltage, in %."""
        return self.errors["voltage_error_rms_pct"]

    @property
    def position_rms_pct(self) -> float:
        """Rms error of the position, in %."""
        return self.errors["position_error_rms_pct"]

    @property
    def rms_with_standard_error_pct(self) -> float:
        """Rms error of the voltage plus one standard error of its mean square over the blocks."""
        squares = self.squares.voltage_pct
        return float(np.sqrt(np.mean(squares) + standard_error(squares)))

    @property
    def squares(self) -> Residuals:
        """Mean squared residuals of each block, in %², shape (blocks,) each."""
        blocks = [block.residuals for block in self.blocks]
        return Residuals(
            np.array([np.mean(block.voltage_pct**2) for block in blocks]),
            np.array([np.mean(block.position_pct**2) for block in blocks]),
        )


def cross_validate(fit: Fit, blocks: int = BLOCKS) -> CrossValidation:
    """Return the errors of a fit on blocks of its record, each held out once.

    Args:
        fit: The fit.
        blocks: Number of blocks.
    """
    record = fit.record
    counted = record.counted(fit.model.delay_s)
    held_out = []
    for rows in blocks_of(counted, blocks):
        model, times_s = fit.without(rows), record.t_s[rows]
        held_out.append(
            Block(
                start_s=float(times_s[0]),
                end_s=float(times_s[-1]),
                model=model,
                residuals=fit.residuals(record, model).at(rows[counted]),
            )
        )
    return CrossValidation(tuple(held_out))
