"""What a fit needs of the problem that it solves, for every form of model."""

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

import numpy as np

from piezod.control.law.model import StageModel
from piezod.experiment.fit.record import Record, Rows
from piezod.experiment.fit.settings import FitSettings
from piezod.hysteresis import AffineRange
from piezod.hysteresis.memory import FloatArray

STEP_PARTS: Final = (1.0, 0.5, 0.25, 0.125)
"""Parts of a step that a search tries."""


class HasError(Protocol):
    """A point of a search."""

    @property
    def rms(self) -> float:
        """Its rms error."""


Point = TypeVar("Point", bound=HasError)


def first_better(point: Point, tried: Iterable[Point]) -> Point | None:
    """Return the first point that is better than this one; None if there is none."""
    rms = point.rms
    return next((there for there in tried if there.rms < rms), None)


@dataclass(frozen=True)
class LinearProblem(ABC):
    """A problem around its solution: linear in all parameters."""

    regressors: FloatArray  #: (n, p) regressors of the parameters; those of the weights come first.
    target: FloatArray  #: (n,) values that they must add up to.
    counted: Rows  #: (n,) mask of the rows that count.
    parameters: FloatArray  #: (p,) solution.

    @property
    def misses(self) -> FloatArray:
        """Predicted minus recorded value in units of its range, shape (n,)."""
        return self.regressors @ self.parameters - self.target

    @property
    def rms(self) -> float:
        """Rms of the misses that count."""
        return float(np.sqrt(np.mean(self.misses[self.counted] ** 2)))

    @property
    @abstractmethod
    def drive_changes(self) -> FloatArray:
        """Change of the drive per change of the predicted value, both normalised, shape (n,)."""

    @property
    @abstractmethod
    def creep_gradient(self) -> FloatArray | None:
        """Change of the creep per decade with each parameter, shape (p,); None without creep."""

    @abstractmethod
    def covariance(self, residual_variance: float) -> FloatArray:
        """Return the covariance of the parameters without active constraints, shape (p, p).

        Args:
            residual_variance: Mean squared residual per independent sample.
        """

    @abstractmethod
    def solved(self, rows: Rows) -> FloatArray:
        """Return the parameters that fit these rows best, shape (p,)."""


class Problem(ABC):
    """A record with its ranges, and what a fit searches in it."""

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
