"""The reference errors in an experiment file."""

from typing import Final

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.error_rows import TRUE
from piezod.records.reference import Reference

COMPARED: Final = ("tracking_max_pct", "nonlinearity_pct")
"""Metrics that are compared: the paper gives worst errors, not rms errors."""
COMPARED_TRUE: Final = ("true_tracking_max_pct", "true_nonlinearity_pct")
"""Metrics that are compared instead, if the metrics of the experiment include true errors."""


def reference_of(config: ExperimentConfig) -> Reference | None:
    """Return the reference errors, None if the file has none."""
    values = {
        (case.name, mode.value): error_pct
        for case in config.cases
        for mode, error_pct in case.reference_pct.items()
    }
    figures = {
        (case.name, mode.value): figure
        for case in config.cases
        for mode, figure in case.reference_figure.items()
    }
    compared = COMPARED_TRUE if any(name in TRUE for name in config.metrics) else COMPARED
    return Reference(config.reference, values, compared, figures) if values else None
