"""The conformance script for boards, and a port to an emulated one, in virtual time."""

import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Final

from piezod.devices.emulation.emulator import Emulator
from tests.drivers.serial_line.scripted_line import MS, TestTime

SCRIPT: Final = Path(__file__).parents[3] / "firmware" / "conformance.py"
STEP_NS: Final = 10 * MS


@cache
def script() -> ModuleType:
    """Return the script as a module."""
    spec = importlib.util.spec_from_file_location("conformance", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["conformance"] = module
    spec.loader.exec_module(module)
    return module


class EmulatedPort:
    """The line to an emulated board."""

    def __init__(self, board: Emulator, time: TestTime) -> None:
        self._board, self._time = board, time
        self._got = b""
        self.wait(0.01)  # the firmware starts

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._got += b"".join(self._board.receive(data))

    def read(self, most: int) -> bytes:
        """Return received bytes; wait for up to a second."""
        for _ in range(100):
            if len(self._got) >= most:
                break
            self.wait(0.01)
        found, self._got = self._got[:most], self._got[most:]
        return found

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(max(round(seconds * 1e9) // STEP_NS, 1)):
            self._time.t_ns += STEP_NS
            self._got += b"".join(self._board.due())
