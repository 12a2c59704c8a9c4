"""Requests as bytes, for the mailbox.

`marshal` is acceptable here only: both ends are the same interpreter under the same user, no one
else can write to the mapped file, and JSON takes too long for the loop.
"""

import marshal
from array import array
from typing import Any, Final, get_args

import numpy as np

from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import pack_waveforms, unpack_waveforms
from piezod.messages.requests import (
    Goto,
    Identify,
    LineEdges,
    LinePulses,
    Play,
    Request,
    Scan,
    ScanCompared,
    ScanCurve,
    ScanEdges,
    Wave,
)

_CLASSES: Final = {
    each.model_fields["kind"].default: each for each in get_args(get_args(Request)[0])
}
"""Every request class, by its kind."""
_WAVEFORMS: Final = {"wave": "command_um", "identify": "drive_v"}
"""Requests with waveforms, and the field of the waveforms."""
_PLAY, _TABLES = "play", ("lead_in_v", "drive_v")
_WAVE, _SCAN = "wave", "scan"
"""Its curves are of single precision, 10 µV at 100 V: twice as many fit into the mailbox."""


def encode(request: Request) -> bytes:
    """Return a validated request as bytes; waveforms are built and packed here, for the loop.

    Raises:
        WaveformCostError: If waveforms are too large for the loop.
    """
    name = _WAVEFORMS.get(request.kind, "")
    fields = request.model_dump(exclude={name})
    if isinstance(request, Wave | Identify):
        fields[name] = pack_waveforms(getattr(request, name), request.duration_s)
    if isinstance(request, Play):
        for table in _TABLES:
            fields[table] = array("d", fields[table]).tobytes()
    if isinstance(request, Scan):
        fields["pulses"] = bytes(fields["pulses"])
        for curve in fields["axes"].values():
            curve |= {key: array("f", values).tobytes() for key, values in curve.items()}
    if "mode" in fields:
        fields["mode"] = fields["mode"].value  # marshal has no enumerations
    return marshal.dumps(fields)


def decode(payload: bytes) -> Request:
    """Return the request that `encode` wrote. Real-time safe after `warm_up`.

    It was validated before it was encoded.

    Raises:
        ValueError: If the bytes are no request.
    """
    try:
        fields = marshal.loads(payload)  # noqa: S302 - see above
        kind = fields["kind"]
        if name := _WAVEFORMS.get(kind):
            fields[name] = unpack_waveforms(fields[name])
        if kind == _WAVE:
            if pulses := fields["pulses"]:
                fields["pulses"] = tuple(LinePulses.model_construct(**each) for each in pulses)
            if edges := fields["edges"]:
                fields["edges"] = LineEdges.model_construct(**edges)
        if kind == _PLAY:
            fields |= {table: _doubles(fields[table]) for table in _TABLES}
        if kind == _SCAN:
            fields["pulses"] = tuple(fields["pulses"])
            for name, curve in fields["axes"].items():
                arrays: dict[str, Any] = {
                    key: np.frombuffer(values, "f4") for key, values in curve.items()
                }
                fields["axes"][name] = ScanCurve.model_construct(**arrays)
            if edges := fields["edges"]:
                fields["edges"] = ScanEdges.model_construct(**edges)
            if compared := fields["compared"]:
                fields["compared"] = ScanCompared.model_construct(**compared)
        if "mode" in fields:
            fields["mode"] = Mode(fields["mode"])
        if "model" in fields:
            fields["model"] = ModelFile.model_validate(fields["model"])
        request: Request = _CLASSES[kind].model_construct(**fields)
    except (AttributeError, EOFError, KeyError, TypeError) as error:
        raise ValueError(f"no request: {error}") from error
    return request


def _doubles(packed: bytes) -> tuple[float, ...]:
    values = array("d")
    values.frombytes(packed)
    return tuple(values)


def warm_up() -> None:
    """Encode and decode once, so that the first request finds everything loaded."""
    decode(encode(Goto(position_um=0.0)))
