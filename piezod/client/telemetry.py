"""Telemetry: server-sent events, each for one interval of time."""

import json

from piezod.client.errors import unexpected
from piezod.client.reader import read
from piezod.messages.telemetry import Telemetry


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
