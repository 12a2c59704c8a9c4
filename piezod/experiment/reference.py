"""The errors that an experiment file gives to compare with."""

from typing import Final

from piezod.config.experiment import ExperimentConfig
from piezod.records.reference import Reference

COMPARED: Final = ("tracking_max_pct", "nonlinearity_pct")
"""A worst error is compared with a worst error, not the rms."""


def reference_of(config: ExperimentConfig) -> Reference | None:
    """Return the errors to compare with, None where the file gives none."""
    values = {
        (case.name, mode.value): error_pct
        for case in config.cases
        for mode, error_pct in case.reference_pct.items()
    }
    return Reference(config.reference, values, COMPARED) if values else None
