"""A record to fit a model to, of a running stage: driven, recorded, and written as a data file."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

import numpy as np

from piezod.client import StageClient
from piezod.config.experiment_fields import IdentificationConfig
from piezod.config.model_file import ModelFile
from piezod.config.states import State
from piezod.errors import DataError
from piezod.experiment.live.drive import LiveDrive, designed_drive, from_rest
from piezod.experiment.live.setup import LiveSetup, read_setup
from piezod.experiment.live.stage import ZERO_S, LiveStage
from piezod.experiment.virtual.run import Progress
from piezod.hysteresis.memory import FloatArray
from piezod.records.csv_file import write_csv
from piezod.records.telemetry_reader import RecordedTelemetry

MOST_MISSING: Final = 0.02
"""So large a part of the samples may be filled in."""


class LiveRecord(NamedTuple):
    """What was recorded.

    Attributes:
        axis: Name of the axis.
        file: The data file.
        run_in_s: Its first part, which does not count, in s.
        warnings: What to know of it, a sentence each.
    """

    axis: str
    file: Path
    run_in_s: float
    warnings: tuple[str, ...]


def record_live(
    client: StageClient,
    file: Path,
    progress: Progress,
    *,
    axis: str | None,
    settings: IdentificationConfig | None,
) -> LiveRecord:
    """Drive an axis of a running stage from rest, and write what it did as a data file.

    The stage is disarmed at the end, whatever comes.

    Args:
        client: A connection to the stage's daemon.
        file: The data file, with the columns t_s, drive_v, position_um.
        progress: Told as it goes on.
        axis: Name of the axis; None for the only one.
        settings: The drive; None for one that is designed for the voltages of the axis.

    Raises:
        ClientError: If a request is refused, or the stage goes another way than it was told to.
        DataError: If there is no such axis, or too much of the record is missing.
        OSError: If the file cannot be written.
    """
    setup = read_setup(client)
    name = _chosen(setup, axis)
    live = setup.axes[name]
    drive = from_rest(settings or designed_drive(live), live)
    whole_s, over_s = drive.settle_s + ZERO_S + drive.duration_s, 0.0

    def advance(further_s: float) -> None:
        nonlocal over_s
        over_s += further_s
        progress(f"driving axis {name}", min(1.0, over_s / whole_s))

    with (
        TemporaryDirectory(prefix="piezod-") as folder,
        LiveStage(client, setup, advance) as stage,
    ):
        told = _driven(stage, name, drive, Path(folder) / "recording.h5")
        stage.park()
    columns, warnings = columns_of(told, name)
    write_csv(file, columns)
    if stage.faults:
        faults = ", ".join(sorted(stage.faults))
        warnings = (*warnings, f"Faults were present: {faults}. `piezod faults` tells more.")
    return LiveRecord(name, file, drive.run_in_s, warnings)


def adopt_live(client: StageClient, axis: str, model: ModelFile) -> None:
    """Have a running stage use a model from now on; it is disarmed for that.

    Raises:
        ClientError: If the daemon does not take it.
        ModelError: If the model that it had is none of a stage.
    """
    with LiveStage(client, read_setup(client), lambda _over_s: None) as stage:
        stage.park()
        client.adopt(model, axis=axis)


def columns_of(told: RecordedTelemetry, axis: str) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return what was recorded while the stage was driven, evenly in time, and what to know of it.

    Cycles that were skipped and samples that were invalid are filled in, as long as they are few.

    Args:
        told: The recording.
        axis: Name of the axis.

    Raises:
        DataError: If they are too many.
    """
    driven = told.cycles["state"] == told.header.names["state"].index(State.IDENT)
    if np.count_nonzero(driven) < 2:
        raise DataError(f"axis {axis}: the recording has nothing of the drive")
    t_s = told.cycles["t_s"][driven]
    due_s = t_s - 1e-9 * told.cycles["late_ns"][driven]
    places = np.rint((due_s - due_s[0]) * told.header.rate_hz)
    even_s = np.arange(places[-1] + 1) / told.header.rate_hz
    position_um = told.axes[axis]["position_um"][driven]
    valid = np.isfinite(position_um)
    missing = even_s.size - np.count_nonzero(valid)
    if missing > MOST_MISSING * even_s.size:
        raise DataError(
            f"axis {axis}: {missing} of {even_s.size} samples are missing, because the loop "
            f"skipped cycles or the sensor was out of range; allowed are {100 * MOST_MISSING:g} %"
        )
    since_s = t_s - due_s[0]
    columns = {
        "t_s": even_s,
        "drive_v": np.interp(even_s, since_s, told.axes[axis]["in_force_v"][driven]),
        "position_um": np.interp(even_s, since_s[valid], position_um[valid]),
    }
    if not missing:
        return columns, ()
    return columns, (
        f"{missing} of {even_s.size} samples were missing, skipped by the loop or invalid, and are "
        "filled in.",
    )


def _driven(stage: LiveStage, axis: str, drive: LiveDrive, file: Path) -> RecordedTelemetry:
    stage.park()
    stage.rest(drive.settle_s)
    stage.arm()
    stage.faults.clear()
    stage.start_recording(f"identify-{axis}")
    stage.drive({axis: drive.drive_v}, drive.duration_s)
    return stage.end_recording(file)


def _chosen(setup: LiveSetup, axis: str | None) -> str:
    names = ", ".join(setup.axes)
    if axis is None and len(setup.axes) > 1:
        raise DataError(f"stage {setup.stage} has several axes, {names}: name one with --axis")
    if axis is not None and axis not in setup.axes:
        raise DataError(f"stage {setup.stage} has no axis {axis}; its axes are {names}")
    return axis or names
