"""Fixtures for the tests of the daemon."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.daemon.daemons import Daemon, configuration

StartDaemon = Callable[..., Daemon]


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """Return the configuration of a simulated stage, in a folder of its own."""
    return configuration(tmp_path)


@pytest.fixture
def start() -> Iterator[StartDaemon]:
    """Return what starts a daemon; none of its processes outlives the test."""
    with ExitStack() as stack:

        def start_daemon(config: Path, *arguments: str, **environ: str) -> Daemon:
            return stack.enter_context(Daemon(config, *arguments, **environ))

        yield start_daemon
