import re
from math import isnan

import pytest

from piezod.devices.bus.bus_device import ExchangingBusDevice
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.pi_gcs2.driver import PLUGIN, Gcs2Dialogue
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from piezod_drivers.serial_line.pi_gcs2.options import Options
from tests.drivers.serial_line.linear_rig import UM_PER_V, LinearRig, bench
from tests.drivers.serial_line.scripted_line import (
    MS,
    T0_NS,
    US,
    EmulatedLine,
    ScriptedLine,
    Step,
    says,
)

OPTIONS = Options(port="/dev/ttyUSB0")
OPENING = (
    says(b"ERR?\n", b"0\n"),
    says(b"*IDN?\nERR?\n", b"(c) PI, E-727, 1204, 14.1\n0\n"),
    says(b"SAI?\nERR?\n", b"1 \n2\n0\n"),
)
LIMITS = (
    says(b"VMI? 1\nERR?\n", b"1=-20\n0\n"),
    says(b"VMA? 1\nERR?\n", b"1=120\n0\n"),
)
AT_EASE = (says(b"SVO? 1\nERR?\n", b"1=0\n0\n"), says(b"ONL? 1\nERR?\n", b"1=1\n0\n"))


def scripted(line: ScriptedLine, **options: object) -> ExchangingBusDevice:
    """Return a device of axis 1 on a script."""
    chosen = OPTIONS.model_copy(update=options)
    return ExchangingBusDevice("GCS", Gcs2Dialogue(line, chosen, Wiring.both(["1"])))


def emulated(n_axes: int = 1) -> tuple[ExchangingBusDevice, EmulatedLine, Gcs2Emulator, LinearRig]:
    """Return an open device on an emulated controller."""
    table, rig, time = bench(n_axes)
    emulator = Gcs2Emulator(table, "")
    line = EmulatedLine(emulator, time)
    wiring = Wiring.both(str(i + 1) for i in range(n_axes))
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, OPTIONS, wiring))
    device.open()
    return device, line, emulator, rig


def test_the_bytes_of_a_cycle() -> None:
    """Opening asks who is there, and a cycle of either kind is one write and one frame."""
    line = ScriptedLine(*OPENING, *LIMITS, *AT_EASE)
    device = scripted(line)
    assert device.open() == ("(c) PI", "E-727", "1204", "14.1")
    device.activate(0)
    line.then(
        says(b"POS? 1\nVOL? 1\nERR?\n", b"1=5.25\n", b"1=33.1\n0\n"),
        says(b"SVA 1 2.5000\nERR?\n", b"0\n"),
        says(b"POS? 1\nSVA 1 3.0000\nVOL? 1\nERR?\n", b"1=5.5\n1=34.5\n0\n"),
    )
    assert device.read(7)[0] == (7, 5.25, True)
    assert device.read_back(7) == [33.1]
    assert device.write([2.5], 8)
    taken, samples = device.exchange([3.0], 9)
    assert (taken, samples[0].position_um, device.read_back(9)) == (True, 5.5, [34.5])
    line.assert_done()
    assert device.status(9) == [frozenset(), frozenset()]


def test_a_range_that_is_not_told() -> None:
    """A controller that does not know its limits needs a range in the configuration."""
    unknown = (*OPENING, says(b"VMI? 1\nERR?\n", b"2\n"))
    with pytest.raises(DeviceError, match="give range_v"):
        scripted(ScriptedLine(*unknown)).open()
    device = scripted(ScriptedLine(*OPENING), range_v=(0.0, 100.0))
    device.open()
    assert device.capabilities().holds


def test_an_axis_that_is_missing() -> None:
    """A controller without the axis that is configured is refused, and the line let go."""
    line = ScriptedLine(*OPENING[:2], says(b"SAI?\nERR?\n", b"X \nY\n0\n"))
    with pytest.raises(DeviceError, match="has axes X, Y, the configuration wants 1"):
        scripted(line).open()
    assert not line.opened


def test_letters_have_numbered_amplifiers() -> None:
    """An axis that is called by a letter has the amplifier of its place."""
    line = ScriptedLine(
        *OPENING[:2],
        says(b"SAI?\nERR?\n", b"X \nY\n0\n"),
        says(b"VMI? 2\nERR?\n", b"2=-20\n0\n"),
        says(b"VMA? 2\nERR?\n", b"2=120\n0\n"),
    )
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, OPTIONS, Wiring((), ("Y",))))
    device.open()
    line.then(says(b"VOL? 2\nERR?\n", b"2=12.5\n0\n"))
    assert device.read_back(1) == [12.5]


