import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.pi_gcs2.dialogue import Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.driver import PLUGIN
from piezod_drivers.serial_line.pi_gcs2.options import Gcs2Options
from tests.drivers.serial_line.linear_rig import UM_PER_V
from tests.drivers.serial_line.pi_gcs2_bench import (
    AT_EASE,
    LIMITS,
    OPENING,
    OPTIONS,
    emulated,
    scripted,
)
from tests.drivers.serial_line.scripted_line import (
    MANY,
    MS,
    T0_NS,
    US,
    ScriptedLine,
    Step,
    exchange,
)


def test_the_bytes_of_a_cycle() -> None:
    """Opening identifies the controller, and each cycle is one write and one frame."""
    line = ScriptedLine(*OPENING, *LIMITS, *AT_EASE)
    device = scripted(line)
    assert device.open() == ("(c) PI", "E-727", "1204", "14.1")
    device.activate(0)
    line.then(
        exchange(b"POS? 1\nVOL? 1\nERR?\n", b"1=5.25\n", b"1=33.1\n0\n"),
        exchange(b"SVA 1 2.5000\nERR?\n", b"0\n"),
        exchange(b"POS? 1\nSVA 1 3.0000\nVOL? 1\nERR?\n", b"1=5.5\n1=34.5\n0\n"),
    )
    assert device.read(7)[0] == (7, 5.25, True)
    assert device.read_back(7) == [33.1]
    assert device.write([2.5], 8)
    taken, samples = device.exchange([3.0], 9)
    assert (taken, samples[0].position_um, device.read_back(9)) == (True, 5.5, [34.5])
    line.assert_done()
    assert device.status(9) == [frozenset(), frozenset()]


def test_a_range_that_is_not_reported() -> None:
    """A controller that does not report its limits needs a configured range."""
    unknown = (*OPENING, exchange(b"VMI? 1\nERR?\n", b"2\n"))
    with pytest.raises(DeviceError, match="give range_v"):
        scripted(ScriptedLine(*unknown)).open()
    device = scripted(ScriptedLine(*OPENING), range_v=(0.0, 100.0))
    device.open()
    assert device.capabilities().holds


def test_a_slow_controller_gets_the_configured_time_at_opening_too() -> None:
    """Outside of the loop a reply has half a second, or `timeout_ms` if that is longer."""
    slow = exchange(b"VMI? 1\nERR?\n", b"1=-20\n0\n", after_ns=700 * MS)
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        scripted(ScriptedLine(*OPENING, slow)).open()
    device = scripted(ScriptedLine(*OPENING, slow, LIMITS[1], *AT_EASE), timeout_ms=1000.0)

    assert device.open().model == "E-727"


def test_an_axis_that_is_missing() -> None:
    """A controller without a configured axis is refused, and the line is closed."""
    line = ScriptedLine(*OPENING[:2], exchange(b"SAI?\nERR?\n", b"X \nY\n0\n"))
    with pytest.raises(DeviceError, match="has axes X, Y, but not the configured 1"):
        scripted(line).open()
    assert not line.opened


def test_letters_have_numbered_amplifiers() -> None:
    """An axis named by a letter has the amplifier with its index."""
    line = ScriptedLine(
        *OPENING[:2],
        exchange(b"SAI?\nERR?\n", b"X \nY\n0\n"),
        exchange(b"VMI? 2\nERR?\n", b"2=-20\n0\n"),
        exchange(b"VMA? 2\nERR?\n", b"2=120\n0\n"),
    )
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, OPTIONS, Wiring((), ("Y",))))
    device.open()
    line.then(exchange(b"VOL? 2\nERR?\n", b"2=12.5\n0\n"))
    assert device.read_back(1) == [12.5]


def test_the_set_value_as_read_back() -> None:
    """With `read_back: SVA?` the set value is read, by axis."""
    line = ScriptedLine(*OPENING)
    device = scripted(line, range_v=(0.0, 100.0), read_back="SVA?")
    device.open()
    line.then(exchange(b"SVA? 1\nERR?\n", b"1=12.5\n0\n"))
    assert device.read_back(1) == [12.5]


def test_two_axes_in_one_transaction() -> None:
    """One write sets and reads all axes of a controller."""
    device, line, _, rig = emulated(2)
    device.activate(0)
    line.sent.clear()
    taken, samples = device.exchange([10.0, 20.0], 1)
    assert taken
    assert rig.drive_v == [10.0, 20.0]
    assert line.sent == [b"POS? 1 2\nSVA 1 10.0000 2 20.0000\nVOL? 1 2\nERR?\n"]
    assert [sample.valid for sample in samples] == [True, True]
    assert device.read(2)[1].position_um == pytest.approx(20 * UM_PER_V)
    assert device.read_back(2) == [10.0, 20.0]


@pytest.mark.sees("pi_gcs2", "A8")
def test_servo_switched_on_by_another_program() -> None:
    """While the servo is on writes fail, and the status reports local mode."""
    device, _, emulator, _ = emulated()
    device.activate(0)
    emulator.axes[0].servo = True
    assert not device.write([5.0], 1)
    assert device.status(1) == [frozenset({DeviceFlag.LOCAL_MODE})] * 2
    emulator.axes[0].servo = False
    assert device.write([5.0], 2)
    assert device.status(2) == [frozenset(), frozenset()]


