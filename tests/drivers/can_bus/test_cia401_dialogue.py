"""The driver `canopen` with an emulated node, in virtual time."""

import pytest

from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects as o
from piezod_drivers.can_bus.cia401.emulator import CODES_PER_V, NODE
from piezod_drivers.can_bus.frame import Frame
from tests.drivers.can_bus.cia401_stand import Stand, read, without
from tests.drivers.can_bus.profiles import CODES
from tests.drivers.serial_line.scripted_line import MS

STEP_V = 1 / CODES_PER_V


def test_node_reports_its_identity() -> None:
    """Opening reads the identity, changes nothing and accepts only frames of this node."""
    stand = Stand((30.0, 60.0))
    identity = stand.device.open()

    assert identity.model == "piezod canopen-401"
    assert stand.rig.drive_v == [30.0, 60.0]
    assert not [frame for frame in stand.bus.sent if frame.id in {o.NMT, o.SYNC}]
    assert {0x285, 0x585, 0x705, 0x085} <= set(stand.bus.opened_for)


@pytest.mark.parametrize("read_back", ["sdo", "pdo", "none"])
def test_one_exchange_drives_and_reads(read_back: str) -> None:
    """One exchange sets the outputs, reads the inputs and reads the outputs back."""
    stand = Stand(read_back=read_back)
    device = stand.active()
    taken, samples = device.exchange([1.0, 2.0], stand.time.t_ns)

    assert taken
    assert stand.rig.drive_v == pytest.approx([15.0, 30.0], abs=15 * STEP_V)
    assert [sample.position_um for sample in samples] == pytest.approx([0.6, 1.2], abs=2 * STEP_V)
    assert device.read_back(stand.time.t_ns) == pytest.approx([1.0, 2.0], abs=STEP_V)
    assert device.capabilities().read_back is (read_back != "none")
    assert stand.flags() == frozenset()


def test_cycle_is_three_frames() -> None:
    """With read-back in the process data, a cycle sends only process data and SYNC."""
    stand = Stand(read_back="pdo")
    device = stand.active()
    stand.bus.sent.clear()
    now_ns = stand.time.t_ns
    device.exchange([1.0, 2.0], now_ns)
    device.read_back(now_ns)

    assert [frame.id for frame in stand.bus.sent] == [0x300 + NODE, o.SYNC]


def test_activating_moves_nothing() -> None:
    """Activating and deactivating leave the outputs at their values."""
    stand = Stand((30.0, 60.0))
    device = stand.active()
    read(device, stand)
    assert stand.rig.drive_v == [30.0, 60.0]

    device.exchange([1.0, 1.0], stand.time.t_ns)
    device.close()
    stand.passes(1000, lambda: stand.bus.receive(0))
    assert stand.rig.drive_v == pytest.approx([15.0, 15.0], abs=15 * STEP_V)


@pytest.mark.parametrize(
    "wiring", [Wiring(("a2",), ()), Wiring((), ("a2",)), Wiring(("a1",), ("a2",))]
)
def test_channels_that_no_axis_uses_are_left_alone(wiring: Wiring) -> None:
    """A device with one channel reads and drives only that channel."""
    stand = Stand((30.0, 60.0))
    device = stand.active(wiring)
    if wiring.inputs:
        assert len(read(device, stand)) == 1
    if wiring.outputs:
        assert device.write([1.0], stand.time.t_ns)
        assert stand.rig.drive_v == pytest.approx([30.0, 15.0], abs=15 * STEP_V)


def test_outputs_without_read_back_need_a_heartbeat() -> None:
    """A node without reply and read-back confirms outputs by its heartbeat."""
    stand = Stand(read_back="none")
    device = stand.active(Wiring((), ("a1",)))
    stand.passes(1000, lambda: device.write([1.0], stand.time.t_ns))
    assert device.write([1.0], stand.time.t_ns)

    stand.bus.change = lambda _frame: []
    stand.passes(500, lambda: device.write([1.0], stand.time.t_ns))
    assert not device.write([1.0], stand.time.t_ns)


