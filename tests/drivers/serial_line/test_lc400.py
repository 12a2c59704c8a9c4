"""nPoint's LC.400: frames, requests of the driver, and its use of the replies."""

from collections.abc import Callable
from contextlib import suppress
from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import Lc400FrameError, Lc400Register
from piezod_drivers.serial_line.npoint_lc400.dialogue import Lc400Dialogue
from piezod_drivers.serial_line.npoint_lc400.driver import PLUGIN
from piezod_drivers.serial_line.npoint_lc400.emulation.wavetables import MID_UM
from piezod_drivers.serial_line.npoint_lc400.emulator import Lc400
from piezod_drivers.serial_line.npoint_lc400.options import Lc400Options
from tests.drivers.serial_line.linear_rig import UM_PER_V, LinearRig, bench
from tests.drivers.serial_line.scripted_line import EmulatedLine

NOW = 5
BOTH = Wiring.both(("1", "2"))
SERVO_1 = codec.register_address(1, Lc400Register.SERVO)
POSITION_1 = codec.register_address(1, Lc400Register.POSITION)


def lc400(
    wiring: Wiring = BOTH, **options: object
) -> tuple[ExchangingBusDevice, EmulatedLine, LinearRig, Lc400]:
    """Return a controller, the line to it, and the rig behind the line."""
    stand, rig, time = bench(2)
    emulator = Lc400(stand, "")
    line = EmulatedLine(emulator, time)
    reading = Lc400Options.model_validate({"port": "p", **options})
    return ExchangingBusDevice("LC.400", Lc400Dialogue(reading, wiring, line)), line, rig, emulator


def test_frames_are_those_of_the_source() -> None:
    """Requests equal the structures of the EPICS module byte for byte."""
    assert codec.read(POSITION_1) == bytes.fromhex("a0 34138311 55")
    assert codec.write(codec.register_address(3, Lc400Register.SETPOINT), -2) == bytes.fromhex(
        "a2 18328311 feffffff 55"
    )
    assert codec.read_array(codec.FIRMWARE, 5) == bytes.fromhex("a4 28008311 05000000 55")


def test_voltages_and_positions_go_through() -> None:
    """Commands reach both actuators and are read back; positions are in µm."""
    device, _, rig, _ = lc400()
    device.open()
    device.activate(NOW)
    assert device.write([-20.0, 10.0], NOW)
    assert rig.drive_v == pytest.approx([45.0, 90.0], abs=1e-3)
    assert device.read_back(NOW) == pytest.approx([-20.0, 10.0], abs=1e-3)
    positions = [sample.position_um for sample in device.read(NOW)]
    assert positions == pytest.approx([45 * UM_PER_V - MID_UM, 90 * UM_PER_V - MID_UM], abs=1e-3)


def test_one_exchange_sets_and_reads_all_channels() -> None:
    """One write to the line sets and reads two channels."""
    device, line, rig, _ = lc400()
    device.open()
    device.activate(NOW)
    line.sent.clear()
    taken, samples = device.exchange([0.0, 0.0], NOW)
    assert taken
    assert len(samples) == len(line.sent[0:1]) + 1
    assert device.read_back(NOW) == pytest.approx([0.0, 0.0])
    device.read(NOW + 1)
    device.read_back(NOW + 1)
    assert len(line.sent) == 2
    assert rig.drive_v == pytest.approx([75.0, 75.0])


def test_taking_control_moves_nothing() -> None:
    """Opening, activating and closing write nothing."""
    device, line, rig, _ = lc400()
    before = list(rig.drive_v)
    device.open()
    device.activate(NOW)
    device.read_back(NOW)
    device.close()
    assert rig.drive_v == before
    assert not any(frame[0] == codec.Lc400Request.WRITE for frame in line.sent)


def test_servo_that_is_on_is_refused() -> None:
    """A channel in closed loop prevents activation, because its output would jump."""
    device, _, _, emulator = lc400()
    emulator.receive(codec.write(SERVO_1, 1))
    device.open()
    with pytest.raises(DeviceError, match="servo of channel 1 is on"):
        device.activate(NOW)


