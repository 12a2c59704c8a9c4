"""Locks, as tests see them."""

from pathlib import Path

from piezod.daemon.lock import Lock
from piezod.errors import AlreadyRunningError


def is_held(path: Path) -> bool:
    """Return whether another process holds a lock; False without a file."""
    if not path.exists():
        return False
    try:
        Lock(path).release()
    except AlreadyRunningError:
        return True
    return False
