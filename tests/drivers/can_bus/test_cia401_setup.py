"""How the driver `canopen` sets up a node, and which nodes it refuses."""

from typing import Any

import pytest

from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.can_bus.cia401 import objects as o
from piezod_drivers.can_bus.cia401.emulation.sdo_server import AbortCode, AbortError
from piezod_drivers.can_bus.cia401.emulator import NODE
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.cia401_stand import Stand, read
from tests.drivers.can_bus.profiles import CODES


def test_node_whose_mapping_is_fixed_is_used_as_it_is() -> None:
    """A fixed mapping is used, and its other channels are held."""
    stand = Stand((30.0, 60.0))

    def fixed(_index: int, _number: int, _value: int) -> None:
        raise AbortError(AbortCode.READ_ONLY)

    node: Any = stand.node
    node._check_mapping = fixed  # noqa: SLF001 - such a node
    device = stand.active(Wiring(("a2",), ("a2",)))

    assert device.exchange([1.0], stand.time.t_ns)[0]
    assert stand.rig.drive_v == pytest.approx([30.0, 15.0], abs=0.1)
    assert read(device, stand) == pytest.approx([0.6], abs=0.01)


def _with_fixed_pdos(stand: Stand, **types: int) -> None:
    """Make all parameters of both PDOs constant, as in a dictionary in read-only memory."""
    node: Any = stand.node
    allowed = node.set
    for index, kind in ((0x1401, types["rpdo"]), (0x1801, types["tpdo"])):
        allowed(index, 2, kind)

    def some(index: int, number: int, value: int) -> None:
        if index in {0x1401, 0x1601, 0x1801, 0x1A01}:
            raise AbortError(AbortCode.READ_ONLY)
        allowed(index, number, value)

    node.set = some


@pytest.mark.parametrize("rpdo", [254, 255])
def test_node_with_fixed_pdos_is_used_as_it_is(rpdo: int) -> None:
    """Constant PDOs with all channels are used if the outputs act on arrival."""
    stand = Stand((30.0, 60.0))
    _with_fixed_pdos(stand, rpdo=rpdo, tpdo=1)
    device = stand.active(Wiring(("a2",), ("a2",)))

    assert device.exchange([1.0], stand.time.t_ns)[0]
    assert stand.rig.drive_v == pytest.approx([30.0, 15.0], abs=0.1)
    assert read(device, stand) == pytest.approx([0.6], abs=0.01)


@pytest.mark.parametrize(
    ("types", "message"),
    [
        ({"rpdo": 255, "tpdo": 254}, "0x1801:2 .* fixed at 254, expected 1: set another"),
        ({"rpdo": 1, "tpdo": 1}, "0x1401:2 .* fixed at 1, expected 255: set another"),
    ],
)
def test_fixed_pdo_at_another_time_is_refused(types: dict[str, int], message: str) -> None:
    """A constant PDO that is not sent at each SYNC, or acts later, is refused with its type."""
    stand = Stand()
    _with_fixed_pdos(stand, **types)
    with pytest.raises(DeviceError, match=message):
        stand.active()


def test_fixed_pdo_without_the_channel_is_refused() -> None:
    """A constant PDO that lacks a channel is refused with a remedy."""
    stand = Stand()
    for number in range(1, 5):
        stand.node._values[0x1A01, number] = 0x6401_0310  # noqa: SLF001 - such a node
    _with_fixed_pdos(stand, rpdo=255, tpdo=1)
    with pytest.raises(DeviceError, match="fixed and lacks a channel: set another rpdo or tpdo"):
        stand.active()


def test_fixed_pdo_that_is_switched_off_is_refused() -> None:
    """A constant PDO that is switched off is not taken for one that is used."""
    stand = Stand()
    stand.node.set(0x1801, 1, 1 << 31 | 0x285)
    _with_fixed_pdos(stand, rpdo=255, tpdo=1)
    with pytest.raises(DeviceError, match="0x1801:1 cannot be set"):
        stand.active()


def test_node_of_another_profile_is_refused() -> None:
    """A node of another profile, such as a drive, is refused with its profile number."""
    stand = Stand()
    node: Any = stand.node
    value = node.value
    node.value = lambda i, n: 0x0002_0192 if i == o.DEVICE_TYPE else value(i, n)

    with pytest.raises(DeviceError, match="profile 402, expected 401"):
        stand.device.open()