def test_output_that_keeps_its_old_value_is_reported() -> None:
    """A node without used inputs has its outputs read back and compared at once."""
    stand = Stand()
    device = stand.active(Wiring((), ("a1",)))
    assert device.write([1.0], stand.time.t_ns)

    stand.bus.change = lambda frame: [frame._replace(data=frame.data[:4] + bytes(4))]
    assert not device.write([1.0], stand.time.t_ns)
    assert DeviceFlag.DEVICE_FAILURE in frozenset().union(*device.status(stand.time.t_ns))


@pytest.mark.sees("canopen", "A9")
def test_silent_host_makes_the_node_safe() -> None:
    """When this host stops, the node sets its safe code, and the status reports it.

    After the device is opened again it works as before.
    """
    two = {f"a{i}": {"number": i, "safe_code": 3277 * (i - 1), **CODES} for i in (1, 2)}
    stand = Stand(outputs=two)
    device = stand.active()
    assert device.capabilities().watchdog
    stand.passes(1000)
    assert read(device, stand), "the watchdog starts with the first setpoint"
    device.exchange([5.0, 5.0], stand.time.t_ns)
    stand.passes(1000, lambda: device.exchange([5.0, 5.0], stand.time.t_ns))
    assert stand.rig.drive_v == pytest.approx([75.0, 75.0], abs=0.1)

    stand.passes(300, stand.node.due)
    stand.passes(300, lambda: stand.bus.receive(0))
    assert stand.rig.drive_v == pytest.approx([0.0, 15.0], abs=0.1)


@pytest.mark.sees("canopen", "A9")
@pytest.mark.sees("canopen", "A8")
def test_tripped_watchdog_is_reported_and_reset() -> None:
    """The emergency of a tripped watchdog is reported, and the node is set up again."""
    stand = Stand(outputs={"a1": {"number": 1, "safe_code": 0, **CODES}})
    stand.device = device = stand.active(Wiring(("a1",), ("a1",)))
    device.exchange([5.0], stand.time.t_ns)
    stand.time.t_ns += 300 * MS
    stand.bus.comes(*stand.node.due())
    assert not device.exchange([5.0], stand.time.t_ns)[0]
    assert DeviceFlag.WATCHDOG_TRIPPED in stand.flags()

    assert not device.exchange([5.0], stand.time.t_ns)[0]
    assert DeviceFlag.DISCONNECTED in stand.flags()
    device.close()
    stand.active(Wiring(("a1",), ("a1",)))


def test_watchdog_is_disarmed_in_the_end() -> None:
    """A deactivated node expects no heartbeat any more and holds its outputs."""
    stand = Stand(outputs={"a1": {"number": 1, "safe_code": 0, **CODES}})
    device = stand.active(Wiring(("a1",), ("a1",)))
    device.exchange([5.0], stand.time.t_ns)
    device.deactivate(stand.time.t_ns)
    stand.passes(1000, lambda: stand.bus.receive(0))

    assert stand.rig.drive_v[0] == pytest.approx(75.0, abs=0.1)


WATCHED = {"a1": {"number": 1, "safe_code": 0, **CODES}}
ONE = Wiring(("a1",), ("a1",))


def test_watchdog_is_armed_again_after_a_crash() -> None:
    """A node that still supervises this host, because it was not disarmed, is armed again."""
    stand = Stand(outputs=WATCHED)
    assert stand.active(ONE).exchange([5.0], stand.time.t_ns)[0]
    stand.passes(300, lambda: stand.bus.receive(0))
    assert stand.rig.drive_v[0] == pytest.approx(0.0, abs=0.1), "the host has crashed"

    device = stand.active(ONE)
    assert device.exchange([5.0], stand.time.t_ns)[0]
    stand.passes(300, lambda: stand.bus.receive(0))
    assert stand.rig.drive_v[0] == pytest.approx(0.0, abs=0.1), "the watchdog has tripped again"