def test_the_set_value_as_read_back() -> None:
    """Where the voltage is not measured, the set value is asked for, by axis."""
    line = ScriptedLine(*OPENING)
    device = scripted(line, range_v=(0.0, 100.0), read_back="SVA?")
    device.open()
    line.then(says(b"SVA? 1\nERR?\n", b"1=12.5\n0\n"))
    assert device.read_back(1) == [12.5]


def test_activation_leaves_the_output() -> None:
    """An output that the servo holds keeps its voltage, in one write."""
    device, line, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].wanted_v, emulator.axes[0].servo = 40.0, 0.0, True
    device.activate(0)
    assert rig.drive_v == [40.0]
    assert b"SVO 1 0\nSVA 1 40.0000\nERR?\n" in line.sent
    assert device.write([41.0], 1)


@pytest.mark.parametrize("in_force_v", [-20.5, 999.0])
def test_activation_never_clamps(in_force_v: float) -> None:
    """An output that the servo holds beyond the range would jump: it is refused, nothing is set."""
    device, line, emulator, rig = emulated()
    emulator.axes[0].servo = True
    monitored = f"1={in_force_v}".encode()
    rig.drive_v[0] = 40.0
    line.change = lambda reply: re.sub(rb"1=40\.0*", monitored, reply)
    with pytest.raises(DeviceError, match=r"axis 1 is at .* beyond -20 to .* would jump"):
        device.activate(0)
    assert emulator.axes[0].servo
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_activation_needs_a_number() -> None:
    """A voltage beyond all numbers is none: control is not taken, and nothing is set."""
    device, line, emulator, rig = emulated()
    emulator.axes[0].servo = True
    rig.drive_v[0] = 40.0
    line.change = lambda reply: re.sub(rb"1=40\.0*", b"1=1e400", reply)
    with pytest.raises(DeviceUnavailableError, match="no voltage or position"):
        device.activate(0)
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_a_range_without_end() -> None:
    """A limit that is no number is not taken for one."""
    line = ScriptedLine(*OPENING, says(b"VMI? 1\nERR?\n", b"1=-1e999\n0\n"))
    with pytest.raises(DeviceError, match="tells no range"):
        scripted(line).open()


def test_activation_takes_over_from_the_analog_input() -> None:
    """A channel that was offline is online, at the voltage that it had."""
    device, _, emulator, rig = emulated()
    rig.drive_v[0], emulator.axes[0].online = 40.0, False
    device.activate(0)
    assert emulator.axes[0].online
    assert rig.drive_v == [40.0]


def test_activation_that_changes_nothing_sends_nothing() -> None:
    """An output that is driven already is not even set to what it has."""
    device, line, _, _ = emulated()
    device.activate(0)
    assert not [sent for sent in line.sent if b"SVA 1" in sent or b"SVO 1" in sent]


def test_a_servo_that_stays_on() -> None:
    """A controller that keeps its servo on is not activated."""
    on = says(b"SVO? 1\nERR?\n", b"1=1\n0\n"), says(b"ONL? 1\nERR?\n", b"2\n")
    line = ScriptedLine(*OPENING, *LIMITS, *on, says(b"VOL? 1\nERR?\n", b"1=5\n0\n"))
    line.then(on[1], says(b"SVO 1 0\nSVA 1 5.0000\nERR?\n", b"0\n"), *on)
    device = scripted(line)
    device.open()
    with pytest.raises(DeviceError, match="does not give up its servo"):
        device.activate(0)


def test_two_axes_in_one_transaction() -> None:
    """All axes of a controller are set and read in one write."""
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
def test_somebody_switches_the_servo_on() -> None:
    """Writes are refused while the servo is on, and the status says who drives."""
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
    """An error in the place of the acknowledgement refuses the write and tells its flag."""
    line = ScriptedLine(*OPENING, *LIMITS, *AT_EASE)
    device = scripted(line)
    device.open()
    device.activate(0)
    line.then(says(b"SVA 1 2.0000\nERR?\n", code + b"\n"))
    assert not device.write([2.0], 1)
    assert flag in device.status(1)[1]


@pytest.mark.sees("pi_gcs2", "A3")
@pytest.mark.sees("pi_gcs2", "A12")
def test_the_voltage_is_measured() -> None:
    """Read-back is what the amplifier gives, and not what was written."""
    device, _, _, rig = emulated()
    device.activate(0)
    assert device.write([10.0], 1)
    rig.drive_v = [155.0]
    assert device.read_back(2) == [155.0]


def test_a_sensor_that_is_not_valid() -> None:
    """A controller whose sensor fails gives no sample, and the driver says why."""
    device, _, _, rig = emulated()
    device.activate(0)
    rig.valid = False
    assert not device.read(1)[0].valid
    assert DeviceFlag.DEVICE_FAILURE in device.status(1)[0]


