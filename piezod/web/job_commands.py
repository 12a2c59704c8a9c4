"""What a page may let run for minutes, and the command line of each."""

import json
import os
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from piezod.home import user_folder
from piezod.messages.documents import Document
from piezod.own_folder import make_folder


class MessagePart(BaseModel):
    """A part of a message; it has no unknown key."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class PageMessage(MessagePart):
    """A message: it has a number for the answer."""

    id: Annotated[int, Field(ge=0, lt=2**53)]


MODEL: Final = "model.yaml"
RECORDING: Final = r"[A-Za-z0-9][A-Za-z0-9_-]{0,199}"
"""Names of recordings: neither a path nor an option of a command."""
PRESENT_MODEL: Final = "present-model.yaml"
_REPLAY: Final = "replay.png"
_SLOWEST_HZ, _SWINGS = 0.7, 8
"""Frequency of the swings of a chosen drive, and their least number."""


class ChosenDrive(MessagePart):
    """A drive for identification: swings that decay from a range of voltages to nothing."""

    low_v: float
    high_v: float
    duration_s: Annotated[float, Field(ge=5.0, le=600.0)]


class FileChoices(MessagePart):
    """How the columns of the file that the page has sent are read, as the options of commands."""

    columns: Annotated[str, Field(max_length=500)] = ""
    scale: Annotated[str, Field(max_length=100)] = ""
    offset: Annotated[str, Field(max_length=100)] = ""
    invert: Annotated[str, Field(max_length=100)] = ""
    rate_hz: Annotated[float, Field(gt=0.0, le=1e9)] | None = None


class IdentifyJob(PageMessage):
    """Identify an axis. Without a drive, one of 80 s over all voltages of the axis is used.

    With a file the stage is not driven.
    """

    do: Literal["identify"]
    stage: str
    axis: Annotated[str, Field(max_length=100, pattern=r"^[^-]")]
    method: Literal["auto", "surface", "least-squares", "lms"] = "auto"
    drive: ChosenDrive | None = None
    file: FileChoices | None = None


class ImportJob(PageMessage):
    """Show how the file that the page has sent is read."""

    do: Literal["import"]
    stage: str
    axis: Annotated[str, Field(max_length=100, pattern=r"^[^-]")]
    file: FileChoices


class LearnJob(PageMessage):
    """Play a waveform on a device, and learn its table from pass to pass."""

    do: Literal["learn"]
    stage: str
    axis: Annotated[str, Field(max_length=100, pattern=r"^[^-]")]
    command_um: dict[str, Any]
    passes: Annotated[int, Field(ge=0, le=50)] = 6
    interval_us: Annotated[float, Field(ge=0.1, le=1e6)] = 50.0
    settle_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0
    record_s: Annotated[float, Field(ge=0.0, le=60.0)] = 1.0


class ScanJob(PageMessage):
    """Scan lines, a raster or a stack, and store the picture."""

    do: Literal["scan"]
    stage: str
    axis: Annotated[str, Field(max_length=100, pattern=r"^[^-]")]
    scan: dict[str, Any]


class ReplayJob(PageMessage):
    """Run the control law again on a recording, with the present model of its axis."""

    do: Literal["replay"]
    stage: str
    axis: Annotated[str, Field(max_length=100, pattern=r"^[^-]")]
    recording: Annotated[str, Field(pattern=f"^{RECORDING}$")]


class LookAtJob(PageMessage):
    """Return the newest job of a stage, or end it."""

    do: Literal["job", "end_job"]
    stage: str


JobMessage: TypeAlias = IdentifyJob | ImportJob | LearnJob | ScanJob | ReplayJob


def of_file(wanted: JobMessage) -> FileChoices | None:
    """Return how a sent file is read; None if the job has none, but uses the stage."""
    return wanted.file if isinstance(wanted, IdentifyJob | ImportJob) else None


def command_of(
    wanted: JobMessage, model: Document | None, upload: Path | None = None
) -> Callable[[Path], list[str]]:
    """Return a function that writes the files of a command into a folder; it returns the arguments.

    Args:
        wanted: What to do.
        model: The present model of the axis, for a replay.
        upload: The file that the page has sent, for a job that reads it.
    """
    if upload is not None and (choices := of_file(wanted)):
        return partial(file_command, wanted, choices, upload)
    match wanted:
        case IdentifyJob():
            return partial(identify_command, wanted)
        case LearnJob():
            return partial(learn_command, wanted)
        case ScanJob():
            return partial(scan_command, wanted)
        case ReplayJob():
            return partial(replay_command, wanted, model)
        case ImportJob():
            raise ValueError("an import reads a file")


def identify_command(wanted: IdentifyJob, folder: Path) -> list[str]:
    """Return the arguments of `piezod`; write the file of the drive."""
    arguments = ["identify", "--live", "--axis", wanted.axis, "--method", wanted.method]
    arguments += ["--out", str(folder / MODEL)]
    if wanted.drive is not None:
        file = folder / "drive.yaml"
        file.write_text(json.dumps({"identification": _drive(wanted.drive)}))
        arguments += ["--drive", str(file)]
    return arguments


def file_command(wanted: JobMessage, choices: FileChoices, upload: Path, folder: Path) -> list[str]:
    """Return the arguments of `piezod` that read a sent file; link it into the folder.

    Args:
        wanted: What to do.
        choices: How its columns are read.
        upload: The file.
        folder: Folder of the command, in which messages name the file without a path.
    """
    (folder / upload.name).symlink_to(upload)
    arguments = ["import", upload.name, "--out", "record.csv"]
    if isinstance(wanted, IdentifyJob):
        arguments = ["identify", upload.name, "--method", wanted.method, "--out", MODEL]
    # With "=" a value that begins with a dash is no option.
    given = choices.model_dump(exclude_defaults=True)
    return [*arguments, *(f"--{key.replace('_', '-')}={value}" for key, value in given.items())]


def learn_command(wanted: LearnJob, folder: Path) -> list[str]:
    """Return the arguments of `piezod`; write the file of the waveform."""
    file = folder / "wave.yaml"
    file.write_text(json.dumps({"command_um": wanted.command_um}))
    tables = tables_folder(wanted.stage)
    make_folder(tables)
    return [
        "play", str(file), "--axis", wanted.axis, "--learn", str(wanted.passes),
        "--interval-us", f"{wanted.interval_us:.10g}", "--settle-s", f"{wanted.settle_s:.10g}",
        "--record-s", f"{wanted.record_s:.10g}", "--tables", str(tables),
    ]  # fmt: skip


def scan_command(wanted: ScanJob, folder: Path) -> list[str]:
    """Return the arguments of `piezod`; write the file of the scan.

    The picture goes to a folder that lasts; a number is added to its name.
    """
    file, scans = folder / "scan.yaml", kept_folder("scans", wanted.stage)
    file.write_text(json.dumps({"scan": wanted.scan}))
    make_folder(scans)
    return ["scan", str(file), "--live", "--out", str(scans / "scan.nxs")]


def replay_command(wanted: ReplayJob, model: Document | None, folder: Path) -> list[str]:
    """Return the arguments of `piezod`; write the file of the model.

    Args:
        wanted: What to do.
        model: The present model of the axis; None for that of the recording.
        folder: Folder of its files, in which the command runs.
    """
    arguments = ["replay", wanted.recording, "--axis", wanted.axis, "--out", _REPLAY]
    if model is not None:
        (folder / PRESENT_MODEL).write_text(json.dumps(model))
        arguments += ["--model", PRESENT_MODEL]
    return arguments


def tables_folder(stage: str, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of the tables that this user, or this service, has learned for a stage."""
    return kept_folder("tables", stage, environ)


def kept_folder(kind: str, stage: str, environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of what this user, or this service, keeps of a kind for a stage."""
    if folder := environ.get("STATE_DIRECTORY"):
        return Path(folder) / kind / stage
    return user_folder("XDG_STATE_HOME", environ) / "piezod-web" / kind / stage


def _drive(drive: ChosenDrive) -> dict[str, Any]:
    frequency_hz = max(_SLOWEST_HZ, _SWINGS / drive.duration_s)
    period_s = 1.0 / frequency_hz
    sine = {
        "kind": "sine",
        "low": drive.low_v,
        "high": drive.high_v,
        "frequency_hz": frequency_hz,
    }
    decay = {"kind": "decaying", "time_constant_s": drive.duration_s / 3.0}
    return {
        "method": "least-squares",  # required by the file; the option of the command holds
        "settle_s": 2.0,
        "run_in_s": period_s,
        "duration_s": 2.0 * period_s + drive.duration_s,
        "drive_v": {
            "kind": "sequence",
            "parts": [
                # The run-in is excluded from the fit, so the largest swing comes twice.
                {"duration_s": 2.0 * period_s, "waveform": sine},
                {"duration_s": drive.duration_s, "waveform": {**sine, "envelope": decay}},
            ],
        },
    }
