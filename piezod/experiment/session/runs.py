"""The runs of an experiment on any stage: every case in every mode, with errors and warnings."""

import platform
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib.metadata import version
from typing import Final, NamedTuple

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.experiment.error_rows import errors_pct
from piezod.experiment.progress import Meter
from piezod.experiment.steps import step_metrics
from piezod.records.experiment_result import Recording

RANGE_MARGIN: Final = 0.01
"""A command may exceed the identified range by this share of it, because of noise and drift at both
ends."""
LARGEST_SHARE: Final = 0.1
"""If a larger share of the samples is late, none is left out: the errors are those of the stall."""


class Run(NamedTuple):
    """One axis in one case and one mode."""

    recording: Recording  #: The recording, with its errors.
    warnings: tuple[str, ...]  #: Warnings for its reader.


def all_runs(
    config: ExperimentConfig, meter: Meter, run: Callable[[CaseConfig, Mode], Iterable[Run]]
) -> list[Run]:
    """Run every case in every mode, one after the other."""
    runs: list[Run] = []
    for case in config.cases:
        for mode in config.modes:
            meter.label = f"{case.name}, {mode.value}"
            runs += run(case, mode)
    return runs


def with_errors(recording: Recording, metrics: tuple[str, ...], period_s: float) -> Recording:
    """Return a recording with its errors, and with the settling times of a command in steps."""
    errors = judged_errors_pct(recording, metrics, with_late=False)
    judged = slice(recording.first_metric_index, None)
    columns = recording.command_um[judged], recording.position_um[judged]
    return replace(recording, metrics=errors | step_metrics(*columns, period_s))


def judged_errors_pct(
    recording: Recording, metrics: tuple[str, ...], *, with_late: bool
) -> dict[str, float]:
    """Return the errors of a recording, in % of the range, with or without late samples."""
    judged = np.zeros(recording.t_s.size, bool)
    judged[recording.first_metric_index :] = True
    if not with_late and recording.late_t_s.size <= LARGEST_SHARE * recording.t_s.size:
        judged &= ~np.isin(recording.t_s, recording.late_t_s)
    columns = recording.command_um, recording.position_um, recording.true_um
    return errors_pct(metrics, *(values[judged] for values in columns))


def versions() -> dict[str, str]:
    """Return the versions of the programs that made a result, by name."""
    names = ("piezod", "numpy", "numba", "scipy", "pydantic", "h5py", "matplotlib")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}
