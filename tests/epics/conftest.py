"""A stage that runs, and its IOC, for the tests of one module."""

from collections.abc import Iterator

import pytest

from tests.daemon.daemons import Daemon, configuration
from tests.epics.processes import Ioc


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    """Return the daemon of a simulated stage, "rig"."""
    trim = "{base: feedforward, gain_per_s: 20, authority_pct: 5}"
    config = configuration(tmp_path_factory.mktemp("rig"), rate_hz="100", trim=trim)
    with Daemon(config) as daemon:
        yield daemon.up()


@pytest.fixture(scope="module")
def ioc(daemon: Daemon) -> Iterator[Ioc]:
    """Return an IOC of that stage that takes writes."""
    ioc = Ioc(daemon.folder, "--control")
    try:
        yield ioc.up()
    finally:
        assert ioc.end() == 0