@pytest.mark.sees("pi_gcs2", "B5")
def test_a_late_reply_is_nobody_elses() -> None:
    """After a time-out nothing is asked until the late reply has come; it is dropped."""
    device, line, _, rig = emulated()
    device.activate(0)
    line.change = lambda _: b""
    assert not device.read(1)[0].valid
    line.change = lambda reply: reply
    sent = len(line.sent)
    rig.drive_v = [50.0]
    assert not device.read(2)[0].valid
    assert len(line.sent) == sent
    line.comes(b"1=0.0\n1=0.0\n0\n")
    assert device.read(3)[0].position_um == pytest.approx(50 * UM_PER_V)
    assert DeviceFlag.LATE_REPLY in device.status(3)[0]


@pytest.mark.sees("pi_gcs2", "B3")
def test_garbage_between_replies() -> None:
    """Bytes before the replies are noticed and cost nothing; between them, one sample."""
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


@pytest.mark.sees("pi_gcs2", "B7")
def test_a_slow_reply() -> None:
    """A reply that takes most of its time is taken, and told."""
    line = ScriptedLine(*OPENING, *LIMITS, *AT_EASE)
    device = scripted(line)
    device.open()
    device.activate(0)
    line.then(says(b"POS? 1\nVOL? 1\nERR?\n", b"1=5\n1=3\n0\n", after_ns=28 * MS))
    assert device.read(1)[0].valid
    assert device.status(1)[0] == {DeviceFlag.SLOW_REPLY}


@pytest.mark.sees("pi_gcs2", "B1")
def test_a_line_that_is_pulled() -> None:
    """Without its line a device is lost: nothing is read, written or known."""
    device, line, _, _ = emulated()
    device.activate(0)
    line.unplugged = True
    assert not device.read(1)[0].valid
    assert not device.write([1.0], 1)
    assert isnan(device.read_back(1)[0])
    assert DeviceFlag.DISCONNECTED in device.status(1)[0]
    device.close()


def test_a_sensor_only() -> None:
    """A controller that drives nothing here is asked for positions only, and left as it is."""
    line = ScriptedLine(*OPENING)
    device = ExchangingBusDevice("GCS", Gcs2Dialogue(line, OPTIONS, Wiring(("2",), ())))
    device.open()
    device.activate(0)
    line.then(says(b"POS? 2\nERR?\n", b"2=1.5\n0\n"))
    assert device.read(1)[0].position_um == 1.5
    line.assert_done()


def test_an_earlier_life() -> None:
    """What was on its way when the port is opened disturbs nothing."""
    line = ScriptedLine(*OPENING, *LIMITS)
    line.comes(b"1=5.0\n0\n", 20 * MS)
    scripted(line).open()
    line.assert_done()


@pytest.mark.parametrize(
    "steps",
    [
        (*OPENING, says(b"VMI? 1\nERR?\n", b"603\n")),
        (*OPENING, *LIMITS, AT_EASE[0], says(b"ONL? 1\nERR?\n", b"603\n")),
    ],
)
def test_an_error_while_opening(steps: tuple[Step, ...]) -> None:
    """An error that is not that of an unknown command makes a device unavailable."""
    device = scripted(ScriptedLine(*steps))
    with pytest.raises(DeviceUnavailableError, match="error 603: too hot"):
        device.open()
        device.activate(0)


def test_nobody_answers() -> None:
    """A port behind which nobody answers is told as such."""
    line = ScriptedLine(says(b"ERR?\n"))
    with pytest.raises(DeviceUnavailableError, match="no reply within 500 ms"):
        scripted(line).open()
    assert line.now_ns() > T0_NS


def test_what_a_configuration_may_say() -> None:
    """A range goes upwards; channels are the axes, in µm and V."""
    with pytest.raises(ValueError, match="must be above the first"):
        Options(port="x", range_v=(10.0, 10.0))
    units = PLUGIN.channels(Options(host="pi", tcp_port=50_000, axes=("1", "X")))
    assert units == ({"1": "µm", "X": "µm"}, {"1": "V", "X": "V"})


def test_the_rate_of_the_line() -> None:
    """A serial line bounds the rate by its bytes, a network by a guess."""
    serial = Gcs2Dialogue(ScriptedLine(), OPTIONS, Wiring.both(["1"])).capabilities()
    assert serial.max_rate_hz == pytest.approx(115_200 / 10 / 63)
    network = Options(host="pi", tcp_port=50_000)
    dialogue = Gcs2Dialogue(ScriptedLine(), network, Wiring.both(["1"]))
    assert dialogue.capabilities().max_rate_hz == 1000
    device = PLUGIN.create(network, Wiring.both(["1"]), 1)
    device.close()
