"""The emulated wave generators and data recorder against public facts."""

import pytest

from piezod.devices.bus.line import LineFault
from piezod_drivers.serial_line.gcs.errors import ERRORS
from piezod_drivers.serial_line.pi_gcs2.array_codec import array_length, array_rows
from piezod_drivers.serial_line.pi_gcs2.emulator import Gcs2Emulator
from tests.drivers.serial_line.linear_rig import LinearRig, bench
from tests.drivers.serial_line.scripted_line import MS, TestTime

SERVO_NS = 50_000


class Controller:
    """An emulated controller without the driver.

    Args:
        n_axes: Number of its axes.
    """

    def __init__(self, n_axes: int = 2) -> None:
        self.rig: LinearRig
        self.time: TestTime
        table, self.rig, self.time = bench(n_axes)
        self.emulator = Gcs2Emulator(table, "")

    def ask(self, request: str) -> str:
        """Return all replies to some commands."""
        return b"".join(self.emulator.receive(request.encode())).decode()

    def error(self, request: str) -> int:
        """Send commands without reply; return the error."""
        reply = self.ask(request + "\nERR?\n")
        return int(reply)

    def wait(self, for_ns: int) -> None:
        """Let time pass."""
        self.time.t_ns += for_ns
        self.emulator.due()

    def array(self, request: str, n_rows: int, n_columns: int = 1) -> list[list[float]]:
        """Return the values of a reply."""
        frame = self.ask(f"{request}\nERR?\n").encode()
        assert array_length(frame) == len(frame)
        return array_rows(frame, n_rows, n_columns)

    def load(self, *values: float, cycles: int = 0) -> None:
        """Write a wave for the first generator."""
        texts = " ".join(map(str, values))
        assert self.error(f"WAV 1 X PNT 1 {len(values)} {texts}") == 0
        assert self.error(f"WSL 1 1\nWGC 1 {cycles}") == 0

    def played_v(self) -> list[float]:
        """Return all voltages that the first axis has had, in V."""
        return [each[0] for each in self.rig.driven_v]


@pytest.mark.confirms(
    "pi_gcs2",
    "pi-gcs2",
    part="commands of wave generator and recorder, forms of their replies",
    by="marc2332/bliss, pi_e753.py and pi_gcs.py",
    kind="manual",
)
def test_commands_of_a_beamline() -> None:
    """The commands that bliss sends to an E-753 play a sine; its ways to read replies fit."""
    controller = Controller()
    assert float(controller.ask("SPA? 1 0xe000200\n").partition("=")[2]) == 50e-6
    assert int(controller.ask("SPA? 1 0x13000004\n").partition("=")[2]) == 262_144
    assert int(controller.ask("TNR?\n")) == 8
    assert controller.error("DRC 1 1 2 2 1 7") == 0
    wave = "WSL 1 1\nWAV 1 X SIN_P 2000 20.0 10.0 2000 0 1000\n"
    assert controller.ask(f"{wave}WTR 0 1 1\nWGC 1 2\nWGO 1 1\nERR?\n") == "0\n"
    assert controller.ask("\x09") == "1\n"
    controller.wait(300 * MS)
    assert controller.ask("\x09") == "0\n"
    assert (min(controller.played_v()), max(controller.played_v())) == pytest.approx((10, 30))
    assert controller.ask("DRL? 1\n").startswith("1=")
    header, _, values = controller.ask("DRR? 1 3 1 2\n").partition("END_HEADER \n")
    # Each line of the header but its end is a key and a value.
    fields = dict(line[1:].split("=") for line in header.splitlines()[:-1])
    found = {key.strip(): value.strip() for key, value in fields.items()}
    assert (found["NDATA"], found["SEPARATOR"], found["DIM"]) == ("3", "32", "2")
    assert float(found["SAMPLE_TIME"]) == 50e-6
    names = [found["NAME0"], found["NAME1"]]
    assert [
        int(name[name.find(word) + 4 :]) for name, word in zip(names, ("axis", "chan"), strict=True)
    ] == [1, 1]
    assert len(values.splitlines()) == 3
    assert controller.ask("WGO 1 0\nERR?\n") == "0\n"


