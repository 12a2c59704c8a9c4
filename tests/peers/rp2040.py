"""Our compiled firmware on an RP2040 by others: rp2040js, in a process of its own."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any, Final

from piezod.devices.emulation.emulator import Emulator
from piezod_drivers.serial_line.piezo_board.emulation.build import sources
from tests.drivers.serial_line.scripted_line import TestTime
from tests.peers.peer import CLIENTS, ROOT

FOLDER: Final = ROOT / "build" / "peers" / "node"
"""Where `make peers` puts rp2040js."""
QUIET_US: Final = 300
"""A firmware that sends nothing for so long has answered."""
MOST_US: Final = 200_000
BYTE_US: Final = 20


def missing() -> str:
    """Return what this machine lacks, in one line; "" if nothing."""
    programs = ("make", "python3", "arm-none-eabi-gcc", "node")
    lacks = [name for name in programs if shutil.which(name) is None]
    if not (FOLDER / "node_modules" / "rp2040js").is_dir():
        lacks.append("rp2040js")
    return f"without {', '.join(lacks)} no RP2040 can be emulated" if lacks else ""


def image(folder: Path, defines: str = "") -> Path:
    """Compile the firmware into a folder; return what is flashed."""
    command = ["make", "-s", "-C", str(sources()), "rp2040", f"OUT={folder}", f"DEFINES={defines}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "player-rp2040.uf2"


class Rp2040(Emulator):
    """A board that was just switched on; its inputs show 1000 and a half of the output before.

    Args:
        flashed: The image.
        time: The clock; while it has something to do the board is ahead of it.

    Attributes:
        seen: What the converters and the lines have seen.
    """

    def __init__(self, flashed: Path, time: TestTime) -> None:
        command = ["node", str(CLIENTS / "rp2040_board.mjs"), str(FOLDER), str(flashed)]
        pipe = subprocess.PIPE
        self._chip = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        self._time, self._begin_ns = time, time.t_ns
        self.seen: dict[str, Any] = {"now_ns": 0}
        self.run(10_000)

    def close(self) -> None:
        """End the process."""
        self._chip.kill()
        self._chip.communicate()

    def run(self, run_us: int, feed: bytes = b"", **more: object) -> bytes:
        """Let time pass on the board; return what it sends meanwhile."""
        assert self._chip.stdin is not None
        assert self._chip.stdout is not None
        request = {"feed": feed.hex(), "run_us": run_us, **more}
        print(json.dumps(request), file=self._chip.stdin, flush=True)
        self.seen = json.loads(self._chip.stdout.readline())
        return bytes.fromhex(self.seen["sent"])

    def camera(self, *edges_us: float) -> None:
        """Give edges at the trigger input at times from now, in us."""
        self.run(0, edges_us=edges_us)

    def receive(self, data: bytes) -> list[bytes]:
        """Let the firmware take bytes, and return what it sends."""
        sent = self._until_now() + self.run(BYTE_US * len(data), data)
        for _ in range(MOST_US // QUIET_US):
            more = self.run(QUIET_US)
            sent += more
            if not more and sent:
                break
        return [sent] if sent else []

    def due(self) -> list[bytes]:
        """Let the firmware run until now, and return what it sends."""
        sent = self._until_now()
        return [sent] if sent else []

    def _until_now(self) -> bytes:
        behind_us = (self._time.t_ns - self._begin_ns - self.seen["now_ns"]) // 1000
        return self.run(int(behind_us)) if behind_us > 0 else b""
