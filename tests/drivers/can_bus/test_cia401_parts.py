"""Parts of the driver `canopen`: codes, process data, health of a node, the emulated node."""

from math import isnan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.cia401 import objects as o
from piezod_drivers.can_bus.cia401.codec import Scale, pack, unpack
from piezod_drivers.can_bus.cia401.driver import PLUGIN
from piezod_drivers.can_bus.cia401.emulator import NODE, Cia401Node
from piezod_drivers.can_bus.cia401.health import NodeHealth, meaning_of
from piezod_drivers.can_bus.cia401.options import Cia401Options, channels
from piezod_drivers.can_bus.frame import Frame, max_frame_bits
from piezod_drivers.can_bus.options import BusOptions, make_bus, max_rate_hz
from piezod_drivers.can_bus.slcan_bus import SlcanBus
from tests.drivers.can_bus.profiles import CODES, canopen
from tests.drivers.serial_line.linear_rig import bench
from tests.drivers.serial_line.scripted_line import MS

CONVENTIONS = (
    ((-32_768, 32_767), (-10.0, 10.0)),
    ((0, 32_760), (0.0, 10.0)),  # left-adjusted, 12 bits
    ((0, 65_535), (0.0, 10.0)),
    ((2047, -2047), (-10.0, 10.0)),  # inverted
)


@given(st.sampled_from(CONVENTIONS), st.floats(0, 1))
def test_value_survives_as_a_code(
    convention: tuple[tuple[int, int], tuple[float, float]], part: float
) -> None:
    """Converted to a code and back, a value in range changes by at most half a step."""
    codes, (low, high) = convention
    scale = Scale(codes, (low, high))
    value = low + part * (high - low)
    step = (high - low) / abs(codes[1] - codes[0])

    assert scale.value_of(scale.word_of(value)) == pytest.approx(value, abs=step)


def test_ends_of_the_range_are_flagged_except_zero() -> None:
    """A converter is saturated at the ends of its range, except at an end of 0 V."""
    scale = Scale((0, 32_767), (0.0, 10.0))

    assert scale.read(32_767) == (10.0, True)
    assert scale.read(0) == (0.0, False)
    assert scale.read(1000) == (scale.value_of(1000), False)
    value, is_at_an_end = scale.read(0xFFFF)
    assert isnan(value)
    assert is_at_an_end, "-1 is below the range"


@given(st.lists(st.integers(0, 65_535), max_size=8))
def test_words_survive_as_process_data(words: list[int]) -> None:
    """Unpacked words are the packed words; data of another length is a fault."""
    assert unpack(pack(words), len(words)) == tuple(words)
    with pytest.raises(LineFault) as failure:
        unpack(pack(words), len(words) + 1)
    assert failure.value.flag == DeviceFlag.GARBAGE


@given(st.lists(st.tuples(st.booleans(), st.binary(max_size=8)), max_size=100))
def test_any_message_of_a_node_is_accepted(messages: list[tuple[bool, bytes]]) -> None:
    """Emergencies and heartbeats with any content never raise."""
    health = NodeHealth()
    for is_emergency, data in messages:
        (health.take_emergency if is_emergency else health.take_heartbeat)(data)
    assert all(isinstance(flag, DeviceFlag) for flag in health.flags)


@pytest.mark.parametrize("state", [o.PREOPERATIONAL, o.STOPPED])
def test_one_heartbeat_from_before_the_start_is_passed_over(state: int) -> None:
    """The state of the first heartbeat is ignored, because it may be old; the second counts."""
    health = NodeHealth()
    health.take_heartbeat(bytes((state,)))
    assert health.flags == frozenset()
    health.take_heartbeat(bytes((state,)))
    assert health.flags == {DeviceFlag.LOCAL_MODE}

    health.clear()
    health.take_heartbeat(bytes((o.BOOTED,)))
    assert health.flags == {DeviceFlag.RESTARTED}


@given(st.integers(0, 0xFFFF))
def test_every_error_code_means_something(code: int) -> None:
    """Every error code has a flag."""
    assert isinstance(meaning_of(code), DeviceFlag)


IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.sampled_from([o.NMT, o.SYNC, 0x600 + NODE, 0x300 + NODE, 0x77E]),
)


@given(st.lists(st.tuples(IDS, st.binary(max_size=8)), max_size=50))
def test_node_survives_any_frames(frames: list[tuple[int, bytes]]) -> None:
    """Frames with any content never make the emulated node raise."""
    on_bench, _, time = bench(1)
    node = Cia401Node(on_bench)
    for identifier, data in frames:
        time.t_ns += MS
        answers = [*node.receive(Frame(identifier, data)), *node.due()]
        assert all(len(answer.data) <= 8 and 0 <= answer.id < 0x800 for answer in answers)


