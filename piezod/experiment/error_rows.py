"""What an experiment is judged by: the errors of each run."""

from collections.abc import Callable, Mapping

import numpy as np

from piezod.hysteresis import nonlinearity, tracking_max, tracking_rms
from piezod.hysteresis.memory import FloatArray
from piezod.records.recording import ExperimentResult

METRICS: Mapping[str, Callable[[FloatArray, FloatArray], float]] = {
    "tracking_max_pct": tracking_max,
    "tracking_rms_pct": tracking_rms,
    "nonlinearity_pct": nonlinearity,
}
"""By the names that experiment files use: functions of command and position."""


def errors_pct(
    metrics: tuple[str, ...], command_um: FloatArray, position_um: FloatArray
) -> dict[str, float]:
    """Return errors by name, in % of the displacement's range; NaN where there is none.

    There is none where nothing was measured, and where the command is constant: what moves then is
    noise, and a share of its range would say nothing.

    Args:
        metrics: Names from `METRICS`.
        command_um: (n,) commanded displacement, in µm, without the first period.
        position_um: (n,) displacement measured at the same instants, NaN where it was invalid.
    """
    measured = np.isfinite(position_um)
    command_um, position_um = command_um[measured], position_um[measured]
    if position_um.size < 2 or np.ptp(position_um) == 0.0 or np.ptp(command_um) == 0.0:
        return dict.fromkeys(metrics, float("nan"))
    return {name: 100.0 * METRICS[name](command_um, position_um) for name in metrics}


def error_rows(result: ExperimentResult) -> list[dict[str, str | float]]:
    """Return one row for each run, in the order they were run."""
    return [
        {"axis": r.axis, "case": r.case, "mode": r.mode, **r.metrics} for r in result.recordings
    ]
