"""The conversation with a device whose commands and replies are options."""

import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError, DeviceUnavailableError
from piezod_drivers.serial_line.ascii_line.emulator import V_PER_UM, NanopositionerEmulator
from tests.drivers.serial_line.ascii_rig import device, started
from tests.drivers.serial_line.linear_rig import UM_PER_V, bench
from tests.drivers.serial_line.scripted_line import MANY, MS, ScriptedLine, exchange

IDENTIFY = {"send": "*IDN?", "reply": r"(?P<maker>[^,]+),(?P<model>[^,]+),(?P<serial>[^,]*)"}


def test_a_setpoint_is_written_by_its_command() -> None:
    """The value is in the command in its format, and the reply acknowledges it."""
    dut, line = started(exchange(b"V 12.35\n", b"OK\n"))

    assert dut.write([12.345678], line.now_ns())
    line.assert_done()


def test_a_sample_is_read_by_its_pattern() -> None:
    """The named group of the reply is the value."""
    dut, line = started(exchange(b"P?\n", b"  -1.25 \r\n"))

    (sample,) = dut.read(line.now_ns())

    assert (sample.position_um, sample.valid) == (-1.25, True)


def test_all_channels_can_be_in_one_line() -> None:
    """One command sets all outputs, and one reply has all inputs."""
    line = ScriptedLine(exchange(b"V 1.0 2.0\n", b"OK\n"), exchange(b"P?\n", b"3.5;4.5\n"))
    dut = device(
        line,
        Wiring.both("xy"),
        outputs={name: {"lowest": 0.0, "highest": 9.0} for name in "xy"},
        inputs={"x": {}, "y": {}},
        set=({"send": "V {x:.1f} {y:.1f}", "reply": "OK"},),
        read=({"send": "P?", "reply": r"(?P<y>[\d.]+);(?P<x>[\d.]+)"},),
    )
    dut.open()
    dut.activate(0)

    assert dut.write([1.0, 2.0], line.now_ns())
    assert [sample.position_um for sample in dut.read(line.now_ns())] == [4.5, 3.5]


def test_a_command_never_sets_an_unused_channel() -> None:
    """A command that also sets an unused output is refused with the remedy."""
    dut = device(
        ScriptedLine(),
        outputs={name: {"lowest": 0.0, "highest": 9.0} for name in "xy"},
        set=({"send": "V {x} {y}", "reply": "OK"},),
    )

    with pytest.raises(DeviceError, match=r"also sets channel y.*use it in an axis"):
        dut.open()


@pytest.mark.sees("ascii", "B10")
@pytest.mark.sees("ascii", "A4")
@pytest.mark.parametrize(
    ("answer", "flag"),
    [
        (b"ERR 17\n", DeviceFlag.WRONG_REQUEST),
        (b"OVERLOAD\n", DeviceFlag.OVERLOAD),
        (b"what?\n", DeviceFlag.GARBAGE),
        (b"\xff\n", DeviceFlag.GARBAGE),
        (b"x" * 300 + b"\nOK", DeviceFlag.GARBAGE),
    ],
)
def test_other_reply_refuses_the_setpoint(answer: bytes, flag: DeviceFlag) -> None:
    """An error, or another line, fails the write with its flag."""
    dut, line = started(exchange(b"V 1.00\n", answer))

    assert not dut.write([1.0], line.now_ns())
    assert flag in dut.status(line.now_ns())[0]


