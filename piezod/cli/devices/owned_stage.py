"""Exclusive use of a stage's devices by a command, while no daemon runs the stage."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezod.daemon.lock import Lock, device_lock, taken_within
from piezod.daemon.paths import stage_paths

LOCK_WAIT_S = 2.0
"""A daemon that is ending releases its stage within this time."""


@contextmanager
def owning(config: Path) -> Iterator[None]:
    """Lock the devices of a stage against a daemon until the block ends.

    Raises:
        AlreadyRunningError: If a daemon runs, or a loop process without a daemon.
    """
    paths = stage_paths(config)
    paths.make_folders()
    # The daemon holds the first lock and its loop process the second, which may outlive the first.
    with (
        taken_within(lambda: Lock(paths.lock), LOCK_WAIT_S),
        taken_within(lambda: device_lock(paths.loop_lock), LOCK_WAIT_S),
    ):
        yield