@pytest.mark.confirms(
    "pi_gcs2",
    "pi-gcs2",
    part="servo time, memory, errors of wave generators",
    by="E-727 manual E727T0005, pages 67 and 108; QMI's list of errors",
    kind="manual",
)
def test_numbers_of_the_manual() -> None:
    """An E-727 has 50 µs, 262144 points for 8 tables, and these errors."""
    controller = Controller()
    assert controller.ask("SPA? 1 0x0E000200\n") == "1 0xE000200=5e-05\n"
    assert controller.ask("SPA? 1 0x16000200\n") == "1 0x16000200=262144\n"
    assert controller.ask("TNR?\n") == "8\n"
    assert {67, 73, 75, 400, 402, 403, 404, 405, 406} <= ERRORS.keys()


@pytest.mark.parametrize(
    ("request_", "error"),
    [
        ("WAV 1 X PNT 1 28 " + " ".join("1" * 28), 24),  # 33 arguments
        ("WAV 1 X PNT 1 2 1", 404),
        ("WAV 9 X PNT 1 1 1", 400),
        ("WAV 1 X LIN 1 1 1 1 0 0", 402),
        ("WAV 1 & PNT 5 1 1", 405),
        ("WGO 1 1", 75),
        ("WGO 1 2", 406),
        ("WGO 3 1", 400),
        ("WGC 1 -1", 17),
        ("WTR 0 0 0", 17),
        ("DRC 9 1 2", 17),
        ("DRC 1 1 99", 17),
        ("GWD? 1 5 1", 405),
        ("SPA? 1 0x123", 54),
        ("WSL 1", 24),
    ],
)
def test_refusals(request_: str, error: int) -> None:
    """A refused command has no reply, and its error is reported."""
    assert Controller().error(request_) == error


def test_memory_is_shared() -> None:
    """All tables together have 262144 points; a cleared one gives its own back."""
    controller = Controller()
    waves = controller.emulator._waves  # noqa: SLF001 - to fill the memory at once
    waves.tables[2] = [0.0] * 262_143
    assert controller.error("WAV 1 X PNT 1 2 1 1") == 67
    assert controller.error("WCL 2\nWAV 1 X PNT 1 2 1 1") == 0
    assert controller.ask("WAV? 1 1\n") == "1 1=2\n"


def test_wave_is_played_by_the_servo_clock() -> None:
    """Each point lasts as many servo cycles as the rate; the end is held and nothing moves on."""
    controller = Controller()
    controller.load(1.0, 2.0, 3.0, cycles=2)
    controller.error("WTR 0 4 0\nWGO 1 1")
    controller.wait(4 * SERVO_NS)
    assert controller.played_v() == [1.0]
    controller.wait(SERVO_NS)
    assert controller.played_v() == [1.0, 2.0]
    assert controller.ask("\x09WGI? 1\n") == "1\n1=2\n"
    controller.wait(100 * MS)
    assert controller.played_v() == [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]
    assert controller.ask("\x09WGN? 1\nVOL? 1\n") == "0\n1=2\n1=3.000000\n"


def test_setpoint_is_refused_while_playing() -> None:
    """SVA of an axis whose generator runs is error 73; the other axes are free."""
    controller = Controller()
    controller.load(1.0, 2.0)
    controller.error("WGO 1 1")
    assert controller.error("SVA 1 5") == 73
    assert controller.error("SVA 2 5") == 0
    assert controller.error("WSL 1 2") == 73
    assert controller.error("WAV 1 X PNT 1 1 1") == 73
    assert controller.error("WGO 1 0") == 0
    assert controller.error("SVA 1 5") == 0
    assert controller.rig.drive_v == [5.0, 5.0]


