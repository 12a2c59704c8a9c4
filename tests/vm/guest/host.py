"""The connection of the guest to its host: results go there, and requests about its plugs."""

import json
import os
from pathlib import Path
from typing import Final

_PORT: Final = Path("/dev/virtio-ports/piezod.vm")


class Host:
    """The host."""

    def __init__(self) -> None:
        self._port = os.open(_PORT, os.O_RDWR)

    def report(self, name: str, reason: str, detail: str, duration_s: float) -> None:
        """Report the result of a check."""
        self._send(name=name, reason=reason, detail=detail, duration_s=duration_s)

    def end(self) -> None:
        """Report that all checks were made."""
        self._send(end=True)

    def plug(self, identity: str) -> None:
        """Have a USB adapter with this serial number plugged in."""
        self._request("plug", identity)

    def unplug(self, identity: str) -> None:
        """Have a USB adapter unplugged."""
        self._request("unplug", identity)

    def _request(self, request: str, argument: str) -> None:
        self._send(request=request, argument=argument)
        answer = b""
        while not answer.endswith(b"\n"):
            answer += os.read(self._port, 1)
        if answer != b"ok\n":
            raise OSError(f"{request} {argument}: {answer.decode()}")

    def _send(self, **document: object) -> None:
        os.write(self._port, json.dumps(document).encode() + b"\n")
