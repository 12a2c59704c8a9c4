"""MicroPython of Debian, as it is, on the micro:bit that QEMU emulates."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final

from tests.peers.peer import ROOT
from tests.system.guest.monitor import Monitor, connected

FIRMWARE: Final = ROOT / "build/peers/usr/share/firmware-microbit-micropython/firmware.hex"
"""Where `make peers` puts it."""
_OUT: Final = "0x50000504"
"""The register of the outputs."""
_FIRST_PIN: Final = 4
_QEMU: Final = "qemu-system-arm"


def missing() -> str:
    """Return what this machine lacks, in one line; "" if nothing."""
    lacks = [] if shutil.which(_QEMU) else [f"{_QEMU} (sudo apt install qemu-system-arm)"]
    if not FIRMWARE.is_file():
        lacks.append("firmware-microbit-micropython (sudo apt update, rm -r build/peers)")
    return f"no micro:bit can be emulated without {', '.join(lacks)}" if lacks else ""


class Microbit:
    """A micro:bit that was just switched on.

    Args:
        port: Where its serial port appears; a board that was there before is replaced.
    """

    def __init__(self, port: Path) -> None:
        self._folder = Path(tempfile.mkdtemp(prefix="pz-"))
        socket = self._folder / "qmp"
        command = [_QEMU, "-M", "microbit", "-nodefaults", "-display", "none"]
        command += ["-device", f"loader,file={FIRMWARE}", "-serial", "pty"]
        command += ["-qmp", f"unix:{socket},server=on,wait=off"]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self._monitor = Monitor(connected(self._process, socket))
        assert self._process.stdout is not None
        found = re.search(rb"/dev/pts/\d+", self._process.stdout.readline())
        assert found is not None
        port.unlink(missing_ok=True)
        port.symlink_to(found[0].decode())

    def code(self) -> int:
        """Return what the 16 pins show."""
        word = self._monitor.command("human-monitor-command", **{"command-line": f"xp /1wx {_OUT}"})
        return int(word.rpartition(":")[2], 16) >> _FIRST_PIN & 0xFFFF

    def reset(self) -> None:
        """Reset the processor: MicroPython starts anew."""
        self._monitor.command("system_reset")

    def close(self) -> None:
        """End it, as if it were unplugged."""
        self._monitor.__exit__()
        self._process.kill()
        self._process.communicate()
        shutil.rmtree(self._folder)
