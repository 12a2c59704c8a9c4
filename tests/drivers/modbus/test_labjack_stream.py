"""The emulated stream of LabJacks against public facts and a program by others."""

import json
from pathlib import Path
from struct import pack, unpack

import numpy as np
import pytest

from piezod_drivers.modbus.profiles import labjack_stream as registers
from piezod_drivers.modbus.profiles.labjack_stream import InputScale
from piezod_drivers.modbus.stream_arrays import volts_of
from tests.drivers.modbus.stream_client import AIN0, DAC0, OUT0, Client
from tests.drivers.serial_line.scripted_line import MS

CAPTURE = Path(__file__).with_name("labjack_stream_requests.json")


STREAM_MAP = {
    # name in the map: our constant, address
    "STREAM_SCANRATE_HZ": (registers.SCAN_RATE_HZ, 4002),
    "STREAM_NUM_ADDRESSES": (registers.N_ADDRESSES, 4004),
    "STREAM_SAMPLES_PER_PACKET": (registers.SAMPLES_PER_PACKET, 4006),
    "STREAM_SETTLING_US": (registers.SETTLING_US, 4008),
    "STREAM_RESOLUTION_INDEX": (registers.RESOLUTION_INDEX, 4010),
    "STREAM_BUFFER_SIZE_BYTES": (registers.BUFFER_BYTES, 4012),
    "STREAM_CLOCK_SOURCE": (registers.CLOCK_SOURCE, 4014),
    "STREAM_AUTO_TARGET": (registers.AUTO_TARGET, 4016),
    "STREAM_NUM_SCANS": (registers.N_SCANS, 4020),
    "STREAM_TRIGGER_INDEX": (registers.TRIGGER_INDEX, 4024),
    "STREAM_OUT0_TARGET": (registers.OUT_TARGET, 4040),
    "STREAM_OUT0_BUFFER_ALLOCATE_NUM_BYTES": (registers.OUT_BYTES, 4050),
    "STREAM_OUT0_LOOP_NUM_VALUES": (registers.OUT_LOOP_VALUES, 4060),
    "STREAM_OUT0_SET_LOOP": (registers.OUT_SET_LOOP, 4070),
    "STREAM_OUT0_BUFFER_STATUS": (registers.OUT_FREE_BYTES, 4080),
    "STREAM_OUT0_ENABLE": (registers.OUT_ENABLE, 4090),
    "STREAM_SCANLIST_ADDRESS0": (registers.SCAN_LIST, 4100),
    "STREAM_OUT0_BUFFER_F32": (registers.OUT_VALUES, 4400),
    "STREAM_OUT0": (registers.OUT_IN_SCAN, 4800),
    "STREAM_DEBUG_GET_SELF_INDEX": (registers.SELF_INDEX, 4898),
    "STREAM_ENABLE": (registers.ENABLE, 4990),
    "AIN0_RANGE": (registers.AIN_RANGE, 40_000),
    "LAST_ERR_DETAIL": (registers.LAST_ERROR, 55_000),
    "INTERNAL_FLASH_READ_POINTER": (registers.FLASH_POINTER, 61_810),
    "INTERNAL_FLASH_READ": (registers.FLASH_READ, 61_812),
}


@pytest.mark.confirms(
    "modbus",
    "labjack-t7",
    part="set-up of a stream, header and numbers of its packets",
    by="BlastTNG/flight's program for LabJacks, over libmodbus",
    kind="client",
)
def test_program_of_a_balloon_flight_starts_a_stream() -> None:
    """Every request is accepted, but for the stop of a stream that is not running: 2620."""
    client = Client()
    requests = [bytes.fromhex(each) for each in json.loads(CAPTURE.read_text())["requests"]]
    replies = [client.server.receive(request)[0] for request in requests[:-1]]
    refused = [i for i, reply in enumerate(replies) if reply[7] & 0x80]
    assert [unpack(">H", requests[i][8:10]) for i in refused] == [(registers.ENABLE,)]
    assert replies[refused[0] + 1][9:11] == (2620).to_bytes(2, "big")
    client.wait(100 * MS)
    # Its own checks: number, type 16, function 76, length of 14 samples, status 0.
    packets = client.packets()
    assert [each.number for each in packets] == list(range(20))
    assert {(len(each.samples), each.status) for each in packets} == {(28, 0)}
    assert client.server.receive(requests[-1])[0][7] == 16


