"""Requests as bytes, for the mailbox.

`marshal` is acceptable here only: both ends are the same interpreter under the same user, no one
else can write to the mapped file, and JSON takes too long for the loop.
"""

import marshal
from array import array
from typing import Any, Final

from pydantic import TypeAdapter

from piezod.config.packed_waveforms import pack_waveforms, unpack_waveforms
from piezod.messages.requests import Goto, Identify, Play, Request, SelectMode, Wave

_ADAPTER: Final[TypeAdapter[Any]] = TypeAdapter(Request)
_WITH_WAVEFORMS: Final[dict[str, tuple[type[Wave] | type[Identify], str]]] = {
    "wave": (Wave, "command_um"),
    "identify": (Identify, "drive_v"),
}
"""Requests with waveforms, and the field of the waveforms."""
_PLAY, _TABLES = "play", ("lead_in_v", "drive_v")


def encode(request: Request) -> bytes:
    """Return a validated request as bytes; waveforms are built and packed here, for the loop.

    Raises:
        WaveformCostError: If waveforms are too large for the loop.
    """
    if isinstance(request, Wave | Identify):
        _, name = _WITH_WAVEFORMS[request.kind]
        fields = request.model_dump(exclude={name})
        fields[name] = pack_waveforms(getattr(request, name), request.duration_s)
        return marshal.dumps(fields)
    fields = request.model_dump()
    if isinstance(request, Play):
        for name in _TABLES:
            fields[name] = array("d", fields[name]).tobytes()
    if isinstance(request, SelectMode):
        fields["mode"] = request.mode.value  # marshal has no enumerations
    return marshal.dumps(fields)


def decode(payload: bytes) -> Request:
    """Return the request that `encode` wrote. Real-time safe after `warm_up`.

    The request is validated once more, except one with waveforms or a table: that takes too long.

    Raises:
        ValueError: If the bytes are no request.
    """
    try:
        fields = marshal.loads(payload)  # noqa: S302 - see above
        if found := _WITH_WAVEFORMS.get(fields["kind"]):
            request_class, name = found
            fields[name] = unpack_waveforms(fields[name])
            return request_class.model_construct(**fields)
        if fields["kind"] == _PLAY:
            tables = {name: _doubles(fields[name]) for name in _TABLES}
            return Play.model_construct(**(fields | tables))
        request: Request = _ADAPTER.validate_python(fields)
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
