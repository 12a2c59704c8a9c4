"""A stage that a verb has for itself, as no daemon runs it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LOCK_WAIT_S = 2.0
"""A daemon that is ending lets go of its stage within this time."""


@contextmanager
def owning(config: Path) -> Iterator[None]:
    """Have the devices of a stage for oneself while the block runs.

    Args:
        config: Configuration of the daemon that would have them else.

    Raises:
        AlreadyRunningError: If a daemon runs, or its loop lives on.
    """
    from piezod.daemon.lock import Lock, device_lock, taken_within
    from piezod.daemon.paths import stage_paths

    paths = stage_paths(config)
    paths.make_folders()
    with (
        taken_within(lambda: Lock(paths.lock), LOCK_WAIT_S),
        taken_within(lambda: device_lock(paths.loop_lock), LOCK_WAIT_S),
    ):
        yield