@pytest.mark.confirms(
    "modbus",
    ("labjack-t4", "labjack-t7", "labjack-t8"),
    part="registers and statuses of the stream",
    by="LabJack's ljm_constants 2025.12.18.A",
    kind="manual",
)
def test_stream_has_the_registers_of_the_map() -> None:
    """The numbers are those of LabJack's list of registers and errors."""
    assert {name for name, (ours, theirs) in STREAM_MAP.items() if ours != theirs} == set()
    assert (registers.RECOVERING, registers.RECOVERED, registers.OVERLAP) == (2940, 2941, 2942)
    assert (registers.SKIPPED_TOO_MANY, registers.COMPLETE, registers.FULL) == (2943, 2944, 2945)


@pytest.mark.confirms(
    "modbus",
    "labjack-t7",
    part="scale of the samples of a stream",
    by="values of the crate async_labjack 0.1.0",
    kind="manual",
)
@pytest.mark.parametrize(
    ("part", "code", "low_v", "high_v"),
    [
        (1.0, 65_534, 10.1, 10.2),
        (1.0, 1, -10.6, -10.5),
        (1.0, 32_768, -0.3, 0.0),
        (0.1, 65_534, 1.01, 1.02),
        (0.1, 32_768, -0.03, -0.02),
    ],
)
def test_scale_of_a_t7(part: float, code: int, low_v: float, high_v: float) -> None:
    """Codes become the voltages of the crate's tests, with its nominal constants."""
    constants = (0.000315805780 * part, -0.000315805800 * part, 33_523.0, 0.0)
    scale = registers.input_scale(constants)
    (value,) = volts_of(np.array([[code]], np.uint16), [scale])[0]
    assert low_v <= value <= high_v


@pytest.mark.confirms(
    "modbus",
    "labjack-t4",
    part="scale of the samples of a stream",
    by="values of the crate async_labjack 0.1.0",
    kind="manual",
)
@pytest.mark.parametrize(("code", "low_v", "high_v"), [(65_534, 10.6, 10.7), (1, -10.6, -10.5)])
def test_scale_of_a_t4(code: int, low_v: float, high_v: float) -> None:
    """A T4 has a slope and an offset."""
    scale = registers.input_scale((0.0003235316, -10.532965))
    (value,) = volts_of(np.array([[code]], np.uint16), [scale])[0]
    assert low_v <= value <= high_v


def test_codes_at_an_end_are_no_voltage() -> None:
    """A saturated converter, and a lost scan, give NaN."""
    found = volts_of(np.array([[0], [0xFFFF], [5]], np.uint16), [InputScale(0.0, 1.0, 1.0)])
    assert np.isnan(found[:2]).all()
    assert found[2] == 5.0


def test_values_need_an_enabled_stream_out() -> None:
    """Loop, values and their use are refused with 2627 before a stream-out is enabled."""
    client = Client()
    client.write(4040, DAC0)
    assert client.write(4090, 1) == 2617  # no size yet
    client.write(4050, 64)
    assert [client.write(each, 1) for each in (4060, 4070)] == [2627, 2627]
    assert client.write(4400, 1.0, kind="f") == 2627
    assert client.write(4090, 1) == 0
    assert client.write(4400, 1.0, kind="f") == 0


@pytest.mark.parametrize(("n_bytes", "error"), [(31, 2615), (48, 2615), (32_768, 2609), (32, 0)])
def test_sizes_of_a_buffer(n_bytes: int, error: int) -> None:
    """A buffer is a power of 2 of 32 to 16384 bytes."""
    assert Client().write(4050, n_bytes) == error


def test_a_buffer_holds_one_value_less_than_its_size() -> None:
    """Of 64 bytes, 31 values can be used; what does not fit is discarded with 2613."""
    client = Client()
    for address, number in ((4040, DAC0), (4050, 64), (4090, 1)):
        client.write(address, number)
    assert client.read(4080) == 62
    assert client.write(4400, *[1.0] * 31, kind="f") == 0
    assert client.read(4080) == 0
    assert client.write(4400, 1.0, kind="f") == 2613
    assert client.write(4060, 32) == 2622


