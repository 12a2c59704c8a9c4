"""A method of the comparison, and the data it gets; nothing here needs piezod."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = NDArray[np.bool_]
"""Mask of samples, shape (n,)."""
Setting: TypeAlias = Mapping[str, float | str]
"""One combination of the settings of a method, by name."""
Predictor: TypeAlias = Callable[[FloatArray], FloatArray]
"""Returns the drive for displacements over time, both of shape (n,)."""
Fitter: TypeAlias = Callable[["Series", Rows, Setting], Predictor]
"""Fits to the drive of some samples of a series; the displacement of all samples may be used."""


@dataclass(frozen=True)
class Series:
    """A record as every method gets it; arrays of shape (n,), evenly in time.

    0 and 1 are the ends of the ranges of the record of the fit.
    """

    positions: FloatArray  #: Displacements, smoothed.
    drives: FloatArray  #: Voltages that caused them, that is, one delay earlier.
    counted: Rows  #: Samples that count; the others only advance a memory.


class Method(NamedTuple):
    """A method of the comparison."""

    name: str  #: Its name in the table.
    about: str  #: Its settings, for people.
    fit: Fitter  #: The fit.
    grid: tuple[Setting, ...]  #: Settings among which cross-validation chooses.
    search_stride: int = 1  #: The choice of the settings uses every `search_stride`-th sample.


@dataclass(frozen=True)
class Row:
    """A row of the table; errors are in % of the range of the voltage, NaN if not measured."""

    method: str  #: Name of the method.
    setting: str = ""  #: Chosen settings, for people.
    held_out_max_pct: float = np.nan  #: Worst error on held-out blocks.
    held_out_rms_pct: float = np.nan  #: Rms error on held-out blocks.
    test_max_pct: float = np.nan  #: Worst error on the test record.
    test_rms_pct: float = np.nan  #: Rms error on the test record.
    fit_s: float = np.nan  #: Duration of one fit with the chosen settings, in s.
    sample_us: float = np.nan  #: Duration of the prediction of a whole record per sample, in µs.
    search_s: float = np.nan  #: Duration of the choice of the settings, in s.
    failure: str = ""  #: Reason why nothing was measured; empty otherwise.

    def document(self) -> dict[str, Any]:
        """Return the row for JSON, which has no NaN."""
        return {
            name: None if isinstance(value, float) and not np.isfinite(value) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Return the row that a document was made from."""
        values: dict[str, Any] = {k: np.nan if v is None else v for k, v in document.items()}
        return cls(**values)
