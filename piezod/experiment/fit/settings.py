"""Settings of a fit of an inverse model."""

from dataclasses import dataclass

from piezod.experiment.fit.method import Method, Spacing
from piezod.experiment.fit.record import Record
from piezod.experiment.fit.smoothing import smoothed_record
from piezod.hysteresis.everett import SIZE


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """Settings of a fit."""

    method: Method = Method.LEAST_SQUARES  #: Method to find the weights.
    #: Operators on each side, M. A surface has none; its search for the delay begins with a model
    #: of this order.
    order: int = 19
    spacing: Spacing = Spacing.EVEN  #: Position of their thresholds; a surface has none.
    #: Whether creep is fitted, too, not by LMS; None: if the record is long enough to show it.
    creep: bool | None = False
    #: γ, for LMS; None for the paper's, or a smaller one if that is not stable.
    lms_gain: float | None = None
    #: Width of the backlash before the memory, in units of the range, for LMS. Least squares gets a
    #: smoothed displacement and needs none.
    deadband: float = 0.0
    delay_s: float | None = None  #: Delay in s; estimated from the record if None.
    smoothing: bool = True  #: Whether noise is removed from the displacement first; not for LMS.

    @property
    def n_weights(self) -> int:
        """Number of weights of the model."""
        return SIZE if self.method is Method.SURFACE else 2 * self.order

    def as_fitted(self, record: Record) -> Record:
        """Return a record as the fit uses it: smoothed, if `smoothing` is set."""
        if self.method is Method.LMS or not self.smoothing:
            return record
        return smoothed_record(record)