def test_the_last_values_are_repeated() -> None:
    """The first values are played once, then as many of the last ones as the loop has."""
    client = Client()
    client.load([0.0, 1.0, 2.0, 3.0], 2)
    assert client.stream(OUT0, scans=8) == 0
    client.wait(8 * MS)
    assert client.played_v() == pytest.approx([0, 1, 2, 3, 2, 3, 2, 3], abs=1e-2)
    assert client.read(4990) == 0
    client.wait(50 * MS)
    assert len(client.rig.driven_v) == 8
    assert client.read(DAC0, "f") == pytest.approx(3.0, abs=1e-3)


def test_a_stopped_stream_out_goes_on_in_mid_table() -> None:
    """A second stream begins behind the last value of the first one; enabling anew resets that."""
    client = Client()
    client.load([0.0, 1.0, 2.0, 3.0], 4)
    client.stream(OUT0, scans=2)
    client.wait(5 * MS)
    client.stream(OUT0, scans=1)
    client.wait(5 * MS)
    assert client.played_v() == pytest.approx([0, 1, 2], abs=1e-2)
    client.load([0.0, 1.0, 2.0, 3.0], 4)
    client.stream(OUT0, scans=1)
    client.wait(5 * MS)
    assert client.played_v()[-1] == 0.0


def test_new_values_are_used_at_once() -> None:
    """New values need room beside the loop in use, so half of the buffer can be replaced."""
    client = Client()
    client.load([1.0] * 15, 15, n_bytes=64)
    client.stream(OUT0)
    client.wait(5 * MS)
    assert client.read(4080) == 32
    assert client.write(4060, 2) == 0
    assert client.write(4400, 2.0, 3.0, kind="f") == 0
    client.wait(1 * MS)
    assert client.played_v()[-1] == pytest.approx(1.0, abs=1e-2)
    assert client.write(4070, 1) == 0
    client.wait(3 * MS)
    assert client.played_v()[-3:] == pytest.approx([2, 3, 2], abs=1e-2)


def test_stream_outs_change_together() -> None:
    """New values that wait are used together with those of the stream-out that synchronises."""
    client = Client()
    client.load([1.0], 1)
    for address, number in ((4042, 1002), (4052, 64), (4092, 1), (4062, 1)):
        assert client.write(address, number) == 0
    assert client.write(4402, 1.0, kind="f") == 0
    client.write(4072, 1)
    client.stream(OUT0, OUT0 + 1)
    client.wait(2 * MS)
    client.write(4400, 2.0, kind="f")
    client.write(4070, 2)
    client.wait(2 * MS)
    assert client.rig.drive_v == pytest.approx([30, 30], abs=0.1)
    client.write(4402, 3.0, kind="f")
    client.write(4072, 3)
    client.wait(1 * MS)
    assert client.rig.drive_v == pytest.approx([60, 90], abs=0.1)


def test_inputs_cannot_be_read_while_streaming() -> None:
    """A command reads no input during a stream, and no second stream can be started: 2605."""
    client = Client()
    assert client.stream(AIN0) == 0
    assert client.ask(pack(">BHH", 3, AIN0, 2)) == b"\x83\4"
    assert client.read(registers.LAST_ERROR, "H") == 2605
    assert client.write(4990, 1) == 2605
    assert client.write(4002, 10.0, kind="f") == 2605
    assert client.write(4990, 0) == 0
    assert client.write(4990, 0) == 2620
    assert client.read(AIN0, "f") == 0.0


@pytest.mark.parametrize(
    ("rate_hz", "interval_ns"), [(20_000.0, 50_000), (1e7 / 333, 33_300), (7000.0, 142_800)]
)
def test_interval_is_a_multiple_of_100_ns(rate_hz: float, interval_ns: int) -> None:
    """The fraction of the interval in ticks is cut off, and the actual rate is read back."""
    client = Client()
    client.write(4002, rate_hz, kind="f")
    assert client.read(4002, "f") == pytest.approx(1e9 / interval_ns)


