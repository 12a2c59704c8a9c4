"""Records a running stage for an identification: drives it, and writes a data file."""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from piezod.client import StageClient
from piezod.config.axes import AxisConfig
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.model_file import ModelFile
from piezod.config.states import State
from piezod.errors import DataError
from piezod.experiment.fit.recorded import Placing, check_missing, on_deadlines, told_missing
from piezod.experiment.live.drive import LiveDrive, designed_drive, from_rest
from piezod.experiment.live.setup import read_setup
from piezod.experiment.live.stage import ZERO_S, LiveStage
from piezod.experiment.progress import Meter, Progress
from piezod.hysteresis.memory import FloatArray
from piezod.records.csv_file import write_csv
from piezod.records.recording.reader import RecordedTelemetry


class LiveRecord(NamedTuple):
    """A recorded data file."""

    axis: str  #: Name of the axis.
    file: Path  #: The data file.
    run_in_s: float  #: Its first part, which does not count, in s.
    warnings: tuple[str, ...]  #: Warnings, a sentence each.
    config: AxisConfig  #: Configuration of the axis.

    @property
    def takes_surface(self) -> bool:
        """Whether the identifier of the axis learns a surface, so that it accepts one."""
        return self.config.compensator.identifier == "rls"


def record_live(
    client: StageClient,
    file: Path,
    progress: Progress,
    *,
    axis: str | None,
    settings: IdentificationConfig | None,
) -> LiveRecord:
    """Drive an axis of a running stage from rest, and write a data file of its motion.

    The stage is disarmed at the end in any case.

    Args:
        client: A connection to the daemon of the stage.
        file: The data file, with the columns t_s, drive_v, position_um.
        progress: Called as the drive advances.
        axis: Name of the axis; None for the only one.
        settings: The drive; None for one that is designed for the voltages of the axis.

    Raises:
        ClientError: If a request is refused, or the stage leaves the expected states.
        DataError: If there is no such axis, or too much of the record is missing.
        LatenessError: If the loop was late, also in all repetitions.
        OSError: If the file cannot be written.
    """
    setup = read_setup(client)
    name = setup.measured_axis(axis, "an identification")
    live = setup.axes[name]
    drive = from_rest(settings or designed_drive(live), live)
    total_s = drive.settle_s + ZERO_S + drive.duration_s
    meter = Meter(progress, total_s, f"driving axis {name}")
    with LiveStage(client, setup, meter.advance) as stage:
        measure = partial(_driven, stage, name, drive)
        columns, warnings = stage.until_punctual(measure, stage.disarm)
        stage.disarm()
    write_csv(file, columns)
    warnings = (*stage.notes, *warnings, *stage.fault_notes())
    return LiveRecord(name, file, drive.run_in_s, warnings, live.config)


def adopt_live(client: StageClient, axis: str, model: ModelFile) -> None:
    """Make a running stage use a model; the stage is disarmed for that.

    Raises:
        ClientError: If the daemon refuses the model.
        ModelError: If the present model of the stage is not valid.
    """
    with LiveStage(client, read_setup(client), lambda _over_s: None) as stage:
        stage.disarm()
        client.adopt(model, axis=axis)


def columns_of(
    telemetry: RecordedTelemetry, axis: str, placed: Placing = on_deadlines
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return the record of the drive, evenly in time, and its warnings.

    Skipped cycles and invalid samples are filled in if they are few.

    Raises:
        DataError: If too many samples are missing.
    """
    driven = telemetry.cycles["state"] == telemetry.header.names["state"].index(State.IDENT)
    if np.count_nonzero(driven) < 2:
        raise DataError(f"axis {axis}: the recording does not contain the drive")
    columns, missing = placed(telemetry, axis, driven)
    samples = columns["t_s"].size
    check_missing(f"axis {axis}", missing, samples - int(driven.sum()), samples)
    return columns, told_missing(missing, samples)


def _driven(
    stage: LiveStage, axis: str, drive: LiveDrive
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    stage.arm_at_rest(drive.settle_s)
    stage.faults.clear()
    stage.recorder.start(f"identify-{axis}")
    stage.drive({axis: drive.drive_v}, drive.duration_s)
    return columns_of(stage.recorder.end(), axis)
