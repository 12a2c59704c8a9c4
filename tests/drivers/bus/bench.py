"""Emulated devices in another process, as served by `piezod emulate`."""

import json
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from piezod.devices import emulators
from tests.forked import Piped, forked


class Emulated:
    """Emulated devices that are served.

    Attributes:
        process: The process that serves them.
        where: Place of each, in the order of the request.
    """

    def __init__(self, process: Piped) -> None:
        self.process = process
        self.where = [each["where"] for each in self._told()["serving"]]

    def faults(self, *faults: str) -> None:
        """Inject these faults from now on, and no others; replies are counted from 1 again.

        The syntax is that of `piezod emulate --fault`. The faults are active when this returns.
        """
        self.process.stdin.write(", ".join(faults) + "\n")
        self.process.stdin.flush()
        assert self._told()["faults"] == ", ".join(faults)

    def _told(self) -> dict[str, Any]:
        line = self.process.stdout.readline()
        assert line, "the emulator has ended, see its errors above"
        document: dict[str, Any] = json.loads(line)
        return document


@contextmanager
def emulated(*profiles: str, arguments: tuple[str, ...] = ()) -> Iterator[Emulated]:
    """Serve devices on one rig while the block runs; they must end normally.

    Args:
        *profiles: Names of profiles, each with an optional place as NAME=PLACE. By default devices
            at a serial port and at a CAN adapter are served in a folder of their own, others at
            their usual place.
        arguments: Options of `piezod emulate`.
    """
    with tempfile.TemporaryDirectory(prefix="piezod-") as folder:
        places = [_place(profile, Path(folder)) for profile in profiles]
        with forked("emulate", *places, "--json", *arguments) as process:
            yield Emulated(process)


def _place(profile: str, folder: Path) -> str:
    if "=" in profile or emulators.load(profile).wire not in {"serial", "can"}:
        return profile
    return f"{profile}={folder / profile}.tty"
