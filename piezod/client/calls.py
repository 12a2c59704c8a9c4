"""The daemon's interface as a table: what each call asks for, and how its answer is read.

Nothing here talks to anybody; `StageClient` and `AsyncStageClient` both carry out these calls.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeAlias, TypeVar

from pydantic import BaseModel, ValidationError

from piezod.client.results import (
    Answer,
    Document,
    Faults,
    Health,
    History,
    Parameters,
    Recording,
    Recordings,
    Result,
    Saved,
    Status,
    StreamEnd,
    reader,
)
from piezod.client.waveforms import sendable, tupled
from piezod.config import requests
from piezod.config.combined_waveforms import WaveformConfig
from piezod.config.messages import describe
from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.errors import RefusedError

ResultT = TypeVar("ResultT")
Waveforms: TypeAlias = Mapping[str, WaveformConfig | Mapping[str, Any]]
"""Waveforms by axis, as models or as a file would have them."""
_answer, _status, _faults = reader(Answer), reader(Status), reader(Faults)
_parameters, _saved, _history = reader(Parameters), reader(Saved), reader(History)
_recording, _recordings = reader(Recording), reader(Recordings)


stream_end = reader(StreamEnd)


def _as_it_is(document: Document) -> Document:
    return document


@dataclass(frozen=True)
class Call(Generic[ResultT]):
    """One question to a daemon.

    Attributes:
        method: Of HTTP.
        path: Below `/v1/`.
        read: Makes the result of the answer's document.
        body: Document to send, None for none.
        also_fine: A status of HTTP that else is an error.
    """

    method: str
    path: str
    read: Callable[[Document], ResultT]
    body: Document | None = None
    also_fine: int = 200


def status() -> Call[Status]:
    """Return state, mode, faults, and each axis in its newest cycle."""
    return Call("GET", "status", _status)


def faults() -> Call[Faults]:
    """Return what is present or latched, and what to do about it."""
    return Call("GET", "faults", _faults)


def health() -> Call[Health]:
    """Return whether the loop runs on schedule, and what tells so."""
    return Call("GET", "health", reader(Health), also_fine=503)


def realtime() -> Call[Document]:
    """Return what the loop asked of the operating system, and what it obtained."""
    return Call("GET", "realtime", _as_it_is)


def config() -> Call[Document]:
    """Return the configuration in force."""
    return Call("GET", "config", _as_it_is)


def audit() -> Call[Document]:
    """Return who asked for what, newest first."""
    return Call("GET", "audit", _as_it_is)


def arm(*, shadow: bool = False, confirm_output: bool = False) -> Call[Answer]:
    """Take over the voltage that is read back, and hold it: SAFE to READY.

    Args:
        shadow: Compute everything, write nothing.
        confirm_output: You have seen that the output is at the safe voltage; for amplifiers that do
            not read back.
    """
    return _request("arm", requests.Arm, shadow=shadow, confirm_output=confirm_output)


def disarm() -> Call[Answer]:
    """Ramp to the safe voltage, then SAFE."""
    return _request("disarm", requests.Disarm)


def mode(name: Mode | str, *, axis: str | None = None) -> Call[Answer]:
    """Choose how the drive is made from the command; from READY on this starts RUN.

    Args:
        name: One of `piezod.config.modes.Mode`.
        axis: Left out: all axes.
    """
    return _request("mode", requests.SelectMode, mode=name, axis=axis)


def goto(
    position_um: float, *, axis: str | None = None, speed_um_per_s: float | None = None
) -> Call[Answer]:
    """Set off to a position, and stay there; from READY on this starts RUN.

    Args:
        position_um: Where to, in µm.
        axis: Left out: the only one.
        speed_um_per_s: How fast, in µm/s; left out: as the configuration says.
    """
    return _request(
        "goto",
        requests.Goto,
        position_um=position_um,
        axis=axis,
        speed_um_per_s=speed_um_per_s,
    )


def wave(command_um: Waveforms, duration_s: float) -> Call[Answer]:
    """Follow a waveform from where the stage is; its last value is held at the end.

    Args:
        command_um: Axis: position over time in µm, a waveform as experiments have them.
        duration_s: How long, in s.
    """
    return _request("wave", requests.Wave, command_um=tupled(command_um), duration_s=duration_s)


def follow(*, axis: str | None = None) -> Call[Answer]:
    """Follow what the command input of an axis tells; HOLD as soon as that is nothing usable.

    Args:
        axis: Left out: all axes that have one.
    """
    return _request("follow", requests.Follow, axis=axis)


def hold() -> Call[Answer]:
    """Hold the voltage that is in force."""
    return _request("hold", requests.Hold)


def resume() -> Call[Answer]:
    """Go on after a hold, from where the stage is: HOLD to RUN."""
    return _request("resume", requests.Resume)


def condition(*, axis: str | None = None) -> Call[Answer]:
    """Drive a decaying swing, so that the hysteresis' memory is known.

    Args:
        axis: Left out: all axes.
    """
    return _request("condition", requests.Condition, axis=axis)


def zero(*, axis: str | None = None) -> Call[Answer]:
    """Call the displacement at the rest voltage zero.

    Args:
        axis: Left out: all axes.
    """
    return _request("zero", requests.Zero, axis=axis)


def stop() -> Call[Answer]:
    """Ramp to the safe voltage, then SAFE; whoever has the lease."""
    return _request("stop", requests.Stop)


def estop() -> Call[Answer]:
    """Stop in an emergency, as the configuration says; whoever has the lease."""
    return _request("estop", requests.Estop)


def reset(*, engineer: bool = False) -> Call[Answer]:
    """Leave FAULT for SAFE, where no fault is present any more.

    Args:
        engineer: Reset also what only an engineer may.
    """
    return _request("reset", requests.Reset, engineer=engineer)


def identify(drive_v: Waveforms, duration_s: float) -> Call[Answer]:
    """Drive voltages from rest, for a record to fit a model to; ends at the rest voltage.

    Args:
        drive_v: Axis: drive over time in V, a waveform as experiments have them; others rest.
        duration_s: How long, in s.
    """
    return _request("identify", requests.Identify, drive_v=tupled(drive_v), duration_s=duration_s)


def adopt(
    model: ModelFile, *, axis: str | None = None, zero_um: float | None = None
) -> Call[Answer]:
    """Use another model from now on; only while disarmed.

    Args:
        model: The model, as `piezod.config.model_file.load_model` reads it.
        axis: Left out: the only one.
        zero_um: Sensor zero to restore, in µm.
    """
    return _request("model", requests.AdoptModel, model=model, axis=axis, zero_um=zero_um)


def shutdown() -> Call[Answer]:
    """Ramp to the safe voltage and end the daemon."""
    return _request("shutdown", requests.Shutdown)


def reload() -> Call[Result]:
    """Have the daemon read its configuration again; one that is not valid changes nothing."""
    return Call("POST", "reload", reader(Result), {})


def params() -> Call[Parameters]:
    """Return the parameters in use."""
    return Call("GET", "params", _parameters)


def params_history() -> Call[History]:
    """Return what is saved, newest first."""
    return Call("GET", "params/history", _history)


def save_params() -> Call[Saved]:
    """Save the parameters in use; a start of the daemon begins with them."""
    return Call("POST", "params/save", _saved, {})


def load_params() -> Call[Saved]:
    """Use the parameters that were saved last; only while disarmed."""
    return Call("POST", "params/load", _saved, {})


def restore_params(sequence: int) -> Call[Saved]:
    """Use parameters that were saved earlier; only while disarmed.

    Args:
        sequence: Their number, as the history has it.
    """
    return Call("POST", "params/restore", _saved, {"sequence": sequence})


def start_recording(label: str | None = None) -> Call[Recording]:
    """Start recording every cycle.

    Args:
        label: Becomes part of the name, which the daemon makes.
    """
    return Call("POST", "recordings/start", _recording, {"label": label} if label else {})


def stop_recording() -> Call[Recording]:
    """End the recording and close its file."""
    return Call("POST", "recordings/stop", _recording, {})


def recordings() -> Call[Recordings]:
    """Return what is recorded."""
    return Call("GET", "recordings", _recordings)


def renew_lease() -> Call[Document]:
    """Keep the right to move the stage for 30 s more; every command does that, too."""
    return Call("POST", "lease", _as_it_is, {})


def release_lease() -> Call[Document]:
    """Give the right to move the stage back, so that others need not wait for its end."""
    return Call("DELETE", "lease", _as_it_is)


def _request(path: str, request: type[BaseModel], /, **fields: object) -> Call[Answer]:
    """Return the call of a request whose values have been checked here already."""
    try:
        body = request(**{key: value for key, value in fields.items() if value is not None})
        document = {name: sendable(value) for name, value in body if value is not None}
    except ValidationError as error:
        raise _refused(error) from error
    del document["kind"]
    return Call("POST", path, _answer, document)


def _refused(error: ValidationError) -> RefusedError:
    problems = (
        f"{'.'.join(map(str, each['loc']))}: {describe(each, ())}" for each in error.errors()
    )
    return RefusedError("; ".join(problems), code="value")
