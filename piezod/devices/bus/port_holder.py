"""Which program has a port open."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

_PROCESSES = Path("/proc")


def holder_of(port: str) -> str:
    """Return the name and the process id of another program that has a port open.

    Takes some milliseconds: not for the loop.

    Args:
        port: Path of the port, or a link to it.

    Returns:
        For example "ModemManager, process 812"; empty if none is found, as for programs of other
        users, whose open files only root can list.
    """
    path = os.path.realpath(port)
    for process in _PROCESSES.glob("[0-9]*"):
        if process.name == str(os.getpid()):
            continue
        with suppress(OSError):  # it ended meanwhile, or it is another user's
            if path in _open_files(process):
                name = (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
                return f"{name}, process {process.name}"
    return ""


def _open_files(process: Path) -> Iterator[str]:
    for number in os.listdir(process / "fd"):  # noqa: PTH208 - Path.iterdir hides a refusal
        with suppress(OSError):  # it was closed meanwhile
            yield os.readlink(process / "fd" / number)  # noqa: PTH115 - only the text is wanted
