"""What a client sends to a daemon and how it reads the answer; nothing here opens a connection."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from piezod.client.results import Answer, Document, reader
from piezod.config.endpoints import Endpoint
from piezod.errors import RefusedError

if TYPE_CHECKING:
    from pydantic import ValidationError

    from piezod.config.combined_waveforms import WaveformConfig

ResultT = TypeVar("ResultT")
Waveforms: TypeAlias = "Mapping[str, WaveformConfig | Mapping[str, Any]]"
"""Waveforms by axis: models, or mappings with the keys of a file."""


@dataclass(frozen=True)
class Call(Generic[ResultT]):
    """One HTTP request to a daemon, and how to read its answer.

    Attributes:
        endpoint: Row of the table of commands.
        read: Makes the result from the document of the answer.
        body: Document to send; None for none.
        also_fine: HTTP status that is no error for this call.
    """

    endpoint: Endpoint
    read: Callable[[Document], ResultT]
    body: Document | None = None
    also_fine: int = 200

    @property
    def method(self) -> str:
        """HTTP method."""
        return self.endpoint.method

    @property
    def path(self) -> str:
        """Path below `/v1/`."""
        return self.endpoint.path


def command(name: str, /, **fields: object) -> Call[Answer]:
    """Return the call of a request, its fields checked by the request class.

    Args:
        name: Name of the request in the table of commands.
        fields: Fields of the request class; None for those that are left out. Lists and mappings
            may take the place of tuples and models.

    Raises:
        RefusedError: If the request class does not accept the fields; the code is "value".
    """
    # Pydantic and the models take 0.6 s to import, which a program pays with its first command.
    from pydantic import ValidationError

    from piezod.client.waveforms import sendable, tupled
    from piezod.config.requests import REQUESTS, TABLE

    given = {key: tupled(value) for key, value in fields.items() if value is not None}
    try:
        request = REQUESTS[name](**given)
        body = {key: sendable(value) for key, value in request if value is not None}
    except ValidationError as error:
        raise _refused(error) from error
    del body["kind"]
    return Call(TABLE[name], reader(Answer), body)


def _refused(error: "ValidationError") -> RefusedError:
    from piezod.config.messages import describe

    problems = (
        f"{'.'.join(map(str, each['loc']))}: {describe(each, ())}" for each in error.errors()
    )
    return RefusedError("; ".join(problems), code="value")