def test_watchdog_is_armed_again_after_an_orderly_end() -> None:
    """A node that was disarmed is armed again, and its watchdog trips."""
    stand = Stand(outputs=WATCHED)
    for _ in range(2):
        device = stand.active(ONE)
        device.exchange([5.0], stand.time.t_ns)
        device.close()
        stand.passes(1000, lambda: stand.bus.receive(0))
        assert stand.rig.drive_v[0] == pytest.approx(75.0, abs=0.1)

    stand.active(ONE).exchange([5.0], stand.time.t_ns)
    stand.passes(300, lambda: stand.bus.receive(0))
    assert stand.rig.drive_v[0] == pytest.approx(0.0, abs=0.1)


@pytest.mark.parametrize("entry", [3 << 16 | 500, 3 << 16, 500])
def test_node_that_supervised_another_host_supervises_this_one(entry: int) -> None:
    """The entry of another host, with or without a time, is stopped before this host's is set."""
    stand = Stand(outputs=WATCHED)
    stand.node.set(o.CONSUMER_HEARTBEAT, 1, entry)
    device = stand.active(ONE)
    device.exchange([5.0], stand.time.t_ns)
    stand.passes(300, lambda: stand.bus.receive(0))

    assert stand.rig.drive_v[0] == pytest.approx(0.0, abs=0.1)
    assert stand.node.value(o.CONSUMER_HEARTBEAT, 1) == 126 << 16 | 200


def test_late_answer_is_none_to_what_is_asked_in_the_end() -> None:
    """A late reply from the loop does not disturb the disarming of the watchdog."""
    stand = Stand(outputs={"a1": {"number": 1, "safe_code": 0, **CODES}})
    device = stand.active(Wiring(("a1",), ("a1",)))
    device.exchange([5.0], stand.time.t_ns)
    stand.bus.comes(Frame(0x580 + NODE, bytes((0x4B, 0x11, 0x64, 1, 0, 0, 0, 0))))
    stand.device = device
    device.deactivate(stand.time.t_ns)

    assert stand.flags() == frozenset()


def test_node_without_watchdog_is_reported() -> None:
    """A node without consumer heartbeat makes a device without watchdog that works."""
    stand = Stand(outputs={"a1": {"number": 1, "safe_code": 0, **CODES}})
    without(stand, {o.CONSUMER_HEARTBEAT})
    device = stand.active(Wiring(("a1",), ("a1",)))

    assert not device.capabilities().watchdog
    assert device.exchange([1.0], stand.time.t_ns)[0]


EMERGENCIES = (
    ("A4", 0x2310, DeviceFlag.OVERLOAD),
    ("A11", 0x2320, DeviceFlag.SHORT_OR_OPEN),
    ("A11", 0x2330, DeviceFlag.SHORT_OR_OPEN),
    ("A13", 0x4200, DeviceFlag.OVER_TEMPERATURE),
    ("B10", 0x8210, DeviceFlag.WRONG_REQUEST),
    ("B10", 0x5000, DeviceFlag.DEVICE_FAILURE),
    ("B8", 0x8140, DeviceFlag.BUS_OFF),
    ("B9", 0x8120, DeviceFlag.NOT_SENT),
)


@pytest.mark.parametrize(
    ("code", "flag"),
    [
        pytest.param(code, flag, marks=pytest.mark.sees("canopen", each), id=f"{code:04X}")
        for each, code, flag in EMERGENCIES
    ],
)
def test_emergency_is_reported_until_it_is_over(code: int, flag: DeviceFlag) -> None:
    """An emergency sets a flag of all channels until the node reports that no error is left."""
    stand = Stand()
    device = stand.active()
    stand.node.emergency(code, 1)
    for _ in range(3):
        read(device, stand)
        assert flag in stand.flags()

    stand.node.emergency(0x0000, 1)
    read(device, stand)
    assert flag in stand.flags(), "one error is over, and others are left"
    stand.node.emergency(0x0000, 0)
    read(device, stand)
    assert stand.flags() == frozenset()


