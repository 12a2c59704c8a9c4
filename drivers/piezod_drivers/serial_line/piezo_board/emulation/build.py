"""Compiles the firmware and the board around it, with the compilers of this machine."""

import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Final, NamedTuple

import piezod_drivers
from piezod.errors import DeviceUnavailableError
from piezod.home import user_folder
from piezod.own_folder import make_folder

PROGRAMS: Final = ("make", "cc", "avr-gcc")
_HEADER: Final = Path("/usr/include/simavr/sim_avr.h")
_PACKAGES: Final = "apt install make gcc gcc-avr avr-libc libsimavr-dev"


class Built(NamedTuple):
    """A compiled board."""

    firmware: Path  #: For the processor.
    board: Path  #: Shared library: what is around the processor.


def sources() -> Path:
    """Return the folder of the firmware: in the wheel, or in a checkout."""
    package = Path(piezod_drivers.__file__).parent
    in_wheel = package / "firmware" / "player"
    return in_wheel if in_wheel.is_dir() else package.parents[1] / "firmware" / "player"


def missing() -> str:
    """Return what this machine lacks to emulate a board, in one line; "" if nothing."""
    lacks = [name for name in PROGRAMS if shutil.which(name) is None]
    if not _HEADER.exists():
        lacks.append("simavr")
    return f"without {', '.join(lacks)} no board can be emulated: {_PACKAGES}" if lacks else ""


def build(folder: Path | None = None, defines: str = "") -> Built:
    """Compile a board, unless it was compiled before.

    Args:
        folder: Folder of the firmware; None for that of piezod.
        defines: Further options of the compiler.

    Raises:
        DeviceUnavailableError: If a compiler is missing, or fails.
    """
    if lacking := missing():
        raise DeviceUnavailableError(lacking)
    folder = folder or sources()
    built = user_folder("XDG_CACHE_HOME") / "piezod" / f"board-{_digest(folder, defines)}"
    if not built.is_dir():
        make_folder(built.parent)
        _build_into(built, folder, defines)
    return Built(built / "player-avr.elf", built / "board.so")


def _digest(folder: Path, defines: str) -> str:
    digest = hashlib.sha256(defines.encode())
    for file in sorted(folder.rglob("*")):
        if file.is_file():
            digest.update(str(file.relative_to(folder)).encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def _build_into(built: Path, folder: Path, defines: str) -> None:
    """Compile beside the place, then move: another process may compile the same."""
    with tempfile.TemporaryDirectory(dir=built.parent, prefix="building-") as temporary:
        out = Path(temporary) / "out"
        command = ["make", "-s", "-C", str(folder), "emulator", f"OUT={out}", f"DEFINES={defines}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - ours
        if done.returncode:
            why = next(iter(done.stderr.strip().splitlines()), f"make ended with {done.returncode}")
            raise DeviceUnavailableError(f"the firmware of the board cannot be compiled: {why}")
        try:
            os.rename(out, built)  # noqa: PTH104 - its error is what is known here
        except OSError:
            if not built.is_dir():
                raise