def test_absent_node_is_reported_with_a_remedy() -> None:
    """If no node replies, the error names the node and possible causes."""
    stand = Stand()
    stand.bus.node = None

    with pytest.raises(DeviceUnavailableError, match=r"node 5 .* terminations"):
        stand.device.open()


def test_library_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the canopen library opening fails with the command to install it."""
    monkeypatch.setitem(__import__("sys").modules, "piezod_drivers.can_bus.cia401.sdo_client", None)
    monkeypatch.delattr("piezod_drivers.can_bus.cia401.sdo_client", raising=False)

    with pytest.raises(DeviceUnavailableError, match=r'pip install "piezod\[can\]"'):
        Stand().device.open()


def test_rate_follows_from_the_frames() -> None:
    """The highest rate is the rate at which the frames of a cycle fill the bus."""
    stand = Stand()
    stand.device.open()
    # 4 bytes twice, SYNC, and four SDO frames of 8 bytes
    bits = 2 * (47 + 32 + 16) + (47 + 8) + 4 * (47 + 64 + 24)

    assert stand.device.capabilities().max_rate_hz == pytest.approx(500_000 / bits, rel=0.02)


def _refusing(stand: Stand, *refused: tuple[int, int]) -> None:
    """Make the node refuse to write these objects."""
    node: Any = stand.node
    allowed = node.set

    def some(index: int, number: int, value: int) -> None:
        if (index, number) in refused:
            raise AbortError(AbortCode.UNSUPPORTED_ACCESS)
        allowed(index, number, value)

    node.set = some


def test_node_that_cannot_be_set_up_is_refused() -> None:
    """If a node refuses a required setting, activating fails and names the object."""
    stand = Stand()
    _refusing(stand, (0x1801, 2))
    with pytest.raises(DeviceError, match="0x1801:2 cannot be set"):
        stand.active()


def test_node_that_refuses_to_watch_is_not_used_with_safe_codes() -> None:
    """If a node refuses a requested watchdog, activating fails and names the remedy."""
    stand = Stand(outputs={"a1": {"number": 1, "safe_code": 0, **CODES}})
    _refusing(stand, (o.ERROR_MODE, 1))
    with pytest.raises(DeviceError, match="leave out safe_code"):
        stand.active()


def test_node_without_heartbeat_is_used_without() -> None:
    """A node without a configurable heartbeat works."""
    stand = Stand()
    _refusing(stand, (o.PRODUCER_HEARTBEAT, 0))
    device = stand.active()

    assert device.exchange([1.0, 1.0], stand.time.t_ns)[0]


@pytest.mark.parametrize("read_back", ["sdo", "pdo"])
def test_node_of_which_only_inputs_are_used_is_not_touched(read_back: str) -> None:
    """Reading inputs only writes no object and sends no NMT and no SYNC."""
    outputs = {"a1": {"number": 1, "safe_code": 0, **CODES}}
    stand = Stand((30.0, 60.0), outputs=outputs, read_back=read_back)
    device = stand.active(Wiring(("a2", "a1"), ()))
    assert not device.capabilities().watchdog
    assert read(device, stand) == pytest.approx([2.4, 1.2], abs=0.01)
    stand.rig.drive_v = [60.0, 60.0]
    assert read(device, stand) == pytest.approx([2.4, 2.4], abs=0.01)
    assert device.status(stand.time.t_ns) == [frozenset()] * 2
    stand.rig.valid = False
    read(device, stand)
    assert all(DeviceFlag.SATURATED in each for each in device.status(stand.time.t_ns))
    device.close()

    assert {frame.id for frame in stand.bus.sent} == {o.SDO_REQUEST + NODE}
    assert {frame.data[0] & 0xE0 for frame in stand.bus.sent} <= {0x40, 0x60}  # only uploads


def test_node_of_which_only_inputs_are_used_may_have_another_master() -> None:
    """SYNC and NMT of another master are not reported if only inputs are used."""
    stand = Stand()
    device = stand.active(Wiring(("a1",), ()))
    stand.bus.comes(Frame(o.SYNC), Frame(o.NMT, b"\x01\x05"))
    read(device, stand)

    assert device.status(stand.time.t_ns) == [frozenset()]


def test_node_of_sensors_is_set_up() -> None:
    """A node without outputs is read by process data, at the rate that these allow."""
    stand = Stand(outputs={})
    device = stand.active(Wiring(("a1",), ()))
    assert read(device, stand) == [0.0]

    assert o.SYNC in {frame.id for frame in stand.bus.sent}
