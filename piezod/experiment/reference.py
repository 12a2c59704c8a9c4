"""The errors that an experiment file gives to compare with."""

from typing import Final

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.error_rows import TRUE
from piezod.records.reference import Reference

COMPARED: Final = ("tracking_max_pct", "nonlinearity_pct")
"""A worst error is compared with a worst error, not the rms."""
COMPARED_TRUE: Final = tuple(TRUE)
"""Where a run is judged by its true errors, these are compared and the measured ones are not."""


def reference_of(config: ExperimentConfig) -> Reference | None:
    """Return the errors to compare with, None where the file gives none."""
    values = {
        (case.name, mode.value): error_pct
        for case in config.cases
        for mode, error_pct in case.reference_pct.items()
    }
    compared = COMPARED_TRUE if any(name in TRUE for name in config.metrics) else COMPARED
    return Reference(config.reference, values, compared) if values else None
