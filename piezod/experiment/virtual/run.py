"""An experiment from its configuration to its result: identify, then every case in every mode."""

import platform
from collections.abc import Callable
from importlib.metadata import version
from itertools import chain

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.virtual.case import VirtualRun, run_case
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from piezod.experiment.warnings import rate_warnings
from piezod.records.experiment_result import ExperimentResult

Progress = Callable[[str, float], None]
"""Called with the present step and the share of the experiment that is done."""

_REPORT_EVERY_CYCLES = 500


def run_experiment(
    config: ExperimentConfig, configuration: str, title: str, progress: Progress
) -> ExperimentResult:
    """Run an experiment in virtual time, on one stage from beginning to end.

    Args:
        config: The experiment.
        configuration: Text of its file, kept with the result.
        title: Description of the experiment, for people.
        progress: Called as the experiment advances.

    Raises:
        ConfigError: If a model file cannot be used.
        DataError: If the identification record cannot be used, or a command leaves its range.
        DeviceError: If a device cannot be opened or refuses a voltage.
        ModelError: If a gain is not safe: before anything moves, or before the first case if the
            delay is identified.
    """
    meter = _ProgressMeter(_duration_s(config) * config.rate_hz, progress)
    with opened(config, meter.advance) as stage:
        meter.label = "identification"
        identified = identify_axes(stage, config)
        runs: list[VirtualRun] = []
        for case in config.cases:
            for mode in config.modes:
                meter.label = f"{case.name}, {mode.value}"
                runs += run_case(stage, config, identified, case, mode)
    return ExperimentResult(
        title=title,
        recordings=tuple(run.recording for run in runs),
        identifications=tuple(axis.account for axis in identified.values()),
        configuration=configuration,
        versions=versions(),
        seed=config.seed,
        rate_hz=config.rate_hz,
        warnings=(
            *rate_warnings(config, config.rate_hz),
            *chain.from_iterable(axis.warnings for axis in identified.values()),
            *chain.from_iterable(run.warnings for run in runs),
        ),
    )


class _ProgressMeter:
    """Turns the number of cycles into a share of the experiment."""

    def __init__(self, cycles: float, progress: Progress) -> None:
        self._cycles, self._progress = cycles, progress
        self._done = 0
        self.label = ""

    def advance(self, cycles: int) -> None:
        self._done += cycles
        if self._done % _REPORT_EVERY_CYCLES == 0:
            self._progress(self.label, min(1.0, self._done / self._cycles))


def _duration_s(config: ExperimentConfig) -> float:
    runs = len(config.modes) * sum(config.settle_s + case.duration_s for case in config.cases)
    if config.identification is None:
        return runs
    return runs + config.identification.settle_s + config.identification.duration_s


def versions() -> dict[str, str]:
    """Return the versions of the programs that made a result, by name."""
    names = ("piezod", "numpy", "numba", "scipy", "pydantic", "h5py", "matplotlib")
    return {"python": platform.python_version(), **{name: version(name) for name in names}}
