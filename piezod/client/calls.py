"""What a client sends to a daemon; nothing here opens a connection."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar
from urllib.parse import urlencode

from piezod.client.reader import read
from piezod.messages.answers import Answer
from piezod.messages.documents import Document
from piezod.messages.endpoints import ENDPOINTS, Endpoint

if TYPE_CHECKING:
    from piezod.config.waveforms.combined import WaveformConfig

ResultT = TypeVar("ResultT")
Waveforms: TypeAlias = "Mapping[str, WaveformConfig | Mapping[str, Any]]"
"""Waveforms by axis: models, or mappings with the keys of a file."""


@dataclass(frozen=True)
class Call(Generic[ResultT]):
    """One HTTP request to a daemon; its row has the class of the answer."""

    endpoint: Endpoint  #: Row of the table of commands.
    body: Document | None = None  #: Document to send; None for none.
    #: Longest time to wait for the answer, in s; None for that of the row.
    answer_within_s: float | None = None
    query: str = ""  #: Query of the path; empty for none.

    @property
    def method(self) -> str:
        """HTTP method."""
        return self.endpoint.method

    @property
    def path(self) -> str:
        """Path below `/v1/`, with its query."""
        return self.endpoint.path + self.query

    def read(self, answer: Any) -> ResultT:
        """Return the result of an answer: a document, or a text where the row says so.

        Raises:
            ClientError: If it does not fit.
        """
        answer_class: Any = self.endpoint.answer_class
        result: ResultT = answer if answer_class in (dict, str) else read(answer_class, answer)
        return result


def ask(name: str, /, **fields: object) -> Call[Any]:
    """Return the call of an endpoint without a request class.

    Args:
        name: Its name in the table of commands.
        fields: Keys of the body, or of the query of a GET; None for those that are left out.
    """
    endpoint = ENDPOINTS[name]
    given = {key: value for key, value in fields.items() if value is not None}
    if endpoint.method == "POST":
        return Call(endpoint, given)
    return Call(endpoint, query=f"?{urlencode(given)}" if given else "")


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

    return Call(*checked(name, fields))
