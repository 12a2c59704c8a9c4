"""An experiment from its configuration to its result: identify, then every case in every mode."""

from functools import partial
from itertools import chain

from piezod.config.daemon import ConditioningConfig
from piezod.config.experiment import ExperimentConfig
from piezod.experiment.progress import Meter, Progress
from piezod.experiment.session.runs import all_runs, versions
from piezod.experiment.virtual.case import run_case
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import opened
from piezod.experiment.warnings import rate_warnings
from piezod.records.experiment_result import ExperimentResult


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
    meter = Meter(progress, _duration_s(config))
    with opened(config, meter.advance) as stage:
        meter.label = "identification"
        identified = identify_axes(stage, config)
        runs = all_runs(config, meter, partial(run_case, stage, config, identified))
    return ExperimentResult(
        title=title,
        recordings=tuple(run.recording for run in runs),
        identifications=tuple(axis.numbers for axis in identified.values()),
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


def _duration_s(config: ExperimentConfig) -> float:
    runs = len(config.modes) * sum(config.settle_s + case.duration_s for case in config.cases)
    if config.identification is None:
        return runs
    swings = ConditioningConfig()
    conditioning_s = swings.cycles / swings.frequency_hz
    settings = config.identification
    return runs + settings.settle_s + settings.duration_s + conditioning_s