@pytest.mark.sees("canopen", "A7")
def test_restarted_node_is_reported() -> None:
    """A restart is reported for the outputs, loses the device, and it can be opened again."""
    stand = Stand()
    device = stand.active()
    device.exchange([1.0, 1.0], stand.time.t_ns)
    stand.node.receive(Frame(o.NMT, bytes((o.RESET, NODE))))
    stand.bus.comes(Frame(o.HEARTBEAT + NODE, bytes((o.BOOTED,))))
    read(device, stand)
    reported = device.status(stand.time.t_ns)
    assert [DeviceFlag.RESTARTED in each for each in reported] == [False, False, True, True]

    read(device, stand)
    assert DeviceFlag.DISCONNECTED in stand.flags()
    device.close()
    stand.active()
    assert device.exchange([1.0, 1.0], stand.time.t_ns)[0]


@pytest.mark.sees("canopen", "A8")
def test_stopped_node_is_reported() -> None:
    """The heartbeat of a node that is no longer operational sets the flag for local mode."""
    stand = Stand()
    device = stand.active()
    stand.node.receive(Frame(o.NMT, bytes((o.STOP, NODE))))
    stand.passes(200, lambda: device.write([1.0, 1.0], stand.time.t_ns))

    assert not device.write([1.0, 1.0], stand.time.t_ns)
    assert DeviceFlag.LOCAL_MODE in stand.flags()


@pytest.mark.sees("canopen", "B12")
def test_second_master_is_reported() -> None:
    """SYNC, NMT and process data for the outputs from another master are reported."""
    for foreign in (Frame(o.SYNC), Frame(o.NMT, b"\x01\x05"), Frame(0x305, bytes(4))):
        stand = Stand()
        device = stand.active()
        stand.bus.comes(foreign)
        read(device, stand)

        assert DeviceFlag.FOREIGN_FRAME in stand.flags()


@pytest.mark.sees("canopen", "S7")
def test_input_at_its_end_is_reported() -> None:
    """An input at the end of its converter's range is reported as saturated, and no other."""
    stand = Stand()
    device = stand.active()
    stand.rig.valid = False
    device.read(stand.time.t_ns)
    reported = device.status(stand.time.t_ns)

    assert [DeviceFlag.SATURATED in each for each in reported] == [True, True, False, False]


@pytest.mark.sees("canopen", "B10")
def test_output_that_cannot_be_read_back_is_reported() -> None:
    """A node that refuses an output's read-back in the loop makes a configuration fault."""
    stand = Stand()
    device = stand.active()
    without(stand, {o.OUTPUT})

    assert device.read_back(stand.time.t_ns)[0] != 0.0
    assert DeviceFlag.WRONG_REQUEST in stand.flags()


def _asked_for(frame: Frame) -> list[Frame]:
    """Return a frame after a remote frame of its identifier and a frame with 29 bits of it."""
    n_bytes = len(frame.data)
    remote = frame._replace(data=bytes(n_bytes), remote=True)
    longer = frame._replace(data=frame.data[:4].ljust(n_bytes, b"\0"), extended=True)
    return [remote, longer, frame]


@pytest.mark.sees("canopen", "B6")
@pytest.mark.parametrize("read_back", ["sdo", "pdo"])
def test_frame_that_asks_is_no_answer(read_back: str) -> None:
    """Remote frames and frames with longer identifiers are no reply to any request."""
    stand = Stand((30.0, 60.0), read_back=read_back)
    stand.bus.change = _asked_for
    device = stand.active()
    samples = device.read(stand.time.t_ns)

    assert [sample.position_um for sample in samples] == pytest.approx([1.2, 2.4], abs=0.01)
    assert DeviceFlag.OUT_OF_ORDER in stand.flags()
    assert device.read_back(stand.time.t_ns) == pytest.approx([2.0, 4.0], abs=STEP_V)


@pytest.mark.sees("canopen", "B3")
def test_process_data_of_another_length_are_garbage() -> None:
    """Process data with another length than the mapping are not used."""
    stand = Stand()
    device = stand.active()
    stand.bus.change = lambda frame: [frame._replace(data=frame.data[:1])]

    assert not any(sample.valid for sample in device.read(stand.time.t_ns))
    assert DeviceFlag.GARBAGE in stand.flags()
