"""Settings of a fit of an inverse model."""

from dataclasses import dataclass

from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.smoothing import smoothed_record
from piezod.hysteresis.everett import SIZE


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Settings of a fit.

    Attributes:
        method: Method to find the weights.
        order: Operators on each side, M.
        spacing: Position of their thresholds.
        creep: Whether creep is fitted, too; by least squares only.
        lms_gain: γ, for LMS; None for the paper's, or a smaller one if that is not stable.
        deadband: Width of the backlash before the memory, in units of the range, for LMS. Least
            squares gets a smoothed displacement and needs none.
        delay_s: Delay in s; estimated from the record if None.
        smoothing: Whether noise is removed from the displacement first; for least squares only.
    """

    method: Method = Method.LEAST_SQUARES
    order: int = 19
    spacing: Spacing = Spacing.EVEN
    creep: bool = False
    lms_gain: float | None = None
    deadband: float = 0.0
    delay_s: float | None = None
    smoothing: bool = True

    @property
    def n_weights(self) -> int:
        """Number of weights of the model, or of coefficients of a surface."""
        return SIZE if self.method is Method.SURFACE else 2 * self.order

    def as_fitted(self, record: Record) -> Record:
        """Return a record as the fit uses it: smoothed, if `smoothing` is set."""
        if self.method is Method.LMS or not self.smoothing:
            return record
        return smoothed_record(record)