@pytest.mark.sees("ascii", "B13")
def test_a_connection_on_which_nothing_is_acknowledged_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A fault that a TCP line notices is reported and loses the device."""

    def fail(_data: bytes) -> None:
        raise LineFault(DeviceFlag.HALF_OPEN, "nothing is acknowledged")

    dut, line = started()
    monkeypatch.setattr(line, "send", fail)

    assert not dut.write([1.0], line.now_ns())
    assert DeviceFlag.HALF_OPEN in dut.status(line.now_ns())[0]
    assert not dut.read(line.now_ns())[0].valid


@pytest.mark.sees("ascii", "A3")
@pytest.mark.sees("ascii", "A12")
def test_voltage_in_force_comes_from_the_device() -> None:
    """A voltage that another program has set is read back."""
    dut, line = started(
        exchange(b"V 1.00\n", b"OK\n"),
        exchange(b"V?\n", b"7.50\n"),
        read_back=({"send": "V?", "reply": r"(?P<x>[\d.]+)"},),
    )

    assert dut.write([1.0], line.now_ns())
    assert dut.read_back(line.now_ns()) == [7.5]


def test_numbers_that_go_round_tell_a_late_answer_from_the_next() -> None:
    """A late reply with a running number is dropped."""
    dut, line = started(
        exchange(b"000 V 1.00\n"),
        exchange(b"001 V 2.00\n", b"000 OK\n", b"? OK\n", b"001 OK\n"),
        set=({"send": "{n:03d} V {x:.2f}", "reply": r"(?P<n>[^ ]+) OK"},),
    )

    assert not dut.write([1.0], line.now_ns())
    assert dut.write([2.0], line.now_ns())
    assert DeviceFlag.OUT_OF_ORDER in dut.status(line.now_ns())[0]
    line.assert_done()


def test_a_device_that_does_not_answer_is_asked_what_is_in_force() -> None:
    """A setpoint without reply counts as accepted when it can be read back."""
    dut, line = started(
        exchange(b"V 1.00\n"),
        exchange(b"V?\n", b"1.00\n"),
        exchange(b"V?\n", b"0.99\n"),
        set=({"send": "V {x:.2f}"},),
        read_back=({"send": "V?", "reply": r"(?P<x>[\d.]+)"},),
    )

    assert dut.write([1.0], line.now_ns())
    assert dut.read_back(line.now_ns()) == [0.99]
    assert dut.capabilities().read_back


def test_identity_comes_from_the_groups_of_its_answer() -> None:
    """The groups maker, model, serial and firmware give the identity."""
    line = ScriptedLine(exchange(b"*IDN?\n", b"Acme,Mover 3,\n"))

    identity = device(line, identify=IDENTIFY).open()

    assert identity == ("Acme", "Mover 3", "unknown", "unknown")


def test_another_device_is_refused() -> None:
    """A device whose identity does not match the pattern is refused."""
    line = ScriptedLine(*MANY * [exchange(b"*IDN?\n", b"hello\n")])

    with pytest.raises(DeviceError, match="another device"):
        device(line, identify=IDENTIFY).open()
    assert not line.opened


def test_silence_means_an_absent_device() -> None:
    """A device that does not reply to `identify` is unavailable."""
    with pytest.raises(DeviceUnavailableError):
        device(ScriptedLine(*MANY * [exchange(b"*IDN?\n")]), identify=IDENTIFY).open()


def test_start_and_stop_are_sent_around_the_run() -> None:
    """The commands of `start` and `stop` are sent once each."""
    dut, line = started(
        exchange(b"REMOTE 1\n", b"OK\n"),
        exchange(b"REMOTE 0\n"),
        start=({"send": "REMOTE 1", "reply": "OK"},),
        stop=({"send": "REMOTE 0"},),
    )

    dut.close()
    line.assert_done()


START = {
    "start": ({"send": "SERVO OFF"}, {"send": "REMOTE 1", "reply": "OK"}),
    "stop": ({"send": "REMOTE 0"},),
}


def test_a_device_that_is_only_read_is_not_started() -> None:
    """With inputs only, nothing is sent that could change the outputs."""
    line = ScriptedLine(exchange(b"P?\n", b"1.5\n"))
    dut = device(line, Wiring(("x",), ()), **START)
    dut.open()
    dut.activate(0)

    assert dut.read(line.now_ns())[0].position_um == 1.5
    dut.close()
    line.assert_done()


def test_a_device_without_outputs_is_started() -> None:
    """A sensor without outputs is started."""
    line = ScriptedLine(exchange(b"SERVO OFF\n"), exchange(b"REMOTE 1\n", b"OK\n"))
    dut = device(line, Wiring(("x",), ()), outputs={}, set=(), **START)
    dut.open()
    dut.activate(0)
    line.assert_done()


@pytest.mark.parametrize("stray", [b"Temp warning\n", b"OK\n", b"\xff\n"])
def test_a_line_that_is_no_such_answer_ends_no_waiting(stray: bytes) -> None:
    """After a time-out only a line that matches the reply ends the wait."""
    dut, line = started(exchange(b"P?\n"))
    assert not dut.read(line.now_ns())[0].valid
    line.comes(stray)
    assert not dut.read(line.now_ns())[0].valid
    assert DeviceFlag.GARBAGE in dut.status(line.now_ns())[0]

    line.comes(b"1.0\n")
    line.then(exchange(b"P?\n", b"9.0\n"))
    assert dut.read(line.now_ns())[0].position_um == 9.0
    line.assert_done()


def test_a_line_that_is_no_such_answer_is_not_taken_for_it() -> None:
    """Another line before the reply is skipped."""
    dut, line = started(exchange(b"P?\n", b"Temp warning\n", b"1.5\n"))

    assert dut.read(line.now_ns())[0].position_um == 1.5
    assert DeviceFlag.GARBAGE in dut.status(line.now_ns())[0]


@pytest.mark.sees("ascii", "A8")
@pytest.mark.parametrize(("reply", "taken"), [(b"1.04\n", True), (b"60.0\n", False)])
def test_a_setpoint_that_is_read_back_otherwise_is_refused(reply: bytes, taken: bool) -> None:
    """With a tolerance, a setpoint that reads back differently fails at once."""
    dut, line = started(
        exchange(b"V 1.00\n"),
        exchange(b"V?\n", reply),
        outputs={"x": {"lowest": 0.0, "highest": 100.0, "tolerance": 0.05}},
        set=({"send": "V {x:.2f}"},),
        read_back=({"send": "V?", "reply": r"(?P<x>[\d.]+)"},),
    )

    assert dut.write([1.0], line.now_ns()) == taken
    assert (DeviceFlag.LOCAL_MODE in dut.status(line.now_ns())[0]) != taken


@pytest.mark.sees("ascii", "A2")
@pytest.mark.parametrize("read_back", [False, True])
def test_half_a_command_is_made_an_unknown_one(
    monkeypatch: pytest.MonkeyPatch, *, read_back: bool
) -> None:
    """Half a sent command loses the device, and becomes an unknown one at reopening."""

    def fail(_data: bytes) -> None:
        raise LineFault(DeviceFlag.PARTIAL_WRITE, "3 of 7 bytes went out")

    silent: dict[str, object] = {
        "set": ({"send": "V {x:.2f}"},),
        "read_back": ({"send": "V?", "reply": r"(?P<x>[\d.]+)"},),
    }
    dut, line = started(**(silent if read_back else {}))
    with monkeypatch.context() as patched:
        patched.setattr(line, "send", fail)
        assert not dut.write([1.0], line.now_ns())
    assert not dut.write([1.0], line.now_ns())
    dut.close()

    line.then(exchange(b"~\n", b"ERR 1\n"), exchange(b"P?\n", b"1.5\n"))
    dut.open()
    dut.activate(0)
    assert dut.read(line.now_ns())[0].position_um == 1.5
    line.assert_done()


def test_the_status_is_asked_after_a_setpoint_when_it_is_due() -> None:
    """Flags whose patterns match the status are reported for every channel."""
    dut, line = started(
        exchange(b"V 1.00\n", b"OK\n"),
        exchange(b"S?\n", b"remote,hot\n"),
        exchange(b"V 2.00\n", b"OK\n"),
        exchange(b"V 3.00\n", b"OK\n"),
        exchange(b"S?\n", b"ERR 1\n"),
        status={
            "send": "S?",
            "flags": (
                {"pattern": "local.*", "flag": "local mode"},
                {"pattern": "[^,]*,hot", "flag": "over-temperature"},
            ),
        },
    )

    dut.write([1.0], line.now_ns())
    assert dut.status(line.now_ns()) == [frozenset({DeviceFlag.OVER_TEMPERATURE})] * 2
    dut.write([2.0], line.now_ns())
    line.time.t_ns += 100 * MS
    assert dut.write([3.0], line.now_ns())
    lasting_and_new = frozenset({DeviceFlag.OVER_TEMPERATURE, DeviceFlag.WRONG_REQUEST})
    assert dut.status(line.now_ns()) == [lasting_and_new] * 2
    line.assert_done()


@pytest.mark.parametrize(
    "flag", [DeviceFlag.PARTIAL_WRITE, DeviceFlag.DISCONNECTED, DeviceFlag.HALF_OPEN]
)
def test_after_half_a_question_for_the_status_nothing_is_sent(
    monkeypatch: pytest.MonkeyPatch, flag: DeviceFlag
) -> None:
    """Half a sent status request loses the device: no setpoint follows it."""
    status = {"send": "S?", "flags": ({"pattern": "bad", "flag": "overload"},)}
    dut, line = started(exchange(b"V 1.00\n", b"OK\n"), status=status)
    send = line.send

    def fail(data: bytes) -> None:
        if data == b"S?\n":
            raise LineFault(flag, "the line is lost")
        send(data)

    monkeypatch.setattr(line, "send", fail)

    assert not dut.write([1.0], line.now_ns())
    assert not dut.write([2.0], line.now_ns())
    assert flag in dut.status(line.now_ns())[0]
    line.assert_done()


@pytest.mark.parametrize(
    "flag",
    [
        pytest.param(flag, marks=pytest.mark.sees("ascii", fault))
        for flag, fault in [
            (DeviceFlag.OVERLOAD, "A4"),
            (DeviceFlag.LOCAL_MODE, "A8"),
            (DeviceFlag.WATCHDOG_TRIPPED, "A9"),
            (DeviceFlag.SHORT_OR_OPEN, "A11"),
            (DeviceFlag.OVER_TEMPERATURE, "A13"),
            (DeviceFlag.SATURATED, "S7"),
            (DeviceFlag.LOW_LIGHT, "S8"),
        ]
    ],
)
def test_the_status_can_report_every_flag(flag: DeviceFlag) -> None:
    """Every flag can be reported by the status."""
    status = {"send": "S?", "flags": ({"pattern": "bad", "flag": str(flag)},)}
    dut, line = started(exchange(b"V 1.00\n", b"OK\n"), exchange(b"S?\n", b"bad\n"), status=status)
    dut.write([1.0], line.now_ns())

    assert dut.status(line.now_ns()) == [frozenset({flag})] * 2


def test_other_terminators_and_encodings() -> None:
    """Terminators and encoding are those of the options."""
    dut, line = started(
        exchange("V 1.00 µm\r".encode("latin-1"), "OK µm\r\n".encode("latin-1")),
        terminator="\r",
        reply_terminator="\r\n",
        encoding="latin-1",
        set=({"send": "V {x:.2f} µm", "reply": "OK µm"},),
    )

    assert dut.write([1.0], line.now_ns())


def test_the_emulated_nanopositioner_goes_where_it_is_sent() -> None:
    """The emulated nanopositioner moves, reports its position and refuses bad commands."""
    there, rig, _ = bench()
    emulator = NanopositionerEmulator(there, "7")

    replies = [
        emulator.receive(request)
        for request in (b"INFOX\n", b"MOVEX 1.5u\n", b"GET_", b"X\n", b"MOVEX 99u\n", b"MOVEY 1u\n")
    ]

    assert rig.drive_v == [pytest.approx(1.5 * V_PER_UM)]
    assert replies == [
        [b"DEMO-26 um SN7\n"],
        [b"Ok\n"],
        [],
        [f"{1.5 * V_PER_UM * UM_PER_V:.4f} um\n".encode()],
        [b"Error: out of range\n"],
        [b"Error: unknown command\n"],
    ]
