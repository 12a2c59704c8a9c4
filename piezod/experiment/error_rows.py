"""The errors of each run of an experiment.

A measured error contains the error of the sensor. If a simulated device knows the true
displacement, the rows also have the true errors and the noise of the sensor.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from piezod.experiment.sensor_noise import noise_rms
from piezod.experiment.steps import held
from piezod.hysteresis import nonlinearity, tracking_max, tracking_rms
from piezod.hysteresis.memory import FloatArray
from piezod.records.experiment_result import ExperimentResult


class Samples(NamedTuple):
    """The samples that count; arrays of shape (n,)."""

    command_um: FloatArray  #: Command, in µm.
    position_um: FloatArray  #: Measured position at the same instants, in µm.
    true_um: FloatArray  #: True displacement at the same instants, in µm; NaN if it is unknown.
    true_velocity: FloatArray  #: Velocity of the true displacement, in µm per sample.


Metric = Callable[[Samples], float]

MEASURED: Final[Mapping[str, Metric]] = {
    "tracking_max_pct": lambda s: tracking_max(s.command_um, s.position_um),
    "tracking_rms_pct": lambda s: tracking_rms(s.command_um, s.position_um),
    "nonlinearity_pct": lambda s: nonlinearity(s.command_um, s.position_um),
}
"""Errors of the measured position over its range, by the names in experiment files."""
TRUE: Final[Mapping[str, Metric]] = {
    "true_tracking_max_pct": lambda s: tracking_max(s.command_um, s.true_um),
    "true_tracking_rms_pct": lambda s: tracking_rms(s.command_um, s.true_um),
    "true_nonlinearity_pct": lambda s: nonlinearity(s.command_um, s.true_um),
}
"""Errors of the true displacement over its range."""
NOISE: Final[Mapping[str, Metric]] = {
    "noise_rms_pct": lambda s: noise_rms(s.position_um, s.true_um, s.true_velocity),
}
"""Noise of the sensor, over the range of the true displacement."""
NEED_TRUTH: Final = (*TRUE, *NOISE)
"""Names of the metrics that need the true displacement."""
_METRICS: Final = {**MEASURED, **TRUE, **NOISE}


def errors_pct(
    metrics: tuple[str, ...],
    command_um: FloatArray,
    position_um: FloatArray,
    true_um: FloatArray,
) -> dict[str, float]:
    """Return errors by name, in % of the displacement's range; NaN if there is none.

    There is none without a measurement, without a true displacement that is needed, and for a
    constant command: then only noise moves, and a share of its range means nothing. Of a command
    in steps only the second half of each level counts.

    Args:
        metrics: Names from `MEASURED`, `TRUE` and `NOISE`.
        command_um: (n,) command, in µm, without the first period.
        position_um: (n,) measured position at the same instants, in µm; NaN if it was invalid.
            Invalid samples count in no error, not in the true ones either, so that all have the
            same samples.
        true_um: (n,) true displacement at the same instants, in µm; NaN if it is unknown.
    """
    # All errors of a run must belong to the same samples.
    measured = np.isfinite(position_um) & held(command_um)
    columns = command_um, position_um, true_um, _velocity(true_um)
    samples = Samples(*(column[measured] for column in columns))
    return {name: _percent(name, samples) for name in metrics}


def _percent(name: str, samples: Samples) -> float:
    judged = samples.true_um if name in NEED_TRUTH else samples.position_um
    if not (_moves(samples.command_um) and _moves(judged)):
        return float("nan")
    return 100.0 * _METRICS[name](samples)


def _moves(values: FloatArray) -> bool:
    """Return whether the values have a range; unknown values have none."""
    return values.size > 1 and bool(np.ptp(values) > 0.0)


def _velocity(values: FloatArray) -> FloatArray:
    return np.gradient(values) if values.size > 1 else np.zeros_like(values)


def error_rows(result: ExperimentResult) -> list[dict[str, str | float]]:
    """Return one row per run, in the order of the runs."""
    return [
        {"axis": r.axis, "case": r.case, "mode": r.mode, **r.metrics} for r in result.recordings
    ]
