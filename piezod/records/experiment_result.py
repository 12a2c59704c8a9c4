"""Data of runs as frozen dataclasses: columns, parameters, metrics, and their origin."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np

from piezod.errors import DataError
from piezod.records.frozen import (
    Comparable,
    FloatArray,
    freeze,
    freeze_columns,
    freeze_mapping,
    frozen_array,
)

COLUMN_NAMES: Final = (
    "t_s",
    "drive_v",
    "position_um",
    "command_um",
    "uncompensated_v",
    "true_um",
)
FIT_COLUMN_NAMES: Final = ("t_s", "drive_v", "position_um", "predicted_v")


@dataclass(frozen=True, eq=False)
class Recording(Comparable):
    """One axis in one case and one mode, sample by sample."""

    axis: str  #: Name of the axis.
    case: str  #: Name of the case.
    mode: str  #: Name of the control mode.
    title: str  #: Description of the case, for people.
    t_s: FloatArray  #: Time in s, shape (n_samples,).
    drive_v: FloatArray  #: Applied voltage in V, same shape.
    position_um: FloatArray  #: Measured displacement in µm, same shape; NaN for an invalid sample.
    command_um: FloatArray  #: Commanded displacement in µm, same shape.
    uncompensated_v: FloatArray  #: Voltage without compensation, proportional to the command, in V.
    #: True displacement in µm, same shape, before the sensor and without its noise; NaN if it is
    #: not known, that is for every stage except a simulated one.
    true_um: FloatArray
    #: Parameters of the compensator, shape (n_snapshots, 2M), the M right operators first, or
    #: (n_snapshots, 24) coefficients of a surface; (0, 0) if there is no compensator.
    weights: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    #: Instants of the snapshots in s, shape (n_snapshots,).
    weights_t_s: FloatArray = field(default_factory=lambda: np.empty(0))
    #: Errors by name; the name ends in the unit.
    metrics: Mapping[str, float] = field(default_factory=dict)
    first_metric_index: int = 0  #: Samples before this index are left out of the metrics.
    #: Instants of the samples just after a stall of the loop, in s, shape (n_late,).
    late_t_s: FloatArray = field(default_factory=lambda: np.empty(0))
    #: Whether `weights` are the coefficients of a surface, which have no sides.
    surface: bool = False

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes.

        Raises:
            DataError: If it is empty, the shapes do not match, or the first index is out of range.
        """
        where = f"recording {self.axis}/{self.case}/{self.mode}"
        freeze_columns(self, COLUMN_NAMES, where)
        freeze(self, "weights", 2, where)
        freeze(self, "weights_t_s", 1, where)
        freeze(self, "late_t_s", 1, where)
        freeze_mapping(self, "metrics")
        if not self.t_s.size:
            raise DataError(f"{where}: there are no samples; allowed is one or more")
        n_snapshots, n_weights = self.weights.shape
        if n_snapshots != self.weights_t_s.size or (n_weights % 2 and not self.surface):
            raise DataError(
                f"{where}: weights have shape {self.weights.shape}; allowed is "
                f"({self.weights_t_s.size}, 2M), a row for each of weights_t_s"
            )
        if not 0 <= self.first_metric_index < self.t_s.size:
            raise DataError(
                f"{where}: first_metric_index is {self.first_metric_index}; allowed is 0 to "
                f"{self.t_s.size - 1}, the index of a sample"
            )

    @property
    def key(self) -> tuple[str, str, str]:
        """Axis, case and mode, which together identify a recording within an experiment."""
        return self.axis, self.case, self.mode

    @property
    def error_um(self) -> FloatArray:
        """Commanded minus measured displacement in µm, shape (n_samples,)."""
        return self.command_um - self.position_um

    @property
    def true_error_um(self) -> FloatArray:
        """Commanded minus true displacement in µm, shape (n_samples,); NaN if not known."""
        return self.command_um - self.true_um

    @property
    def knows_truth(self) -> bool:
        """Whether the true displacement of any sample is known."""
        return bool(np.isfinite(self.true_um).any())

    @property
    def position_range_um(self) -> float:
        """Displacement range, max - min in µm, of the samples of the metrics."""
        return _range(self.position_um[self.first_metric_index :])

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns by name, in the order of a data file."""
        return {name: getattr(self, name) for name in COLUMN_NAMES}


@dataclass(frozen=True, eq=False)
class Identification(Comparable):
    """The model of one axis, its origin, and its prediction of the drive voltage."""

    axis: str  #: Name of the axis.
    #: Description of the record, or of the file from which the model was read, for people.
    title: str
    method: str  #: Method that made the model.
    t_s: (
        FloatArray  #: Time in s, shape (n_samples,); empty if the model was not fitted to a record.
    )
    drive_v: FloatArray  #: Applied voltage in V, same shape.
    #: Displacement measured at the same time, in µm, same shape; it lags behind the voltage by the
    #: model's delay.
    position_um: FloatArray
    #: Voltage that the model predicts, in V, same shape. Each value is computed from the
    #: displacement one delay later, so that it corresponds to the applied voltage. NaN in the
    #: run-in, and at the end, where no later displacement was recorded.
    predicted_v: FloatArray
    #: Errors of the prediction by name; the name ends in the unit.
    fit_errors: Mapping[str, float] = field(default_factory=dict)
    #: Parameters of the model by name, each of any shape.
    parameters: Mapping[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Freeze the arrays and check their shapes.

        Raises:
            DataError: If the columns differ in length.
        """
        freeze_columns(self, FIT_COLUMN_NAMES, f"identification of {self.axis}")
        freeze_mapping(self, "fit_errors")
        frozen = {name: frozen_array(values) for name, values in self.parameters.items()}
        object.__setattr__(self, "parameters", MappingProxyType(frozen))

    @property
    def residual_v(self) -> FloatArray:
        """Predicted minus applied voltage in V, shape (n_samples,)."""
        return self.predicted_v - self.drive_v

    @property
    def drive_range_v(self) -> float:
        """Range of the applied voltage, max - min in V."""
        return _range(self.drive_v)

    def columns(self) -> dict[str, FloatArray]:
        """Return the columns by name, in the order of a data file."""
        return {name: getattr(self, name) for name in FIT_COLUMN_NAMES}


