"""The CAN drivers with emulated nodes in another process over UDP, and faults of a bus."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import can
import pytest

from piezod.devices.status import DeviceFlag
from tests.daemon.waiting import eventually
from tests.drivers.bus.bench import Emulated, emulated
from tests.drivers.bus.checks import flags_of, opens
from tests.drivers.can_bus.ports import free_port
from tests.drivers.can_bus.profiles import CANOPEN, GROUP, POLLED


def _now() -> int:
    return time.monotonic_ns()


@pytest.fixture(scope="module", params=[CANOPEN, POLLED], ids=["canopen", "dbc"])
def served(request: pytest.FixtureRequest) -> Iterator[tuple[Emulated, Any]]:
    """Serve a node in a UDP group; return its emulation and the function that makes its driver."""
    profile = request.param
    with emulated(f"{profile.name}=udp:{GROUP}:{free_port()}") as node:
        yield node, profile.maker(node.where[0], 500.0)


@pytest.fixture
def device(served: tuple[Emulated, Any]) -> Iterator[Any]:
    """Return the driver's device, active."""
    node, make = served
    device = make()
    eventually(lambda: opens(device))
    device.activate(_now())
    yield device
    device.close()
    node.faults()


def _drives(device: Any) -> bool:
    taken, (sample,) = device.exchange([3.0], _now())
    return taken and bool(sample.valid)


def test_stage_moves_over_udp(device: Any) -> None:
    """The stage follows the drive voltage, and the voltage is read back."""
    eventually(lambda: _drives(device))

    eventually(lambda: abs(device.read_back(_now())[0] - 3.0) < 0.1)


@pytest.mark.sees("canopen", "B12")
@pytest.mark.sees("can_dbc", "B12")
def test_foreign_frames_of_a_node_are_reported(served: tuple[Emulated, Any], device: Any) -> None:
    """Foreign frames with own identifiers are reported until they stop."""
    node, _ = served
    node.faults("foreign")

    eventually(lambda: [_drives(device), DeviceFlag.FOREIGN_FRAME in flags_of(device)][-1])
    node.faults()
    eventually(lambda: _drives(device) and not flags_of(device))


@pytest.mark.sees("canopen", "B11")
@pytest.mark.sees("can_dbc", "B11")
def test_flood_is_survived(served: tuple[Emulated, Any], device: Any) -> None:
    """A flooded bus raises nothing and causes only bus faults.

    When the flood ends, the device works again.
    """
    node, _ = served
    _, group, port = node.where[0].split(":")
    babbler = can.Bus(
        interface="udp_multicast", channel=group, port=int(port), hop_limit=0, fd=False
    )
    reported: set[DeviceFlag] = set()
    for _ in range(20):
        for _ in range(100):
            babbler.send(can.Message(arbitration_id=0x7F0, data=bytes(8), is_extended_id=False))
        _drives(device)
        reported |= flags_of(device)
    babbler.shutdown()

    assert DeviceFlag.BUS_OVERLOADED in reported
    assert DeviceFlag.DISCONNECTED not in reported
    eventually(lambda: _drives(device) and not flags_of(device))


@pytest.mark.sees("canopen", "B8")
@pytest.mark.sees("can_dbc", "B8")
@pytest.mark.parametrize("profile", [CANOPEN, POLLED], ids=["canopen", "dbc"])
def test_adapter_off_the_bus_is_reported_and_comes_back(tmp_path: Path, profile: Any) -> None:
    """An adapter that refuses every frame is off the bus and works after opening it again."""
    with emulated(f"{profile.name}={tmp_path / 'can.tty'}") as node:
        device = profile.maker(node.where[0], 5.0)()
        eventually(lambda: opens(device))
        device.activate(_now())
        eventually(lambda: _drives(device))
        node.faults("bus-off:now:600")
        reported: set[DeviceFlag] = set()

        def is_lost() -> bool:
            nonlocal reported
            _drives(device)
            reported |= flags_of(device)
            return bool(device.lost)

        eventually(is_lost)
        assert DeviceFlag.BUS_OFF in reported
        assert not _drives(device)
        device.close()
        assert not opens(device), "it is still off"
        device.close()
    device.close()
