"""Slows the commands of an experiment down, for a slow loop.

The command moves by a step in each cycle, and the error is at least that step. A command that moves
by a tenth of a percent of its range per cycle has no larger error from this, at any rate.
"""

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.experiment.prefix import prefix_errors


def slow_enough(
    config: ExperimentConfig, rate_hz: float, largest_step_pct: float
) -> tuple[ExperimentConfig, list[str]]:
    """Slow the commands of each case down until a cycle moves little enough.

    Returns:
        The experiment, and a sentence per case with its highest frequency.

    Raises:
        DataError: If a command comes from a file, whose times are fixed.
    """
    cases, notes = [], []
    for case in config.cases:
        # Never faster than in the file.
        factor = max(1.0, _step_pct(config, case, rate_hz) / largest_step_pct)
        with prefix_errors(case.name):
            slow = CaseConfig.model_validate(case.slowed(factor).model_dump())
        cases.append(slow)
        notes.append(
            f"{case.name}: slowed down {factor:.3g} times{_frequency(slow)}; a cycle moves at most "
            f"{_step_pct(config, slow, rate_hz):.3f} % of the command's range."
        )
    return config.model_copy(update={"cases": tuple(cases)}), notes


def _step_pct(config: ExperimentConfig, case: CaseConfig, rate_hz: float) -> float:
    """Return the largest change of a command between two cycles, in % of its range."""
    largest = 0.0
    for command in case.commands(config.axes).values():
        waveform = command.built(case.duration_s)
        t_s = np.arange(round(case.duration_s * rate_hz)) / rate_hz
        position_um = np.array(waveform.sample(t_s))
        step_um = float(np.max(np.abs(np.diff(position_um)), initial=0.0))
        largest = max(largest, 100.0 * step_um / max(float(np.ptp(position_um)), 1e-12))
    return largest


def _frequency(case: CaseConfig) -> str:
    highest_hz = max(each.highest_hz() for each in case.commands([""]).values())
    return f", to at most {highest_hz:.4g} Hz" if highest_hz else ""