@pytest.mark.sees("pi_gcs2", "B10")
@pytest.mark.sees("pi_gcs2", "A13")
@pytest.mark.sees("pi_gcs2", "A1")
@pytest.mark.parametrize(
    ("code", "flag"),
    [
        (b"603", DeviceFlag.OVER_TEMPERATURE),
        (b"654", DeviceFlag.DEVICE_FAILURE),
        (b"61", DeviceFlag.BUSY),
        (b"17", DeviceFlag.WRONG_REQUEST),
    ],
)
def test_errors_of_the_controller(code: bytes, flag: DeviceFlag) -> None:
    """An error in place of the acknowledgement fails the write with its flag."""
    line = ScriptedLine(*OPENING, *LIMITS, *AT_EASE)
    device = scripted(line)
    device.open()
    device.activate(0)
    line.then(exchange(b"SVA 1 2.0000\nERR?\n", code + b"\n"))
    assert not device.write([2.0], 1)
    assert flag in device.status(1)[1]


@pytest.mark.sees("pi_gcs2", "A3")
@pytest.mark.sees("pi_gcs2", "A12")
def test_the_voltage_is_measured() -> None:
    """The read-back is the voltage of the amplifier, not the written value."""
    device, _, _, rig = emulated()
    device.activate(0)
    assert device.write([10.0], 1)
    rig.drive_v = [155.0]
    assert device.read_back(2) == [155.0]


def test_a_sensor_that_is_not_valid() -> None:
    """A controller whose sensor fails gives no sample, and the flag says why."""
    device, _, _, rig = emulated()
    device.activate(0)
    rig.valid = False
    assert not device.read(1)[0].valid
    assert DeviceFlag.DEVICE_FAILURE in device.status(1)[0]


@pytest.mark.sees("pi_gcs2", "B3")
def test_garbage_between_replies() -> None:
    """Garbage before the replies is only reported; garbage between them costs one sample."""
    device, line, _, rig = emulated()
    device.activate(0)
    rig.drive_v = [50.0]
    line.comes(b"noise\n", 50 * US)
    line.comes(b"\xff\n", 1 * US)
    assert device.read(1)[0].position_um == pytest.approx(50 * UM_PER_V)
    assert DeviceFlag.GARBAGE in device.status(1)[0]
    line.change = lambda reply: b"\xff\n" + reply
    assert not device.read(2)[0].valid
    line.change = lambda reply: reply
    assert device.read(3)[0].valid


def test_a_sensor_only() -> None:
    """With inputs only, a controller is only asked for positions."""
    line = ScriptedLine(*OPENING)
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, OPTIONS, Wiring(("2",), ())))
    device.open()
    device.activate(0)
    line.then(exchange(b"POS? 2\nERR?\n", b"2=1.5\n0\n"))
    assert device.read(1)[0].position_um == 1.5
    line.assert_done()


def test_an_earlier_life() -> None:
    """Pending bytes of an earlier connection do not disturb opening."""
    line = ScriptedLine(*OPENING, *LIMITS)
    line.comes(b"1=5.0\n0\n", 20 * MS)
    scripted(line).open()
    line.assert_done()


@pytest.mark.parametrize(
    "steps",
    [
        (*OPENING, exchange(b"VMI? 1\nERR?\n", b"603\n")),
        (*OPENING, *LIMITS, *AT_EASE[:-1], exchange(b"ONL? 1\nERR?\n", b"603\n")),
    ],
)
def test_an_error_while_opening(steps: tuple[Step, ...]) -> None:
    """An error other than that of an unknown command makes a device unavailable."""
    device = scripted(ScriptedLine(*steps))
    with pytest.raises(DeviceUnavailableError, match="error 603: temperature too high"):
        device.open()
        device.activate(0)


def test_silent_device() -> None:
    """A port without reply is an unavailable device."""
    line = ScriptedLine(*MANY * [exchange(b"ERR?\n")])
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        scripted(line).open()
    assert line.now_ns() > T0_NS


def test_configurations() -> None:
    """A range must rise; channels are the axes, in µm and V."""
    with pytest.raises(ValueError, match="must be above the first"):
        Gcs2Options(port="x", range_v=(10.0, 10.0))
    units = PLUGIN.channels(Gcs2Options(host="pi", tcp_port=50_000, axes=("1", "X")))
    assert units == ({"1": "µm", "X": "µm"}, {"1": "V", "X": "V"})


def test_the_rate_of_the_line() -> None:
    """The bytes of a cycle limit the rate of a serial line, an assumption that of a network."""
    serial = Gcs2Dialogue(ScriptedLine(), OPTIONS, Wiring.both(["1"])).capabilities()
    assert serial.max_rate_hz == pytest.approx(115_200 / 10 / 63)
    network = Gcs2Options(host="pi", tcp_port=50_000)
    dialogue = Gcs2Dialogue(ScriptedLine(), network, Wiring.both(["1"]))
    assert dialogue.capabilities().max_rate_hz == 1000
    device = PLUGIN.create(network, Wiring.both(["1"]), 1)
    device.close()