@pytest.mark.sees("npoint_lc400", "A8")
def test_servo_that_is_switched_on_is_reported() -> None:
    """A servo that is switched on later is reported for its output."""
    device, _, _, emulator = lc400()
    device.open()
    device.activate(NOW)
    emulator.receive(codec.write(SERVO_1, 1))
    device.read(NOW)
    assert [set(flags) for flags in device.status(NOW)] == [
        set(),
        set(),
        {DeviceFlag.LOCAL_MODE},
        set(),
    ]


@pytest.mark.sees("npoint_lc400", "A1")
def test_command_that_is_not_there_is_refused() -> None:
    """A write fails if the same exchange reads another command."""
    device, line, _, _ = lc400(Wiring.both(("1",)))
    device.open()
    device.activate(NOW)
    other = codec.read_reply(codec.register_address(1, Lc400Register.SETPOINT), 7)
    line.change = lambda reply: reply[:10] + other + reply[20:]
    assert not device.write([10.0], NOW)
    assert set(device.status(NOW)[1]) == {DeviceFlag.LOCAL_MODE}


@pytest.mark.sees("npoint_lc400", "S7")
def test_end_of_range_is_reported() -> None:
    """A position at the end of the range is invalid and reported as saturated."""
    device, _, rig, _ = lc400()
    device.open()
    device.activate(NOW)
    rig.valid = False
    assert all(isnan(sample.position_um) and not sample.valid for sample in device.read(NOW))
    assert DeviceFlag.SATURATED in device.status(NOW)[0]


def test_range_of_another_unit_has_to_be_set() -> None:
    """A range that is not in µm has to be configured; a configured range is not read."""
    device, _, _, emulator = lc400()
    emulator.receive(codec.write(codec.register_address(1, Lc400Register.RANGE_TYPE), 2))
    with pytest.raises(DeviceError, match="set range_um"):
        device.open()
    set_, _, _, emulator = lc400(range_um=60.0)
    emulator.receive(codec.write(codec.register_address(1, Lc400Register.RANGE_TYPE), 2))
    assert "60" in set_.open().serial


@pytest.mark.sees("npoint_lc400", "B3")
def test_flipped_bits_are_seen_where_they_can_be() -> None:
    """Of all single bits of an exchange, only 19 of a position go undetected."""
    unseen = []
    for bit in range(40 * 8):
        device, line, rig, _ = lc400(Wiring.both(("1",)))
        device.open()
        device.activate(NOW)
        rig.drive_v = [75.0, 0.0]

        def flip(reply: bytes, bit: int = bit) -> bytes:
            changed = bytearray(reply)
            changed[bit // 8] ^= 1 << bit % 8
            return bytes(changed)

        line.change = flip
        taken, (sample,) = device.exchange([0.0], NOW)
        reading = device.status(NOW)
        if taken and sample.valid and not any(reading):
            unseen.append(bit)
    position = range(3 * 80 + 40, 3 * 80 + 59)  # the highest of the 20 bits is the sign
    tag_word = range(40, 72)
    assert unseen == [*tag_word, *position]


DECODERS: list[Callable[[bytes], object]] = [
    codec.Poll([POSITION_1]).values,
    codec.parse_request,
    codec.text_of,
    codec.array_words,
    lambda got: codec.has_tag(got, 1),
]
LENGTHS = [
    codec.request_length,
    codec.Poll([POSITION_1]).length_of,
    codec.array_length(codec.FIRMWARE, codec.FIRMWARE_WORDS),
]


@given(st.binary(max_size=200))
def test_garbage_is_refused_by_the_documented_error(garbage: bytes) -> None:
    """Any bytes are decoded or refused by `Lc400FrameError`, and raise nothing else."""
    for decode in DECODERS:
        with suppress(Lc400FrameError):
            decode(garbage)


@given(st.binary(max_size=300))
def test_frames_are_found_within_what_has_come(garbage: bytes) -> None:
    """A frame is never longer than the bytes that have come, and few bytes are kept."""
    for length_of in LENGTHS:
        rest = garbage
        while length := length_of(rest):
            assert -len(rest) <= length <= len(rest)
            rest = rest[abs(length) :]
        assert len(rest) < 26


def test_plug_in_lists_channels_with_both_units() -> None:
    """Each channel has a position in µm and a command in %."""
    options = Lc400Options.model_validate({"port": "p", "axes": 2})
    assert PLUGIN.channels(options) == ({"1": "µm", "2": "µm"}, {"1": "%", "2": "%"})
    assert PLUGIN.create(options, BOTH, 1) is not None
