"""The monitor of QEMU: commands to a running machine, and its USB plugs."""

import json
import socket
import subprocess
from pathlib import Path
from typing import Any, Final, Self

from tests.daemon.waiting import eventually

_ANSWER_S: Final = 60.0


class Monitor:
    """The monitor of a machine."""

    def __init__(self, wire: socket.socket) -> None:
        wire.settimeout(_ANSWER_S)
        self._wire = wire
        self._lines = wire.makefile("rw", encoding="utf-8", newline="\n")
        self._lines.readline()
        self.command("qmp_capabilities")

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the connection."""
        self._lines.close()
        self._wire.close()

    def plug(self, identity: str, chardev: str) -> str:
        """Plug an FTDI adapter with this serial number; return `ok` or why it failed."""
        return self.command(
            "device_add",
            driver="usb-serial",
            bus="usb.0",
            id=identity,
            serial=identity,
            chardev=chardev,
        )

    def unplug(self, identity: str) -> str:
        """Unplug an adapter, and wait until it is gone; return `ok` or why it failed."""
        return self.command("device_del", id=identity)

    def command(self, command: str, **arguments: str) -> str:
        """Send a command; return what it printed, `ok` if nothing, or why it failed."""
        document: dict[str, Any] = {"execute": command}
        if arguments:
            document["arguments"] = arguments
        self._lines.write(json.dumps(document) + "\n")
        self._lines.flush()
        awaited = {"return", "DEVICE_DELETED"} if command == "device_del" else {"return"}
        for line in self._lines:
            answer = json.loads(line)
            if "error" in answer:
                return str(answer["error"]["desc"])
            awaited -= {*answer, answer.get("event")}
            if not awaited:
                return str(answer.get("return") or "ok")
        raise AssertionError("QEMU has ended")


def connected(process: "subprocess.Popen[bytes]", path: Path) -> socket.socket:
    """Connect to a socket of QEMU as soon as it is there."""
    eventually(lambda: path.exists() or process.poll() is not None)
    assert process.poll() is None, "QEMU does not start, see its errors above"
    wire = socket.socket(socket.AF_UNIX)
    wire.connect(str(path))
    return wire