def test_stop_holds_and_a_start_begins_anew() -> None:
    """A stopped generator keeps its value; the next start begins with the first point."""
    controller = Controller()
    controller.load(1.0, 2.0, 3.0, 4.0)
    controller.error("WGO 1 1")
    controller.wait(3 * SERVO_NS)
    controller.error("WGO 1 0")
    controller.wait(10 * MS)
    assert controller.played_v() == [1.0, 2.0, 3.0]
    controller.error("WGO 1 1")
    controller.wait(SERVO_NS)
    assert controller.played_v()[-1] == 1.0


def test_stop_byte_ends_a_play() -> None:
    """#24 stops the generators and sets error 10."""
    controller = Controller()
    controller.load(1.0, 2.0)
    controller.error("WGO 1 1")
    assert controller.ask("\x09") == "1\n"
    assert controller.error("\x18") == 10
    assert controller.ask("\x09") == "0\n"


def test_start_at_the_end_moves_the_offset() -> None:
    """With 0x101 each cycle begins where the last one ended, and WOS keeps that."""
    controller = Controller()
    controller.load(0.0, 2.0, cycles=3)
    controller.error("WGO 1 0x101")
    controller.wait(100 * MS)
    assert controller.played_v() == [0.0, 2.0, 2.0, 4.0, 4.0, 6.0]
    assert controller.ask("WOS? 1\n") == "1=6.0\n"
    controller.error("WGO 1 1")
    controller.wait(SERVO_NS)
    assert controller.played_v()[-1] == 6.0
    controller.wait(100 * MS)
    controller.error("WOS 1 0\nWGO 1 1")
    controller.wait(SERVO_NS)
    assert controller.played_v()[-1] == 0.0


def test_recorder_starts_with_the_generators() -> None:
    """A position is that before the point of its servo cycle, a voltage the one of that point."""
    controller = Controller()
    controller.load(10.0, 20.0, 30.0, cycles=1)
    controller.error("DRC 1 1 2 2 1 7\nRTR 1\nWGO 1 1")
    controller.wait(3 * SERVO_NS)
    assert controller.ask("DRL? 1\n") == "1=3\n"
    assert controller.array("DRR? 1 3 1 2", 3, 2) == [[0, 10], [2, 20], [4, 30]]
    controller.wait(2 * SERVO_NS)
    assert controller.array("DRR? 4 2 1", 2) == [[6], [6]]
    controller.error("RTR 2\nWGO 1 1")
    controller.wait(4 * SERVO_NS)
    assert controller.array("DRR? 1 2 2", 2) == [[10], [30]]


def test_recorder_ends_when_it_is_full() -> None:
    """Each of the 8 tables has its share of the points."""
    controller = Controller(1)
    controller.load(1.0, cycles=1)
    controller.error("WGO 1 1")
    controller.wait(2000 * MS)
    assert controller.ask("DRL? 8\n") == "8=32768\n"


@pytest.mark.parametrize(
    "frame",
    [
        b"# NDATA = 2 \n# END_HEADER \n1 2 \n3\n0\n",
        b"# NDATA = 2 \n# END_HEADER \n1 2 \n3 nan\n0\n",
        b"# NDATA = 2 \n1 2 \n3 4\n0\n",
        b"# NDATA = 2 \n# END_HEADER \n1 2 \n3 x\n0\n",
        b"# END_HEADER \n1 2\n0\n",
    ],
)
def test_other_arrays_are_garbage(frame: bytes) -> None:
    """A reply with other rows, columns or words is no array."""
    assert array_length(frame) == len(frame)
    with pytest.raises(LineFault, match="not 2 rows of 2 values"):
        array_rows(frame, 2, 2)


def test_frames_of_arrays() -> None:
    """A frame ends with the reply to ERR?; after an error that is all."""
    whole = b"# NDATA = 1 \n# END_HEADER \n1.5\n0\n"
    assert [array_length(whole[:n]) for n in range(len(whole))] == [0] * len(whole)
    assert array_length(whole + b"5\n") == len(whole)
    assert array_length(b"405\n") == 4
    assert array_length(b"x\n405\n") == -2
