"""Bodies of requests, checked by the request classes; slow to import because of pydantic."""

from collections.abc import Mapping

from pydantic import BaseModel, ValidationError

from piezod.config.messages import describe
from piezod.config.waveforms.waveform import WaveformModel
from piezod.errors import RefusedError
from piezod.messages.documents import Document
from piezod.messages.endpoints import Endpoint
from piezod.messages.requests import REQUESTS, TABLE


def tupled(value: object) -> object:
    """Return plain data with tuples in place of lists, which strict validation requires."""
    if isinstance(value, Mapping):
        return {key: tupled(each) for key, each in value.items()}
    return tuple(map(tupled, value)) if isinstance(value, list | tuple) else value


def sendable(value: object) -> object:
    """Return a request or a part of it as plain data; a file becomes its points.

    Args:
        value: Models, mappings, tuples and plain values, nested at any depth.

    Raises:
        ValidationError: If a file has more points than may be sent.
    """
    if isinstance(value, WaveformModel):
        value = value.sendable()
    if isinstance(value, BaseModel):
        fields = {name: getattr(value, name) for name in type(value).model_fields}
        return sendable({name: each for name, each in fields.items() if each is not None})
    if isinstance(value, Mapping):
        return {key: sendable(each) for key, each in value.items()}
    return tuple(map(sendable, value)) if isinstance(value, tuple) else value


def checked(name: str, fields: Mapping[str, object]) -> tuple[Endpoint, Document]:
    """Return the row of a request in the table of commands, and its body.

    Args:
        name: Name of the request.
        fields: Fields of the request class; None for those that are left out.

    Raises:
        RefusedError: If the request class does not accept the fields; the code is "value".
    """
    given = {key: tupled(value) for key, value in fields.items() if value is not None}
    try:
        request = REQUESTS[name](**given)
        body = {key: sendable(value) for key, value in request if value is not None}
    except ValidationError as error:
        raise _refused(error) from error
    del body["kind"]
    return TABLE[name], body


def _refused(error: ValidationError) -> RefusedError:
    problems = (
        f"{'.'.join(map(str, each['loc']))}: {describe(each, ())}" for each in error.errors()
    )
    return RefusedError("; ".join(problems), code="value")
