"""Fixtures for the tests of the daemon."""

import io
import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import structlog

from piezod.config.daemon import DaemonConfig
from piezod.daemon.logging import set_up_logging
from piezod.daemon.loop import accept
from tests.daemon.bench import Bench
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
def config(rig_file: Path) -> DaemonConfig:
    """Return the accepted configuration of a simulated stage."""
    return accept.load(rig_file)


@pytest.fixture
def bench(tmp_path: Path, config: DaemonConfig) -> Iterator[Bench]:
    """Return a stage without a loop."""
    bench = Bench(tmp_path, config)
    yield bench
    bench.link.stage_audit.close()


@pytest.fixture
def log() -> io.StringIO:
    """Return the log, in the form for people."""
    stream = io.StringIO()
    set_up_logging(stream, {})
    return stream


@pytest.fixture
def start() -> Iterator[StartDaemon]:
    """Return a function that starts a daemon; its processes end with the test."""
    with ExitStack() as stack:

        def start_daemon(config: Path, *arguments: str, **environ: str) -> Daemon:
            return stack.enter_context(Daemon(config, *arguments, **environ))

        yield start_daemon
