"""The wheels of the guest: that of this checkout, and those of the libraries that it needs.

The libraries have the versions of the lock files, whatever Python this machine has.
"""

import hashlib
import shutil
import subprocess
import sys
import venv
from pathlib import Path
from typing import Final, NamedTuple

from tests.supply.lock import LOCK, TOOLS, pins
from tests.system.machine import build_wheel

EXTRAS: Final = "can,epics"
_LOCKS: Final = (LOCK, TOOLS / "epics.txt")
_GUEST: Final = (
    *("--python-version", "3.11", "--implementation", "cp", "--only-binary", ":all:"),
    *("--platform", "manylinux_2_28_x86_64", "--platform", "manylinux_2_27_x86_64"),
    *("--platform", "manylinux2014_x86_64"),
)
"""What Debian 12 has: Python 3.11 and glibc 2.36."""


class Wheels(NamedTuple):
    """Wheels of libraries."""

    folder: Path  #: Where they are.
    names: tuple[str, ...]  #: Their files, sorted.


def piezod(folder: Path) -> Path:
    """Build the wheel of this checkout into an empty folder; return its path."""
    folder.mkdir(parents=True)
    return build_wheel(folder)


def libraries(cache: Path, wheel: Path) -> Wheels:
    """Return the libraries that a wheel needs; they are downloaded if a lock file has changed.

    Raises:
        subprocess.CalledProcessError: If pip cannot download them.
        ValueError: If a downloaded file is not one that a lock file names.
    """
    locks = [lock.read_text(encoding="utf-8") for lock in _LOCKS]
    key = hashlib.sha256("".join([EXTRAS, *_GUEST, *locks]).encode()).hexdigest()[:12]
    folder = cache / f"wheels-{key}"
    if not folder.is_dir():
        print("make vm: downloading the wheels of the libraries, about 200 MB", flush=True)
        half = cache / "wheels-half"
        shutil.rmtree(half, ignore_errors=True)
        half.mkdir()
        constraints = half / "constraints.txt"
        constraints.write_text("\n".join(line for lock in locks for line in pins(lock)))
        _download(half, constraints, wheel)
        constraints.unlink()
        (half / wheel.name).unlink()
        check_hashes(half, "".join(locks))
        for old in cache.glob("wheels-*"):
            if old != half:
                shutil.rmtree(old)
        half.rename(folder)
    return Wheels(folder, tuple(sorted(path.name for path in folder.iterdir())))


def _download(folder: Path, constraints: Path, wheel: Path) -> None:
    own = folder.parent / "pip"  # an environment made with uv has none
    venv.create(own, with_pip=True, clear=True)
    pip = (str(own / "bin" / "pip"), "--quiet", "--disable-pip-version-check", "download")
    places = ("--dest", str(folder), "--constraint", str(constraints))
    subprocess.run([*pip, *_GUEST, *places, f"{wheel}[{EXTRAS}]"], stdout=sys.stderr, check=True)


def check_hashes(folder: Path, locks: str) -> None:
    """Compare files with the hashes of lock files, which `pip --constraint` would not accept.

    Raises:
        ValueError: If a file has none of them.
    """
    for path in folder.iterdir():
        digest = hashlib.sha256(path.read_bytes()).hexdigest()
        if digest not in locks:
            raise ValueError(f"{path.name}: its SHA-256 {digest} is in no lock file")