def _sdo(node: Cia401Node, *data: int) -> bytes:
    (answer,) = node.receive(Frame(0x600 + NODE, bytes(data).ljust(8, b"\0")))
    assert answer.id == 0x580 + NODE
    return answer.data


def _node() -> Cia401Node:
    return Cia401Node(bench(1)[0])


def test_node_boots_up() -> None:
    """After power-up the node sends its boot-up message and ignores process data."""
    node = _node()

    assert node.due() == [Frame(0x700 + NODE, b"\0")]
    assert node.receive(Frame(o.SYNC)) == []
    assert node.due() == []


def test_node_beats() -> None:
    """With a producer heartbeat time the node sends its state at this period."""
    on_bench, _, time = bench(1)
    node = Cia401Node(on_bench)
    node.due()
    _sdo(node, 0x2B, 0x17, 0x10, 0, 100, 0)
    time.t_ns += 101 * MS

    assert node.due() == [Frame(0x700 + NODE, b"\x7f")]


def test_toggle_bit_has_to_alternate() -> None:
    """A text is read in segments, and a repeated toggle bit is refused."""
    node = _node()
    assert _sdo(node, 0x40, 0x08, 0x10, 0)[0] == 0x41
    assert _sdo(node, 0x60)[1:] == b"piezod "
    assert _sdo(node, 0x60)[4:] == (0x0503_0000).to_bytes(4, "little")


def test_unknown_command_is_refused() -> None:
    """A block transfer, which the node does not have, is refused as unknown."""
    assert _sdo(_node(), 0xA0)[4:] == (0x0504_0001).to_bytes(4, "little")


def test_short_process_data_raise_an_emergency() -> None:
    """Process data that are too short cause an emergency and are not used."""
    node = _node()
    node.due()
    node.receive(Frame(o.NMT, bytes((o.START, 0))))
    (answer,) = node.receive(Frame(0x300 + NODE, b"\0"))

    assert answer.id == 0x080 + NODE
    assert answer.data[:2] == b"\x10\x82"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"inputs": {}, "outputs": {}}, "at least one input or output"),
        ({"host_node": 5}, "must not be the number of the node"),
        ({"inputs": {f"a{i}": {"number": i, **CODES} for i in range(1, 6)}}, "4 channels"),
        ({"inputs": {"a": {**CODES, "number": 1, "code_at_min": 32_767}}}, "must differ"),
        ({"inputs": {"a": {**CODES, "number": 1, "code_at_max": 65_535}}}, "16 bits hold"),
        ({"inputs": {"a": {**CODES, "number": 1, "range": (1.0, 1.0)}}}, "must be above"),
        (
            {"bus": {"interface": "slcan", "channel": "x", "bit_rate": 33_000}},
            "slcan does not support",
        ),
        ({"node": 128}, "allowed range 1 to 127"),
    ],
)
def test_mistakes_are_reported(change: dict[str, Any], message: str) -> None:
    """Options that contradict each other are refused."""
    with pytest.raises(ValidationError, match=message):
        Cia401Options.model_validate(canopen("/dev/null", **change))


def test_plug_in_makes_the_device_without_opening_anything() -> None:
    """The plug-in names the configured channels; a device of both kinds exchanges."""
    options = Cia401Options.model_validate(canopen("/dev/null"))
    made: Any = PLUGIN.create(options, Wiring(("ai1",), ("ao1",)), 0)

    assert isinstance(made, ExchangingBusDevice)
    assert not isinstance(PLUGIN.create(options, Wiring(("ai1",), ()), 0), ExchangingBusDevice)
    assert channels(options)[:] == ({"ai1": "V"}, {"ao1": "V"})


def test_time_on_the_wire_is_that_of_the_standard() -> None:
    """A frame of eight bytes has 111 bits, 135 with stuffing; an extended one 131 and 160."""
    assert max_frame_bits(8) == 135
    assert max_frame_bits(0) == 55
    assert max_frame_bits(8, extended=True) == 160
    assert max_rate_hz(BusOptions(channel="can0"), [8, 8]) == pytest.approx(500_000 / 270)
    assert max_rate_hz(BusOptions(interface="virtual", channel="x"), [8]) == 20_000


def test_other_interfaces_of_python_can_are_passed_on() -> None:
    """Only slcan is our own; other interfaces are python-can's, with the bit rate if needed."""
    assert isinstance(make_bus(BusOptions(interface="slcan", channel="/dev/x")), SlcanBus)
    assert make_bus(BusOptions(interface="pcan", channel="PCAN_USBBUS1")).where.startswith("pcan")
