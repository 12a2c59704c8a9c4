"""Requests as bytes, for the mailbox.

`marshal` is right here and nowhere else: both ends are the same interpreter under the same user,
nobody else can write to the mapped file, and the loop has no time for JSON.
"""

import marshal
from typing import Any, Final

from pydantic import TypeAdapter

from piezod.config.requests import Goto, Request, SelectMode
from piezod.config.waveforms import Points, Staircase

_ADAPTER: Final[TypeAdapter[Any]] = TypeAdapter(Request)
_LONG: Final[dict[str, type[Points] | type[Staircase]]] = {"points": Points, "staircase": Staircase}


def encode(request: Request) -> bytes:
    """Write a request; it has been validated."""
    fields = request.model_dump()
    if isinstance(request, SelectMode):
        fields["mode"] = request.mode.value  # marshal knows no enumerations
    return marshal.dumps(fields)


def decode(payload: bytes) -> Request:
    """Read what `encode` wrote; may be called in the loop, after `warm_up`.

    It is validated once more, but for long paths: that would take 5 ms for 10 000 points.

    Raises:
        ValueError: If it is no request.
    """
    try:
        fields = marshal.loads(payload)  # noqa: S302 - see above
        for name in ("command_um", "drive_v"):
            waveforms = fields.get(name, {})
            for axis, waveform in waveforms.items():
                if long := _LONG.get(waveform["kind"]):
                    waveforms[axis] = long.model_construct(**waveform)
        request: Request = _ADAPTER.validate_python(fields)
    except (AttributeError, EOFError, KeyError, TypeError) as error:
        raise ValueError(f"no request: {error}") from error
    return request


def warm_up() -> None:
    """Go the whole way once, so that the first request finds everything in place."""
    decode(encode(Goto(position_um=0.0)))
