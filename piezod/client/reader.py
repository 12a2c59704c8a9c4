"""Reads answers and telemetry from what a daemon sends, and checks them."""

import json
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from piezod.client.errors import unexpected
from piezod.messages.documents import Message
from piezod.messages.telemetry import Telemetry

if TYPE_CHECKING:
    from pydantic import TypeAdapter

MessageT = TypeVar("MessageT", bound=Message)


def read(answer: type[MessageT], document: Any) -> MessageT:
    """Return the answer that a document is; it keeps the document.

    Raises:
        ClientError: If the document does not fit.
    """
    from pydantic import ValidationError

    kind: Any = answer
    try:
        made: MessageT = _adapter(kind).validate_python(document)
    except ValidationError as error:
        raise unexpected(document, str(error)) from error
    vars(made)["document"] = document
    return made


@cache
def _adapter(answer: type[Message]) -> "TypeAdapter[Any]":
    """Return the adapter of an answer, made at first use: pydantic takes long to import."""
    from pydantic import TypeAdapter

    return TypeAdapter(answer)


class LineSplitter:
    """Makes lines from the blocks of bytes of a stream."""

    def __init__(self) -> None:
        self._rest = b""

    def feed(self, block: bytes) -> list[str]:
        """Take the next block; return the lines that it completes, without their ends."""
        *lines, self._rest = (self._rest + block).split(b"\n")
        return [line.rstrip(b"\r").decode(errors="replace") for line in lines]


class TelemetryReader:
    """Makes telemetry from the lines of an event stream."""

    def __init__(self) -> None:
        self._data: list[str] = []

    def feed(self, line: str) -> Telemetry | None:
        """Take the next line, without its end; return the interval that it completes.

        Raises:
            ClientError: If the event has an unexpected form.
        """
        if line:
            name, _, value = line.partition(":")
            if name == "data":
                self._data.append(value.removeprefix(" "))
            return None
        text, self._data = "\n".join(self._data), []
        if not text:
            return None
        try:
            document = json.loads(text)
        except ValueError as error:
            raise unexpected(text, str(error)) from error
        if not isinstance(document, dict):
            raise unexpected(document, "must be an object")
        return read(Telemetry, document)