@dataclass(frozen=True, eq=False)
class ExperimentResult(Comparable):
    """All results of one experiment."""

    title: str  #: Description of the experiment, for people.
    recordings: tuple[Recording, ...]  #: One per axis, case and mode, in the order of the runs.
    identifications: tuple[Identification, ...]  #: One per axis, in the order of the axes.
    configuration: str  #: Text of the configuration file.
    versions: Mapping[str, str]  #: Versions of the programs by name.
    seed: int  #: Seed of all random numbers of the run.
    rate_hz: float  #: Rate of the loop in Hz, above 0.
    warnings: tuple[str, ...] = ()  #: Reservations about the result, each with its remedy.

    def __post_init__(self) -> None:
        """Check that each recording is there once.

        Raises:
            DataError: If two recordings have the same axis, case and mode.
        """
        freeze_mapping(self, "versions")
        keys = [recording.key for recording in self.recordings]
        for axis, case, mode in sorted({key for key in keys if keys.count(key) > 1}):
            raise DataError(
                f"recording {axis}/{case}/{mode} appears {keys.count((axis, case, mode))} times; "
                "axis, case and mode name a recording, rename one of the cases"
            )

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the recorded axes, in the order of their first appearance."""
        return _unique(recording.axis for recording in self.recordings)

    @property
    def cases(self) -> tuple[str, ...]:
        """Names of the cases, in the order of their first appearance."""
        return _unique(recording.case for recording in self.recordings)

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes, in the order of their first appearance."""
        return _unique(recording.mode for recording in self.recordings)

    @property
    def metric_names(self) -> tuple[str, ...]:
        """Names of the metrics of any recording, in the order of their first appearance."""
        return _unique(name for recording in self.recordings for name in recording.metrics)

    def by_case(self) -> dict[tuple[str, str], tuple[Recording, ...]]:
        """Return the recordings by (axis, case), in the order of their first appearance."""
        keys = dict.fromkeys(recording.key[:2] for recording in self.recordings)
        return {
            key: tuple(recording for recording in self.recordings if recording.key[:2] == key)
            for key in keys
        }


def _unique(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(names))


def _range(values: FloatArray) -> float:
    known = values[np.isfinite(values)]  # an invalid sample is NaN
    return float(np.ptp(known)) if known.size else 0.0
