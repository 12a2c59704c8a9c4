"""The examples of `config/devices` for a CAN bus."""

from pathlib import Path

import pytest

from piezod.config.daemon import load_daemon
from piezod.devices import registry
from piezod.devices.wiring import construct, pairs_of
from tests.drivers.can_bus.profiles import DBC


@pytest.mark.parametrize("name", ["canopen-401.yaml", "can-dbc.yaml"])
def test_example_is_a_whole_configuration(name: str) -> None:
    """Each example is valid, and its devices can be constructed."""
    path: Path = DBC.parent / name
    config = load_daemon(path, registry)

    assert construct(config.devices, pairs_of(config.axes), 1)
