"""A daemon with a stage that only records requests, and a server of the page for it."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.daemon.service.connection import ConnectionLimits
from piezod.telemetry.arrays import record_dtype
from tests.daemon.service.fakes import FakeReader, Served
from tests.daemon.waiting import eventually
from tests.web.browser import Web
from tests.web.remote import Remote, new_certificate


class ClockReader(FakeReader):
    """Returns one record at each call, with the present time."""

    def read(self, limit: int) -> tuple[NDArray[Any], int]:
        if not self.waiting:
            records = np.zeros(1, record_dtype(2))
            records["t_ns"] = time.monotonic_ns()
            self.waiting.append(records)
        return super().read(limit)


def new_daemon(folder: Path) -> Served:
    """Return a daemon whose stage moves in time; the caller runs it."""
    served = Served(folder, ConnectionLimits())
    served.stage.reader = ClockReader()
    return served


@pytest.fixture(scope="session")
def shared_daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a daemon for all tests that do not end it."""
    served = Served(tmp_path_factory.mktemp("daemon"), ConnectionLimits())
    with served.running():
        yield served


@pytest.fixture(scope="session")
def shared_web(shared_daemon: Served) -> Iterator[Web]:
    """Return a server of the page that finds this daemon, as "bench"."""
    web = Web(lambda: {"bench": shared_daemon.socket})
    with web.running():
        yield web


@pytest.fixture
def daemon(shared_daemon: Served, tmp_path: Path) -> Served:
    """Return the daemon with a new stage, which moves in time; nobody asks for the one before."""
    eventually(lambda: not shared_daemon.server.server_state.connections)
    shared_daemon.renew(tmp_path)
    shared_daemon.stage.reader = ClockReader()
    return shared_daemon


@pytest.fixture
def web(shared_web: Web, daemon: Served) -> Web:  # noqa: ARG001 - with a new stage
    """Return the server of the page, after all tabs of the test before have ended."""
    eventually(lambda: shared_web.stages is None or not shared_web.stages.all())
    return shared_web


@pytest.fixture(scope="session")
def shared_secure_web(
    shared_daemon: Served, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Web]:
    """Return a server with TLS on all addresses that finds this daemon, as "bench"."""
    certificate = new_certificate(tmp_path_factory.mktemp("tls"))
    web = Web(lambda: {"bench": shared_daemon.socket}, certificate)
    with web.running():
        yield web


@pytest.fixture
def remote(
    shared_secure_web: Web,
    daemon: Served,  # noqa: ARG001 - with a new stage
    tmp_path: Path,
) -> Remote:
    """Return a program on another computer."""
    return Remote(shared_secure_web, tmp_path)
