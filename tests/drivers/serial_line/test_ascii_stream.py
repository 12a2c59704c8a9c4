"""Reading a sensor that sends lines by itself."""

import pytest

from piezod.devices.bus.bus_device import BusDevice
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from piezod_drivers.serial_line.ascii_line.emulator import StreamingSensor
from tests.drivers.serial_line.ascii_rig import sensor
from tests.drivers.serial_line.linear_rig import UM_PER_V, bench
from tests.drivers.serial_line.scripted_line import MS, ScriptedLine

OPENING = b"23 um\nP 1.0 um\n"  # the port was opened in the middle of a line


def listening(**options: object) -> tuple[BusDevice, ScriptedLine]:
    """Return a sensor that is open and active, and its line."""
    line = ScriptedLine()
    line.comes(OPENING)
    line.comes(b"P 2.0 um\n", MS)
    dut = sensor(line, **options)
    dut.open()
    dut.activate(line.now_ns())
    return dut, line


def test_a_sample_is_the_newest_line() -> None:
    """Of several pending lines the last complete one counts."""
    dut, line = listening()
    line.comes(b"P 3.0 um\nP 4.5 um\nP 5.")

    (sample,) = dut.read(line.now_ns())

    assert (sample.t_ns, sample.position_um, sample.valid) == (line.now_ns(), 4.5, True)


def test_without_a_new_line_the_sample_is_the_old_one_of_then() -> None:
    """Without a new line the sample keeps its value and its instant."""
    dut, line = listening()
    (before,) = dut.read(line.now_ns())
    line.time.t_ns += 10 * MS

    (again,) = dut.read(line.now_ns())

    assert again == before
    assert again.t_ns < line.now_ns()


def test_a_sensor_that_falls_silent_has_no_sample() -> None:
    """After the time-out without a line the sample is invalid."""
    dut, line = listening()
    line.time.t_ns += 60 * MS

    (sample,) = dut.read(line.now_ns())

    assert not sample.valid
    assert DeviceFlag.LATE_REPLY in dut.status(line.now_ns())[0]


def test_a_line_in_two_parts_is_one_line() -> None:
    """The first part of a line is kept until the rest comes."""
    dut, line = listening()
    line.comes(b"P 7")
    dut.read(line.now_ns())
    line.comes(b".5 um\n")

    (sample,) = dut.read(line.now_ns())

    assert sample.position_um == 7.5


@pytest.mark.parametrize("noise", [b"\xff\xfe\n", b"P um\n", b"\n", b"x" * 500 + b"\n"])
def test_garbage_is_reported_and_the_line_before_it_counts(noise: bytes) -> None:
    """A garbage line is reported, and the line before it counts."""
    dut, line = listening()
    line.comes(b"P 3.0 um\n" + noise)

    (sample,) = dut.read(line.now_ns())

    assert (sample.position_um, sample.valid) == (3.0, True)
    assert DeviceFlag.GARBAGE in dut.status(line.now_ns())[0]


@pytest.mark.sees("ascii", "S7")
def test_a_line_that_is_an_error_has_no_sample() -> None:
    """An error line is reported, and the line before it is not used."""
    dut, line = listening()
    line.comes(b"P 3.0 um\nsaturated\n")

    (sample,) = dut.read(line.now_ns())

    assert not sample.valid
    assert DeviceFlag.SATURATED in dut.status(line.now_ns())[0]


@pytest.mark.sees("ascii", "S7")
def test_after_an_error_nothing_is_valid_until_a_line_comes() -> None:
    """After an error line samples are invalid until another line comes."""
    dut, line = listening()
    dut.read(line.now_ns())
    line.comes(b"saturated\n")
    seen = [dut.read(line.now_ns())[0]]
    for _ in range(3):
        line.time.t_ns += MS
        seen += dut.read(line.now_ns())

    assert [sample.valid for sample in seen] == [False] * 4
    assert DeviceFlag.LATE_REPLY not in dut.status(line.now_ns())[0]
    line.comes(b"P 3.5 um\n")
    (sample,) = dut.read(line.now_ns())
    assert (sample.position_um, sample.valid) == (3.5, True)


@pytest.mark.sees("ascii", "B11")
def test_more_bytes_than_can_be_read_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line that never falls silent is read in part, and the newest of that counts."""
    dut, line = listening()
    given = iter(range(1000))
    monkeypatch.setattr(line, "receive", lambda _within_ns: f"P {next(given)}.0 um\n".encode())

    (sample,) = dut.read(line.now_ns())

    assert sample.position_um == 3.0
    assert DeviceFlag.BUS_OVERLOADED in dut.status(line.now_ns())[0]


def test_silence_is_an_absent_sensor() -> None:
    """A port without any line is an unavailable sensor."""
    line = ScriptedLine()
    line.comes(b"half a line")

    with pytest.raises(DeviceUnavailableError, match="no line from"):
        sensor(line).open()


def test_a_sensor_that_falls_silent_cannot_be_activated() -> None:
    """A sensor that sends no line cannot be activated."""
    line = ScriptedLine()
    line.comes(OPENING)
    dut = sensor(line)
    dut.open()

    with pytest.raises(DeviceUnavailableError, match="no line from"):
        dut.activate(line.now_ns())


def test_start_and_stop_are_sent_to_a_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    """The commands of `start` and `stop` are sent to a streaming sensor."""
    sent: list[bytes] = []
    line = ScriptedLine()
    monkeypatch.setattr(line, "send", sent.append)
    line.comes(OPENING)
    line.comes(b"P 2.0 um\n", MS)
    dut = sensor(line, start=({"send": "GO"},), stop=({"send": "HALT"},))
    dut.open()
    dut.activate(0)
    dut.close()

    assert sent == [b"GO\n", b"HALT\n"]


def test_the_emulated_sensor_sends_a_line_every_2_ms() -> None:
    """The emulated sensor sends its displacement, or that it is saturated, every 2 ms."""
    there, rig, time = bench()
    rig.drive_v = [10.0]
    reporter = StreamingSensor(there)

    first, none = reporter.due(), reporter.due()
    time.t_ns += 7 * MS
    rig.valid = False

    assert (first, none, reporter.due(), reporter.due(), reporter.receive(b"?\n")) == (
        [f"P {10 * UM_PER_V:.4f} um\r\n".encode()],
        [],
        [b"P saturated\r\n"],
        [],
        [],
    )
