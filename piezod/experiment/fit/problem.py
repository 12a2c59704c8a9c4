"""What a fit needs of the problem that it solves, for every form of model."""

from abc import ABC, abstractmethod
from typing import Protocol

from piezod.control.law.model import StageModel
from piezod.experiment.fit.record import Record, Rows
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis import AffineRange
from piezod.hysteresis.memory import FloatArray


class LinearProblem(Protocol):
    """A problem around its solution: linear in all parameters."""

    @property
    def regressors(self) -> FloatArray:
        """Regressors of the parameters, shape (n, p); those of the weights come first."""

    @property
    def counted(self) -> Rows:
        """Mask of the rows that count, shape (n,)."""

    @property
    def parameters(self) -> FloatArray:
        """Solution, shape (p,)."""

    @property
    def misses(self) -> FloatArray:
        """Predicted minus recorded value in units of its range, shape (n,)."""

    @property
    def drive_changes(self) -> FloatArray:
        """Change of the drive per change of the predicted value, both normalised, shape (n,)."""

    @property
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter, shape (p,); None without creep."""

    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters without active constraints, shape (p, p).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """

    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (p,)."""


class Problem(ABC):
    """A record with its ranges, and what a fit searches in it.

    Args:
        record: Drive and displacement, prepared for the method.
        settings: Settings of the fit.
    """

    def __init__(self, record: Record, settings: FitSettings) -> None:
        counted = record.counted()
        self.record, self._settings = record, settings
        self.drive_v = _range_of(record.drive_v[counted])
        self.position_um = _range_of(record.position_um[counted])

    @abstractmethod
    def without(
        self, model: StageModel, linearised: LinearProblem | None, held_out: Rows
    ) -> StageModel:
        """Return the model of the record without some samples.

        Args:
            model: Model of the whole record.
            linearised: The problem, linear around it; None if it is not linear.
            held_out: (n,) mask of the samples to leave out.
        """


def _range_of(values: FloatArray) -> AffineRange:
    return AffineRange.checked(float(values.min()), float(values.max()))
