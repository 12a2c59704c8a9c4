"""Slows the commands of an experiment down, for a slow loop.

The command moves by a step in each cycle, and the error is at least that step. A command that moves
by a tenth of a percent of its range per cycle has no larger error from this, at any rate.
"""

from collections.abc import Callable, Iterator
from typing import Any, Final

import numpy as np

from piezod.config.combined_waveforms import WaveformConfig
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.control.reference.waveforms import build_waveform
from piezod.errors import DataError

_LARGER: Final = ("duration_s", "dwell_s", "time_constant_s")
_SMALLER: Final = ("frequency_hz", "min_speed", "max_speed")
"""Keys of waveforms whose values grow, and shrink, when a waveform is slowed down."""


def slow_enough(
    config: ExperimentConfig, rate_hz: float, largest_step_pct: float
) -> tuple[ExperimentConfig, list[str]]:
    """Slow the commands of each case down until a cycle moves little enough.

    Args:
        config: The experiment.
        rate_hz: Cycles of the loop per second.
        largest_step_pct: Largest motion per cycle, in % of the command's range.

    Returns:
        The experiment, and a sentence per case with its frequencies.

    Raises:
        DataError: If a command comes from a file, whose times are fixed.
    """
    cases, notes = [], []
    for case in config.cases:
        # Never faster than in the file.
        factor = max(1.0, _step_pct(config, case, rate_hz) / largest_step_pct)
        slow = _slowed(case, factor)
        cases.append(slow)
        frequencies = ", ".join(dict.fromkeys(f"{hz:.4g} Hz" for hz in _frequencies(slow)))
        notes.append(
            f"{case.name}: slowed down {factor:.3g} times, its frequencies are {frequencies}; a "
            f"cycle moves at most {_step_pct(config, slow, rate_hz):.3f} % of the command's range."
        )
    return config.model_copy(update={"cases": tuple(cases)}), notes


def _step_pct(config: ExperimentConfig, case: CaseConfig, rate_hz: float) -> float:
    """Return the largest change of a command between two cycles, in % of its range."""
    largest = 0.0
    for command in case.commands(config.axes).values():
        waveform = build_waveform(command, case.duration_s)
        t_s = np.arange(round(case.duration_s * rate_hz)) / rate_hz
        position_um = waveform.sample(t_s)
        step_um = float(np.max(np.abs(np.diff(position_um)), initial=0.0))
        largest = max(largest, 100.0 * step_um / max(float(np.ptp(position_um)), 1e-12))
    return largest


def _slowed(case: CaseConfig, factor: float) -> CaseConfig:
    def slower(document: dict[str, Any]) -> dict[str, Any]:
        if document.get("kind") == "csv":
            raise DataError(f"{case.name}: the times of a CSV file cannot be slowed down")
        changed: dict[str, Any] = {}
        for key, value in document.items():
            if key in _LARGER:
                changed[key] = value * factor
            elif key in _SMALLER:
                changed[key] = value / factor
            elif key == "points":
                changed[key] = tuple((t_s * factor, level) for t_s, level in value)
            else:
                changed[key] = _apply_to_mappings(slower, value)
        return changed

    # `period_s` of the case is no waveform key.
    document = slower(case.model_dump())
    document["period_s"] = case.period_s * factor
    return CaseConfig.model_validate(document)


def _apply_to_mappings(change: Callable[[dict[str, Any]], dict[str, Any]], value: Any) -> Any:
    """Apply a change to every mapping within a value."""
    if isinstance(value, dict):
        return change(value)
    if isinstance(value, tuple | list):
        return tuple(_apply_to_mappings(change, each) for each in value)
    return value


def _frequencies(case: CaseConfig) -> Iterator[float]:
    commands: dict[str, WaveformConfig] = case.commands([""])
    yield from _frequencies_in({name: each.model_dump() for name, each in commands.items()})


def _frequencies_in(value: Any) -> Iterator[float]:
    if isinstance(value, dict):
        for key, each in value.items():
            if key == "frequency_hz":
                yield each
            else:
                yield from _frequencies_in(each)
    elif isinstance(value, tuple | list):
        for each in value:
            yield from _frequencies_in(each)
