"""The files of an IIO device in /sys: each value is a text of its own."""

import errno
import os
from collections.abc import Iterator
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import Final

from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.kernel.errno_faults import fault_of, refusal

DEVICES: Final = Path("/sys/bus/iio/devices")
_ABSENT: Final = "load its driver, or its device tree overlay"
_GROUP: Final = (
    "an output of IIO may be written by root only: give its file to the group of this user with a "
    "rule of udev (docs: a Raspberry Pi)"
)
_MOST_BYTES: Final = 64


def folder_of(device: str) -> Path:
    """Return the folder of a device: a path, or that of the chip with this name.

    Raises:
        DeviceUnavailableError: If there is none.
        DeviceError: If there are several.
    """
    if "/" in device:
        if not (Path(device) / "name").exists():
            raise refusal(device, errno.ENOENT, _ABSENT, "")
        return Path(device)
    found = {path: name_of(path) for path in sorted(DEVICES.glob("iio:device*"))}
    folders = [path for path, name in found.items() if name == device]
    if not folders:
        known = ", ".join(found.values()) or "none"
        raise DeviceUnavailableError(
            f"no device {device} in {DEVICES}, there are: {known}; {_ABSENT}"
        )
    if len(folders) > 1:
        names = " or ".join(map(str, folders))
        raise DeviceError(f"several devices are called {device}: name the folder, {names}")
    return folders[0]


def name_of(folder: Path) -> str:
    """Return the name of the chip; the folder's name if it has none."""
    with suppress(OSError):
        return (folder / "name").read_text("utf-8").strip()
    return folder.name


def number_in(folder: Path, file: str, what: str) -> float | None:
    """Return the number of a channel's own file, or of the one that all of its type share.

    Args:
        folder: Folder of the device.
        file: Beginning of the names of the channel's files, as in_voltage0.
        what: End of the name, as scale.

    Returns:
        The number; None if there is no such file.

    Raises:
        DeviceError: If it has no number.
    """
    for path in _files(folder, file, what):
        with suppress(FileNotFoundError):
            text = path.read_text("ascii").strip()
            with suppress(ValueError):
                if isfinite(number := float(text)):
                    return number
            raise DeviceError(f"{path} has {text!r}, expected a number")
    return None


def _files(folder: Path, file: str, what: str) -> Iterator[Path]:
    yield folder / f"{file}_{what}"
    direction, _, channel = file.partition("_")
    kinds = [part.rstrip("0123456789") for part in channel.split("-")]
    if len(kinds) > 1:
        yield folder / f"{direction}_{'-'.join(kinds)}_{what}"
    yield folder / f"{direction}_{kinds[0]}_{what}"


class RawFile:
    """The file with the raw value of a channel, open all the time.

    Args:
        path: Its path.
        writes: Whether it is written, too.

    Raises:
        DeviceUnavailableError: If it is absent or not allowed.
    """

    def __init__(self, path: Path, *, writes: bool) -> None:
        self._path = path
        try:
            self._fd = os.open(path, (os.O_RDWR if writes else os.O_RDONLY) | os.O_CLOEXEC)
        except OSError as error:
            raise refusal(str(path), error.errno or errno.EIO, _ABSENT, _GROUP) from error

    def read(self) -> int:
        """Return the raw value. Real-time safe.

        Raises:
            LineFault: If the kernel refuses, or it is no number.
        """
        try:
            return int(os.pread(self._fd, _MOST_BYTES, 0).split(b"\n", 1)[0])
        except OSError as error:
            raise fault_of(error.errno or errno.EIO, f"{self._path}: read") from error
        except ValueError as error:
            raise fault_of(errno.EIO, f"{self._path}: {error}") from error

    def write(self, raw: int) -> None:
        """Set the raw value. Real-time safe.

        Raises:
            LineFault: If the kernel refuses.
        """
        try:
            os.pwrite(self._fd, b"%d\n" % raw, 0)
        except OSError as error:
            raise fault_of(error.errno or errno.EIO, f"{self._path}: write {raw}") from error

    def close(self) -> None:
        """Close the file; an output holds. Never raises."""
        with suppress(OSError):
            os.close(self._fd)
