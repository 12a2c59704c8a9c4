"""The emulated wavetables and recorder of an LC.400 against public facts."""

import pytest

from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import Lc400Register
from piezod_drivers.serial_line.npoint_lc400.emulator import Lc400
from tests.drivers.serial_line.linear_rig import bench

CLOCK_NS = 24_000


@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="addresses of wavetables and recorder, sizes, clock",
    by="matlab-npoint-lc400 (LC400.m); PiezoNpoint.m, which quotes the manual",
    kind="manual",
)
def test_addresses_of_the_public_sources() -> None:
    """Registers of a channel, tables and buffers; the last of 100 points is at 0xC000018C."""
    offsets = {
        Lc400Register.WAVE_ENABLE: 0x1F4,
        Lc400Register.WAVE_INDEX: 0x1F8,
        Lc400Register.WAVE_DELAY: 0x200,
        Lc400Register.WAVE_LAST: 0x204,
        Lc400Register.WAVE_ACTIVE: 0x208,
        Lc400Register.INVERSE_SCALE: 0x230,
        Lc400Register.LOOP_INPUT: 0x404,
    }
    for channel in (1, 2, 3):
        for register, offset in offsets.items():
            assert codec.register_address(channel, register) == 0x11830000 + 4096 * channel + offset
    tables = [codec.wave_address(channel) for channel in (1, 2, 3)]
    assert tables == [0xC0000000, 0xC0054000, 0xC00A8000]
    assert codec.wave_address(1) + 4 * 99 == 0xC000018C
    assert [codec.record_pointer(k) for k in range(8)] == [0x1183037C + 4 * k for k in range(8)]
    buffers = [codec.record_buffer(k) for k in range(8)]
    assert buffers[:4] == [0xC03F0000, 0xC0444000, 0xC0498000, 0xC04EC000]
    assert buffers[4:] == [0xC0540000, 0xC0594000, 0xC05E8000, 0xC063C000]
    assert (codec.RECORD_COUNT, codec.RECORD_START) == (0x1183036C, 0x11830374)
    assert codec.RECORD_DIVISOR == 0x118300F4
    assert (codec.CLOCK_NS, codec.WAVE_POINTS) == (CLOCK_NS, 83_333)
    assert codec.HALF_SCALE == 524_287


def send(controller: Lc400, *frames: str) -> bytes:
    """Send frames in one write; return the reply."""
    return b"".join(controller.receive(bytes.fromhex("".join(frames))))


@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="sequence of a play of two wavetables with a record",
    by="matlab-npoint-lc400 (setWavetable, setTwoWavetablesActive, recordRaw)",
    kind="manual",
)
def test_frames_of_the_matlab_class() -> None:
    """Its frames write, start and record two wavetables, which are repeated until they are stopped.

    It writes a table by one A2 and further A3, sets the end index, starts both channels in one
    write, and records command and sensor of both.
    """
    table, rig, time = bench(2)
    controller = Lc400(table, "")
    send(controller, "a2 18128311 00000000 55", "a2 18228311 00000000 55")  # commands
    # Tables: 0, 10000, 20000 counts, and 0, -10000, -20000.
    send(controller, "a2 000000c0 00000000 55", "a3 10270000 55", "a3 204e0000 55")
    send(controller, "a2 004005c0 00000000 55", "a3 f0d8ffff 55", "a3 e0b1ffff 55")
    for channel in "12":
        send(controller, f"a2 04{channel}28311 02000000 55", f"a2 f4{channel}18311 01000000 55")
        send(controller, f"a2 f8{channel}18311 00000000 55")
    send(controller, "a2 6c038311 08000000 55", "a2 f4008311 01000000 55")
    send(controller, "a2 7c038311 04148311 55", "a2 80038311 34138311 55")
    send(controller, "a2 84038311 04248311 55", "a2 88038311 34238311 55")
    send(
        controller,
        *("a2 08128311 01000000 55", "a2 08228311 01000000 55", "a2 74038311 01000000 55"),
    )
    assert send(controller, "a0 74038311 55") == bytes.fromhex("a0 74038311 01000000 55")
    time.t_ns += 10 * CLOCK_NS
    assert send(controller, "a0 74038311 55") == bytes.fromhex("a0 74038311 00000000 55")

    def words(frame: str) -> tuple[int, ...]:
        return codec.array_words(send(controller, frame))

    commands = [words("a4 00003fc0 08000000 55"), words("a4 008049c0 08000000 55")]
    assert commands[0] == (0, 10_000, 20_000, 0, 10_000, 20_000, 0, 10_000)
    assert commands[1] == tuple(-each for each in commands[0])
    sensors = words("a4 004044c0 08000000 55")
    # A sensor precedes the point of its cycle.
    assert sensors[2] - sensors[1] == sensors[3] - sensors[2] > 0
    assert sensors[4] == sensors[1]
    assert len({tuple(v) for v in rig.driven_v}) >= 3
    send(controller, "a2 08128311 00000000 55", "a2 08228311 00000000 55")
    driven = len(rig.driven_v)
    time.t_ns += 10 * CLOCK_NS
    controller.due()
    assert len(rig.driven_v) == driven


@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="cycle delay, end index",
    by="the manual, as quoted in PiezoNpoint.m",
    kind="manual",
)
def test_a_cycle_delay_of_1_doubles_the_period() -> None:
    """With a delay of d clock cycles a point lasts 1 + d of them."""
    for delay, expected in ((0, 12), (1, 6), (2, 4)):
        table, rig, time = bench()
        controller = Lc400(table, "")
        send(controller, "a2 000000c0 00000000 55", "a3 10270000 55", "a2 04128311 01000000 55")
        send(controller, f"a2 00128311 0{delay}000000 55", "a2 f4118311 01000000 55")
        rig.driven_v.clear()
        send(controller, "a2 08128311 01000000 55")
        time.t_ns += 12 * CLOCK_NS - 1
        controller.due()
        assert len(rig.driven_v) == expected


@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="a read sets the place of the next A3",
    by="the manual, as quoted in PiezoNpoint.m",
    kind="manual",
)
def test_a_read_between_sets_the_place_of_the_next_word() -> None:
    """So no read may come between the frames that write a wavetable."""
    table, _, _ = bench()
    controller = Lc400(table, "")
    send(controller, "a2 000000c0 01000000 55", "a0 001000c0 55", "a3 02000000 55")

    def words(frame: str) -> tuple[int, ...]:
        return codec.array_words(send(controller, frame))

    assert words("a4 000000c0 02000000 55") == (1, 0)
    assert words("a4 001000c0 02000000 55") == (0, 2)


@pytest.mark.parametrize(
    ("frame", "channel", "counts"),
    [
        ("a0341383110401000055", 1, 260),
        ("a03413831112ffffff55", 1, -238),
        ("a034238311f003000055", 2, 1008),
        ("a034238311cd03000055", 2, 973),
    ],
)
@pytest.mark.confirms(
    "npoint_lc400",
    "lc400",
    part="frame of a reply, address and value of a sensor",
    by="frames of a controller at a beamline, in pystxmcontrol (test_npt_read_framing.py)",
    kind="capture",
)
def test_frames_of_a_beamline(frame: str, channel: int, counts: int) -> None:
    """A reply has the command, the address, the value and the end."""
    address = codec.register_address(channel, Lc400Register.POSITION)
    assert codec.read_reply(address, counts) == bytes.fromhex(frame)
    poll = codec.Poll([address])
    got = codec.read_reply(codec.tag_address(7), 0) + bytes.fromhex(frame)
    assert poll.length_of(got) == len(got)
    assert poll.values(got) == (counts,)
