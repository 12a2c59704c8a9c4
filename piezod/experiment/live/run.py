"""An experiment on a running stage: every case in every mode, recorded by its daemon."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from piezod.client import StageClient
from piezod.config.experiment import ExperimentConfig
from piezod.config.experiment_fields import CaseConfig
from piezod.config.modes import Mode
from piezod.control.reference.waveforms import build_waveform
from piezod.errors import ClientError, DataError
from piezod.experiment.fit.account import parameters_of
from piezod.experiment.live.plan import check_live, not_used
from piezod.experiment.live.record import LiveRun, cut, missing_cycles
from piezod.experiment.live.setup import LiveSetup, read_setup
from piezod.experiment.live.slower import slow_enough
from piezod.experiment.live.stage import ZERO_S, LiveStage
from piezod.experiment.virtual.run import Progress, versions
from piezod.experiment.warnings import run_warnings
from piezod.records.recording import ExperimentResult, Identification, Recording
from piezod.records.telemetry_reader import RecordedTelemetry


def run_live(
    config: ExperimentConfig,
    configuration: str,
    title: str,
    client: StageClient,
    progress: Progress,
    largest_step_pct: float | None = None,
) -> ExperimentResult:
    """Run the cases of an experiment on a running stage; it is disarmed at the end, whatever comes.

    Args:
        config: What to run; what concerns devices and models is not used.
        configuration: The text of its file, kept with the result.
        title: What the experiment is, for people.
        client: A connection to the stage's daemon.
        progress: Told as it goes on.
        largest_step_pct: What a cycle may move, in % of the command's range: commands that move
            more are slowed down; None to leave them as they are.

    Raises:
        ClientError: If a request is refused, or the stage goes another way than it was told to; the
            text begins with case and mode.
        DataError: If the experiment does not fit the stage, before anything moves, or a recording
            does not hold what was run.
        ModelError: If a model in use is none of a stage.
    """
    setup, slowed = read_setup(client), list[str]()
    if largest_step_pct is not None:
        config, slowed = slow_enough(config, setup.rate_hz, largest_step_pct)
    check_live(config, setup)
    meter = _Meter(config, progress)
    recordings: list[Recording] = []
    warnings = [*not_used(config, setup), *slowed]
    with (
        TemporaryDirectory(prefix="piezod-") as folder,
        LiveStage(client, setup, meter.advance) as stage,
    ):
        runs = _Runs(stage, setup, config, Path(folder) / "recording.h5")
        for case in config.cases:
            for mode in config.modes:
                meter.label = f"{case.name}, {mode.value}"
                with _naming(meter.label):
                    for recording, beware in runs.run(case, mode):
                        recordings.append(recording)
                        warnings += beware
        stage.park()
    return ExperimentResult(
        title=f"{title} (live on stage {setup.stage})",
        recordings=tuple(recordings),
        identifications=tuple(_models(config, setup)),
        configuration=_with_setup(configuration, setup),
        versions=versions(),
        seed=setup.seed,
        rate_hz=setup.rate_hz,
        warnings=tuple(warnings),
    )


class _Runs:
    """Runs cases, one after the other."""

    def __init__(
        self, stage: LiveStage, setup: LiveSetup, config: ExperimentConfig, file: Path
    ) -> None:
        self._stage, self._setup, self._config, self._file = stage, setup, config, file

    def run(self, case: CaseConfig, mode: Mode) -> list[tuple[Recording, list[str]]]:
        """Rest, run a case, and return what was recorded of each axis, and what to beware of."""
        stage, commands = self._stage, case.commands(self._config.axes)
        waveforms = {
            name: build_waveform(command, case.duration_s) for name, command in commands.items()
        }
        stage.park()
        stage.select(mode, commands)
        stage.rest(self._config.settle_s)
        stage.arm()
        stage.faults.clear()
        stage.start_recording(f"{case.name}-{mode.value}")
        stage.select(mode, commands)
        staying_um = stage.staying_um()
        longest_s = max(
            self._setup.axes[name].motion(each, case.duration_s, staying_um[name]).duration_s
            for name, each in waveforms.items()
        )
        stage.follow(commands, case.duration_s, mode, longest_s)
        told = stage.end_recording(self._file)
        run = LiveRun(case, mode, self._config.metrics)
        recordings = [
            cut(told, name, self._setup.axes[name], waveform, run)
            for name, waveform in waveforms.items()
        ]
        return [(recording, list(self._warnings(recording, told))) for recording in recordings]

    def _warnings(self, recording: Recording, told: RecordedTelemetry) -> Iterator[str]:
        yield from run_warnings(recording, merged_pairs=0)
        run = f"{recording.case}, {recording.mode}, axis {recording.axis}:"
        missing = missing_cycles(told)
        if missing:
            yield (
                f"{run} {missing} of {told.cycles['t_s'].size + missing} cycles are missing from "
                "the record: the loop skipped them, or they came too fast for the disk."
            )
        if self._stage.faults:
            faults = ", ".join(sorted(self._stage.faults))
            yield f"{run} faults were present: {faults}. `piezod faults` tells more."


class _Meter:
    """Turns seconds that are over into a share of the whole."""

    def __init__(self, config: ExperimentConfig, progress: Progress) -> None:
        each_s = config.settle_s + ZERO_S
        case_s = sum(each_s + case.duration_s for case in config.cases)
        self._whole_s, self._progress = len(config.modes) * case_s, progress
        self._over_s, self.label = 0.0, ""

    def advance(self, over_s: float) -> None:
        self._over_s += over_s
        self._progress(self.label, min(1.0, self._over_s / self._whole_s))


@contextmanager
def _naming(run: str) -> Iterator[None]:
    """Put case and mode before what an error says."""
    try:
        yield
    except ClientError as error:
        raise type(error)(f"{run}: {error.what}", error.remedy, error.code) from error
    except DataError as error:
        raise DataError(f"{run}: {error}") from error


def _models(config: ExperimentConfig, setup: LiveSetup) -> Iterator[Identification]:
    """Yield how the models came about that the stage had when the experiment began."""
    nothing = np.empty(0)
    for name in config.axes:
        axis = setup.axes[name]
        if axis.file is not None and axis.model is not None:
            yield Identification(
                axis=name,
                title=f"model in use on stage {setup.stage}",
                method=axis.file.method,
                t_s=nothing,
                drive_v=nothing,
                position_um=nothing,
                predicted_v=nothing,
                fit_errors=axis.file.fit.model_dump(),
                parameters=parameters_of(axis.model),
            )


def _with_setup(configuration: str, setup: LiveSetup) -> str:
    """Return the text of the file, and what the stage was like as a comment of it."""
    stage = json.dumps(setup.document, ensure_ascii=False)
    return f"{configuration}\n# Run on stage {setup.stage}, which was configured as:\n# {stage}\n"
