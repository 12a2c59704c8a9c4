"""Services for the tests of this folder."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from piezod.daemon.service.connection import ConnectionLimits
from tests.daemon.service.fakes import Served

Serve = Callable[[ConnectionLimits], Served]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    """Return a function that starts a service with other limits."""
    with ExitStack() as stack:

        def start(limits: ConnectionLimits) -> Served:
            served = Served(tmp_path, limits)
            stack.enter_context(served.running())
            return served

        yield start


@pytest.fixture(scope="session")
def shared_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Return a service for all tests that do not end it."""
    served = Served(tmp_path_factory.mktemp("service"), ConnectionLimits())
    with served.running():
        yield served


@pytest.fixture
def served(shared_service: Served, tmp_path: Path) -> Served:
    """Return a running service with a new stage."""
    shared_service.renew(tmp_path)
    return shared_service


@pytest.fixture
def client(served: Served) -> Iterator[httpx.Client]:
    """Return a client of the service."""
    with served.client() as client:
        yield client