def test_first_scan_comes_one_interval_after_the_start() -> None:
    """Scans are at whole intervals after the start, whenever the device is asked."""
    client = Client()
    client.stream(registers.SELF_INDEX, AIN0, rate_hz=1000, packet=2)
    client.wait(1 * MS - 1)
    assert client.packets() == []
    client.wait(1)
    (packet,) = client.packets()
    assert packet.samples[:2] == b"\0\0"
    client.wait(10 * MS)
    assert len(client.packets()) == 10


@pytest.mark.parametrize(
    ("channels", "rate_hz", "error"),
    [((), 1000.0, 2600), ((7000,), 1000.0, 2607), ((AIN0, OUT0), 60_000.0, 2608)],
)
def test_impossible_streams_are_refused(
    channels: tuple[int, ...], rate_hz: float, error: int
) -> None:
    """The list needs a channel, each must be streamable, all together 100 000 samples a second."""
    client = Client()
    client.write(4002, rate_hz, kind="f")
    for address, number in ((4004, len(channels)), (4006, 1), (4016, 1)):
        client.write(address, number)
    if channels:
        client.write(4100, *channels)
    assert client.write(4990, 1) == error


def test_a_scan_that_takes_too_long_ends_the_stream() -> None:
    """A settling time that does not fit into the interval is reported as overlap, 2942."""
    client = Client()
    client.write(4008, 2000.0, kind="f")
    client.stream(AIN0, rate_hz=1000)
    client.wait(10 * MS)
    (packet,) = client.packets()
    assert packet.status == registers.OVERLAP
    assert client.read(4990) == 0


@pytest.mark.parametrize(("scans", "sizes"), [(6, [4, 4, 4]), (5, [4, 4, 2]), (1, [2])])
def test_last_packet_has_the_rest(scans: int, sizes: list[int]) -> None:
    """The packet with the last scan has status 2944 and the number of its samples."""
    client = Client()
    client.stream(AIN0, AIN0, scans=scans, packet=4)
    client.wait(20 * MS)
    packets = client.packets()
    assert [len(each.samples) // 2 for each in packets] == sizes
    assert [each.status for each in packets[:-1]] == [0] * (len(packets) - 1)
    assert packets[-1][1:3] == (registers.COMPLETE, sizes[-1])


def test_lost_scans_are_marked() -> None:
    """A full buffer loses scans until half of it is free; one scan of 0xFFFF stands for them."""
    client = Client()
    client.write(4012, 64)
    client.stream(registers.SELF_INDEX, AIN0, packet=4)
    client.wait(100 * MS)
    before = client.packets()
    assert [each.status for each in before] == [registers.RECOVERING] * 8
    client.wait(8 * MS)
    after = client.packets()
    assert after[0][1:3] == (registers.RECOVERED, 100 - 16)
    assert after[0].samples[:4] == b"\xff" * 4
    assert [each.status for each in after[1:]] == [0] * (len(after) - 1)


def test_new_client_of_the_stream_begins_with_a_packet() -> None:
    """The rest of a packet that an earlier client has not received is dropped."""
    client = Client()
    client.stream(AIN0, packet=4)
    client.wait(8 * MS)
    assert len(client.server.stream_waiting()) == 24
    client.server.stream_sent(10)
    client.server.stream_connected()
    assert [each.number for each in client.packets()] == [1]


def test_a_watchdog_is_overwritten_by_a_running_stream() -> None:
    """A watchdog that trips sets its safe value, which the next scan replaces."""
    client = Client()
    for address, number in ((61_640, 1), (61_604, 1)):
        client.write(address, number)
    client.write(61_642, 0.5, kind="f")
    client.write(61_600, 1)
    client.load([2.0], 1)
    client.stream(OUT0, scans=2500)
    for _ in range(100):
        client.wait(10 * MS)
        assert client.rig.drive_v[0] == pytest.approx(60, abs=0.05)
    for _ in range(300):
        client.wait(10 * MS)
    assert client.rig.drive_v[0] == pytest.approx(15, abs=0.05)
