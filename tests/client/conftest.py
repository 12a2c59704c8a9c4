"""A fake daemon and a client of it."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.client import StageClient
from tests.client.fake_daemon import FakeDaemon
from tests.client.group_of_fakes import daemons  # noqa: F401 - a fixture


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[FakeDaemon]:
    """Return a daemon that accepts everything."""
    daemon = FakeDaemon(tmp_path / "api.sock")
    with daemon.running():
        yield daemon


@pytest.fixture
def stage(daemon: FakeDaemon) -> Iterator[StageClient]:
    """Return a client of that daemon."""
    with StageClient(socket=daemon.socket_path, name="test") as stage:
        yield stage
