"""What a client sends to a daemon and how it reads the answer; nothing here opens a connection."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Generic, TypeAlias, TypeVar

from piezod.client.reader import reader
from piezod.messages.answers import Answer, Document
from piezod.messages.endpoints import Endpoint

if TYPE_CHECKING:
    from piezod.config.combined_waveforms import WaveformConfig

ResultT = TypeVar("ResultT")
Waveforms: TypeAlias = "Mapping[str, WaveformConfig | Mapping[str, Any]]"
"""Waveforms by axis: models, or mappings with the keys of a file."""


ANSWER_WITHIN_S: Final = 10.0


@dataclass(frozen=True)
class Call(Generic[ResultT]):
    """One HTTP request to a daemon, and how to read its answer.

    Attributes:
        endpoint: Row of the table of commands.
        read: Makes the result from the document of the answer.
        body: Document to send; None for none.
        also_fine: HTTP status that is no error for this call.
        answer_within_s: Longest time to wait for the answer, in s.
        plain_text: Whether the answer is a text and no document; `read` gets {"text": …} then.
    """

    endpoint: Endpoint
    read: Callable[[Document], ResultT]
    body: Document | None = None
    also_fine: int = 200
    answer_within_s: float = ANSWER_WITHIN_S
    plain_text: bool = False

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
    from piezod.client.request_bodies import checked

    endpoint, body = checked(name, fields)
    return Call(endpoint, reader(Answer), body)
