"""Fixtures for the tests of the daemon."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import structlog

from tests.daemon.daemons import Daemon, configuration

StartDaemon = Callable[..., Daemon]


@pytest.fixture(autouse=True)
def _log_as_before() -> Iterator[None]:
    """Restore the log settings of this process after a test."""
    root = logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    yield
    structlog.reset_defaults()
    root.setLevel(level)
    root.handlers[:] = handlers


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """Return the configuration of a simulated stage, in a folder of its own."""
    return configuration(tmp_path)


@pytest.fixture
def start() -> Iterator[StartDaemon]:
    """Return a function that starts a daemon; its processes end with the test."""
    with ExitStack() as stack:

        def start_daemon(config: Path, *arguments: str, **environ: str) -> Daemon:
            return stack.enter_context(Daemon(config, *arguments, **environ))

        yield start_daemon
