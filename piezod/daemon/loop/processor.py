"""The processor of a loop: one without the loop of another stage, as long as there is one.

A loop marks its processor with an abstract unix socket that nobody can connect to. The kernel
removes the mark when the process ends, however it ends; the mark needs no folder and no permission,
and loops of different users see each other. Two loops with one processor have different places.
"""

import errno
import socket
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final, NamedTuple

_MARK: Final = "piezod/processor/{cpu}/{place}"
_ALL_MARKS: Final = Path("/proc/net/unix")


class ClaimedProcessor(NamedTuple):
    """A processor that a loop has chosen."""

    cpu: int  #: Its number.
    shared_with: int  #: Number of loops that had it before.
    #: The mark, which lasts until it is closed; None if the system allows none.
    mark: socket.socket | None

    def document(self) -> dict[str, Any]:
        """Return it as JSON for status and API."""
        return {"number": self.cpu, "shared_with": self.shared_with}


def claim_processor(wanted: int | None, allowed: Collection[int]) -> ClaimedProcessor:
    """Mark and return the processor with the fewest loops; of equal ones the last.

    Args:
        wanted: Number of the only processor to choose; None for any allowed one.
        allowed: Numbers of the processors that this process may use.
    """
    # From the last one, because the first processors get most interrupts.
    candidates = sorted(allowed, reverse=True) if wanted is None else [wanted]
    place = 0
    while True:
        for cpu in candidates:
            try:
                return ClaimedProcessor(cpu, place, _mark(cpu, place))
            except OSError as error:
                if error.errno != errno.EADDRINUSE:  # loops cannot see each other on this system
                    return ClaimedProcessor(cpu, place, None)
        place += 1


def _mark(cpu: int, place: int) -> socket.socket:
    """Return the mark of a place of a processor.

    Raises:
        OSError: EADDRINUSE if another loop has it.
    """
    mark = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        mark.bind("\0" + _MARK.format(cpu=cpu, place=place))
    except OSError:
        mark.close()
        raise
    return mark


def free_processors(allowed: Collection[int], marks: Path = _ALL_MARKS) -> list[int] | None:
    """Return the processors that no loop has; None if that cannot be found out.

    Args:
        allowed: Numbers of the processors that a loop may use.
        marks: The kernel's list of unix sockets.
    """
    try:
        names = {line.rpartition(" @")[2] for line in marks.read_text().splitlines()}
    except OSError:
        return None
    return [cpu for cpu in sorted(allowed) if _MARK.format(cpu=cpu, place=0) not in names]
