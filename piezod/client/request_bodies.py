"""Bodies of requests, checked by the request classes; slow to import because of pydantic."""

from collections.abc import Mapping

from pydantic import ValidationError

from piezod.client.waveforms import sendable, tupled
from piezod.config.messages import describe
from piezod.errors import RefusedError
from piezod.messages.documents import Document
from piezod.messages.endpoints import Endpoint
from piezod.messages.requests import REQUESTS, TABLE


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
