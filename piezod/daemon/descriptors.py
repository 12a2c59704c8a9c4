"""File descriptors of the supervisor: each connection of a client needs one."""

import resource
from typing import Final

from piezod.errors import PiezodError

LEAST: Final = 128
"""Without this number of descriptors a single user could take all of them."""
WANTED: Final = 4096


def raise_limit() -> None:
    """Raise the limit of open files as far as this process may and needs.

    Raises:
        PiezodError: If it may not open enough.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    allowed = WANTED if hard == resource.RLIM_INFINITY else min(hard, WANTED)
    if soft != resource.RLIM_INFINITY and soft < allowed:
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))
    if allowed < LEAST:
        what = f"this process may open {allowed} files, at least {LEAST} are needed"
        raise PiezodError(f"{what}: `ulimit -n 1024`, or LimitNOFILE= of the service")
