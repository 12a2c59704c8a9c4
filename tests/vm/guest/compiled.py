"""What the wheel needs compiled: byte code and kernels; `python -m tests.vm.guest.compiled`.

That takes an emulated processor many minutes, more than a unit may need to start. Therefore this
file also runs on the host, in the files of the guest, and the guest unpacks what it leaves there.
"""

import os
import subprocess
import sys
import sysconfig
import zlib
from pathlib import Path
from typing import Final

SHARE: Final = Path("/mnt/host")
ARCHIVE: Final = SHARE / "compiled.tar"
PACKAGES: Final = Path(sysconfig.get_path("purelib"))
KERNELS: Final = Path("/var/cache/piezod")
_OURS: Final = ("piezod", "piezod_drivers")


def install(*options: str) -> None:
    """Install the wheel, without a network and without byte code; its libraries must be there.

    Raises:
        subprocess.CalledProcessError: If pip fails; its standard error has the reason.
    """
    (wheel,) = (SHARE / "wheels").glob("*.whl")
    _pip("install", "--quiet", *options, "--no-deps", "--no-index", "--no-compile", str(wheel))
    # Asked to resolve what is installed, pip reads each library's metadata some sixty times.
    _pip("check")
    # Byte code and kernels count as stale if the time of a source has changed: a time that
    # follows from the text is the same at both places, and is kept while the text is.
    for package in _OURS:
        for path in (PACKAGES / package).rglob("*.py"):
            time_s = zlib.crc32(path.read_bytes()) >> 1
            os.utime(path, (time_s, time_s))


def _pip(*arguments: str) -> None:
    pip = (sys.executable, "-m", "pip", "--disable-pip-version-check", *arguments)
    subprocess.run(pip, check=True, capture_output=True, text=True)


def unpack() -> None:
    """Unpack what the host has compiled."""
    subprocess.run(["tar", "--extract", f"--file={ARCHIVE}", "--directory=/"], check=True)  # noqa: S607


def main() -> None:
    """Install and compile on the host, and pack the results for the guest."""
    install("--force-reinstall")
    ours = [str(PACKAGES / package) for package in _OURS]
    subprocess.run([sys.executable, "-m", "compileall", "-q", *ours], check=True)
    _compile_kernels()
    byte_code = [str(path) for each in ours for path in Path(each).rglob("__pycache__")]
    tar = ["tar", "--create", f"--file={ARCHIVE}", "--absolute-names", str(KERNELS), *byte_code]
    subprocess.run(tar, check=True)


def _compile_kernels() -> None:
    import numpy as np  # noqa: PLC0415 - for these imports the wheel must be installed

    from piezod.cli.daemon.shipped import shipped  # noqa: PLC0415
    from piezod.config.daemon import load_daemon  # noqa: PLC0415
    from piezod.control.warm_up import warm_up  # noqa: PLC0415
    from piezod.devices import registry  # noqa: PLC0415
    from piezod.plant.plant import Plant  # noqa: PLC0415
    from piezod.plant.variants import VARIANTS  # noqa: PLC0415

    warm_up(load_daemon(shipped("config") / "simulated.yaml", registry))
    plant = Plant(VARIANTS["stack"].parameters, np.random.SeedSequence(1))
    plant.command(1.0)
    plant.advance_to(1_000_000)


if __name__ == "__main__":
    main()
