"""An experiment on a running stage: every case in every mode, recorded by its daemon."""

import json
from collections.abc import Iterator
from functools import partial
from itertools import chain

from piezod.client import StageClient
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.experiment.fit.fit_numbers import numbers_of_file
from piezod.experiment.live.late import late_note
from piezod.experiment.live.plan import check_live, not_used
from piezod.experiment.live.record import LiveRun, cut_waveform, missing_cycles
from piezod.experiment.live.setup import LiveSetup, read_setup
from piezod.experiment.live.slower import slow_enough
from piezod.experiment.live.stage import ZERO_S, LiveStage
from piezod.experiment.prefix import prefix_errors
from piezod.experiment.progress import Meter, Progress
from piezod.experiment.session.runs import Run, all_runs, versions
from piezod.experiment.warnings import rate_warnings, run_warnings
from piezod.records.experiment_result import ExperimentResult, Identification, Recording
from piezod.records.recording.reader import RecordedTelemetry


def run_live(
    config: ExperimentConfig,
    configuration: str,
    title: str,
    client: StageClient,
    progress: Progress,
    largest_step_pct: float | None = None,
) -> ExperimentResult:
    """Run the cases of an experiment on a running stage, and disarm the stage at the end.

    Args:
        config: The experiment; its devices and models are not used.
        configuration: Text of its file, kept with the result.
        title: Description of the experiment, for people.
        client: A connection to the daemon of the stage.
        progress: Called as the experiment advances.
        largest_step_pct: Largest motion per cycle, in % of the command's range: faster commands are
            slowed down. None leaves them as they are.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states; the text
            starts with case and mode.
        DataError: If the experiment does not fit the stage, before anything moves, or if a
            recording does not contain the run.
        LatenessError: If the loop was late in a run, also in all repetitions.
        ModelError: If a model in use is not valid.
    """
    setup, slowed = read_setup(client), list[str]()
    if largest_step_pct is not None:
        config, slowed = slow_enough(config, setup.rate_hz, largest_step_pct)
    check_live(config, setup)
    meter = Meter(progress, _duration_s(config))
    with LiveStage(client, setup, meter.advance) as stage:
        runs = all_runs(config, meter, _Cases(stage, setup, config).run)
        stage.disarm()
    return ExperimentResult(
        title=f"{title} (live on stage {setup.stage})",
        recordings=tuple(run.recording for run in runs),
        identifications=tuple(_models(config, setup)),
        configuration=_with_setup(configuration, setup),
        versions=versions(),
        seed=setup.seed,
        rate_hz=setup.rate_hz,
        warnings=(
            *not_used(config, setup),
            *slowed,
            *rate_warnings(config, setup.rate_hz),
            *chain.from_iterable(run.warnings for run in runs),
            *stage.notes,
        ),
    )


class _Cases:
    """Runs cases one after the other."""

    def __init__(self, stage: LiveStage, setup: LiveSetup, config: ExperimentConfig) -> None:
        self._stage, self._setup, self._config = stage, setup, config

    def run(self, case: CaseConfig, mode: Mode) -> list[Run]:
        """Run a case until it is punctual; return one run per axis."""
        with prefix_errors(f"{case.name}, {mode.value}"):
            return self._stage.until_punctual(partial(self._run, case, mode), self._stage.disarm)

    def _run(self, case: CaseConfig, mode: Mode) -> list[Run]:
        """Rest, run a case, and return one run per axis."""
        stage, commands = self._stage, case.commands(self._config.axes)
        waveforms = {name: command.built(case.duration_s) for name, command in commands.items()}
        stage.disarm()
        stage.select(mode, commands)
        stage.rest(self._config.settle_s)
        stage.arm()
        stage.faults.clear()
        # The recording starts before the movement, because its start is found in the recording.
        stage.recorder.start(f"{case.name}-{mode.value}")
        stage.select(mode, commands)
        stage.follow(commands, case.duration_s, mode)
        telemetry = stage.recorder.end()
        run = LiveRun(case, mode, self._config.metrics)
        recordings = [
            cut_waveform(telemetry, name, self._setup.axes[name], waveform, run)
            for name, waveform in waveforms.items()
        ]
        return [Run(each, tuple(self._warnings(each, telemetry))) for each in recordings]

    def _warnings(self, recording: Recording, telemetry: RecordedTelemetry) -> Iterator[str]:
        yield from run_warnings(recording, merged_pairs=0)
        run = f"{recording.case}, {recording.mode}, axis {recording.axis}:"
        if note := late_note(recording, self._config.metrics):
            yield f"{run} {note}"
        missing = missing_cycles(telemetry)
        if missing:
            yield (
                f"{run} {missing} of {telemetry.cycles['t_s'].size + missing} cycles are missing "
                "from the record: the loop skipped them, or the disk was too slow."
            )
        yield from self._stage.fault_notes(f"{run} faults")


def _duration_s(config: ExperimentConfig) -> float:
    each_s = config.settle_s + ZERO_S
    return len(config.modes) * sum(each_s + case.duration_s for case in config.cases)


def _models(config: ExperimentConfig, setup: LiveSetup) -> Iterator[Identification]:
    """Yield the origin of the models that the stage had at the start."""
    title = f"model in use on stage {setup.stage}"
    for name in config.axes:
        axis = setup.axes[name]
        if axis.file is not None and axis.model is not None:
            yield numbers_of_file(axis.file, axis.model, axis=name, title=title)


def _with_setup(configuration: str, setup: LiveSetup) -> str:
    """Return the text of the file with the setup of the stage as a comment."""
    stage = json.dumps(setup.document, ensure_ascii=False)
    return f"{configuration}\n# Run on stage {setup.stage}, which was configured as:\n# {stage}\n"
