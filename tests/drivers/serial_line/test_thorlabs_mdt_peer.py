"""An independent client, `mdt69x`, with the emulated amplifier."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from piezod.devices import registry
from piezod.devices.interface import Wiring
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import emulated

with warnings.catch_warnings():
    warnings.simplefilter("ignore", SyntaxWarning)  # of mdt69x itself, where it is first compiled
    from mdt69x import Controller  # type: ignore[import-untyped] # it has no types

REPLY_S, NO_REPLY_S = 5.0, 0.2
"""Time-outs of the client: the usual one, and one for a prompt that does not come.

The latter is for a change of mode, and for a refusal in compatibility mode.
"""


@pytest.fixture(scope="module")
def port() -> Iterator[str]:
    """Serve an MDT693B without echo, as our driver leaves it."""
    with emulated("mdt693b", arguments=("--axes", "3")) as device:
        plugin = registry.load("thorlabs_mdt")
        options = plugin.options_model.model_validate(
            {"port": device.where[0], "timeout_ms": 2000.0}
        )
        driver: Any = plugin.create(options, Wiring((), ("x",)), 1)
        driver.open()
        driver.close()
        yield device.where[0]


@pytest.fixture
def peer(port: str) -> Iterator[Any]:
    """Return the client, which starts in compatibility mode."""
    client = Controller(port)
    client._ser.timeout = REPLY_S  # noqa: SLF001 - it has no other way
    yield client
    with hurried(client):
        client.set_compatibility_off()
    client.close()


@contextmanager
def hurried(client: Any) -> Iterator[None]:
    """Shorten the client's time-out while the block runs."""
    client._ser.timeout = NO_REPLY_S  # noqa: SLF001 - it has no other way
    yield
    client._ser.timeout = REPLY_S  # noqa: SLF001 - it has no other way


@pytest.mark.confirms(
    "thorlabs_mdt", "mdt693b", part="compatibility mode", by="mdt69x", kind="client"
)
def test_compatibility_mode(peer: Any) -> None:
    """The client sets and reads a voltage and its limits by the commands of the A models."""
    assert peer.get_compatibility() == peer.COMPATIBILITY_ON
    assert peer.set_x_voltage(12.5) == peer.SUCCESS
    eventually(lambda: peer.get_x_voltage() == pytest.approx(12.5, abs=0.5))
    with hurried(peer):
        assert peer.set_x_voltage(200) == peer.FAIL
    assert peer.get_switch_limit() == 150
    assert peer.get_x_voltage_max() == 150.5


@pytest.mark.confirms(
    "thorlabs_mdt", "mdt693b", part="commands of the B models", by="mdt69x", kind="client"
)
def test_own_mode(peer: Any) -> None:
    """The client sets and reads all three axes by the commands of the B models."""
    with hurried(peer):
        peer.set_compatibility_off()
    assert peer.set_xyz_voltage(5, 10, 15) == peer.SUCCESS
    eventually(lambda: peer.get_xyz_voltage() == pytest.approx([5, 10, 15], abs=0.5))
    assert peer.get_y_voltage() == pytest.approx(10, abs=0.5)
    assert peer.get_z_voltage_min() == 0
    assert peer.set_y_voltage(-1) == peer.FAIL
    peer.get_id()
    assert (peer._model, peer._firmware_version) == (  # noqa: SLF001 - it keeps them there
        "Model MDT693B Piezo Control Module",
        "2.09",
    )
