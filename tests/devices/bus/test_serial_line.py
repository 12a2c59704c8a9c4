"""A serial port as a line, with a pty in place of the port."""

import errno
import os
import pty
import select
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from threading import Event, Thread

import pytest

from piezod.devices.bus.line import Line, LineFault, NoticingLine
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError

LONG_NS = 10_000_000_000
SHORT_NS = 1_000_000


class Cable:
    """A pty at a path, which can be pulled and plugged in again."""

    def __init__(self, path: Path) -> None:
        self.path, self.device = path, -1
        self._kept: list[int] = []
        self.plug()

    def plug(self) -> None:
        """Plug it in, under a new device path."""
        self.device, slave = pty.openpty()
        tty.setraw(slave)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)

    def keep(self) -> None:
        """Occupy the device path after a pull."""
        self._kept.append(os.open(self.path, os.O_RDWR | os.O_NOCTTY))

    def pull(self) -> None:
        """Pull it out."""
        with suppress(OSError):
            os.close(self.device)
        self.path.unlink(missing_ok=True)

    def heard(self, n: int) -> bytes:
        """Wait until the device has received this many bytes."""
        got = b""
        while len(got) < n:
            got += os.read(self.device, n)
        return got

    def end(self) -> None:
        self.pull()
        for fd in self._kept:
            os.close(fd)


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    """Yield a cable that is plugged in."""
    found = Cable(tmp_path / "port")
    yield found
    found.end()


@pytest.fixture
def line(cable: Cable) -> Iterator[SerialLine]:
    """Yield an open line over the cable."""
    found = SerialLine(str(cable.path), 115_200)
    found.open()
    yield found
    found.close()


def test_line_is_one(line: SerialLine, cable: Cable) -> None:
    """It implements `Line` and `NoticingLine`, and reports its port."""
    assert isinstance(line, NoticingLine)
    as_line: Line = line
    assert as_line.where == str(cable.path)


def test_bytes_go_both_ways_as_they_are(line: SerialLine, cable: Cable) -> None:
    """All 256 byte values pass unchanged, control characters included."""
    every = bytes(range(256))
    line.send(every)
    sent = cable.heard(256)
    os.write(cable.device, every)
    got = b""
    while len(got) < 256:
        got += line.receive(LONG_NS)

    assert (sent, got) == (every, every)


@pytest.mark.parametrize("within_ns", [0, SHORT_NS])
def test_nothing_came(line: SerialLine, within_ns: int) -> None:
    """It returns no bytes, with or without a wait, and raises no fault."""
    assert line.receive(within_ns) == b""


def test_bytes_before_opening_are_dropped(cable: Cable) -> None:
    """A line starts with empty buffers."""
    line = SerialLine(str(cable.path), 9600)
    line.open()
    os.write(cable.device, b"old")
    line.open()
    got = line.receive(0)
    line.close()

    assert got == b""


def test_nothing_of_a_settling_device_is_kept(cable: Cable) -> None:
    """Bytes that come while the device settles are dropped, and `open` waits for that time."""
    settle_s = 0.2
    line = SerialLine(str(cable.path), 9600, settle_s=settle_s)
    talking = Thread(target=_talk_once_opened, args=(cable.device,))
    talking.start()
    begin_ns = line.now_ns()
    line.open()
    took_ns = line.now_ns() - begin_ns
    talking.join()
    got = line.receive(0)
    line.close()

    assert took_ns >= settle_s * 1e9
    assert got == b""


def _talk_once_opened(device: int) -> None:
    """Send a banner as soon as the port has been opened."""
    ended, poll = Event(), select.poll()
    poll.register(device, select.POLLIN)
    while any(events & select.POLLHUP for _, events in poll.poll(0)):
        ended.wait(0.001)
    os.write(device, b"firmware 1.3.5 ready\r\n")


def test_port_that_goes_while_its_device_settles_is_absent(cable: Cable) -> None:
    """It is reported as an absent device, and released."""
    line = SerialLine(str(cable.path), 9600, settle_s=60.0)
    line_closed = Thread(target=_pull_once_opened, args=(cable,))
    line_closed.start()
    with pytest.raises(DeviceUnavailableError):
        line.open()
    line_closed.join()


def _pull_once_opened(cable: Cable) -> None:
    _talk_once_opened(cable.device)
    cable.pull()


def test_closing_leaves_dtr_raised(cable: Cable, line: SerialLine) -> None:
    """The kernel keeps DTR raised when the port is closed: its edge resets some boards."""
    end = os.open(cable.path, os.O_RDWR | os.O_NOCTTY)
    control = termios.tcgetattr(end)[2]
    os.close(end)

    assert line.where == str(cable.path)
    assert not control & termios.HUPCL


@pytest.fixture
def flushed(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Record all flushes of buffers; a pty has no buffer to hold bytes back."""
    found: list[int] = []
    monkeypatch.setattr("termios.tcflush", lambda _fd, queue: found.append(queue))
    return found


def test_request_that_was_not_answered_never_goes_later(
    line: SerialLine, flushed: list[int]
) -> None:
    """Bytes that are unsent when the reply is overdue are dropped."""
    line.send(b"SVA 100\n")
    line.receive(0)
    looked = flushed.copy()
    line.receive(SHORT_NS)

    assert (looked, flushed) == ([], [termios.TCOFLUSH])


def _receive(line: SerialLine) -> object:
    return line.receive(0)


def _receive_waiting(line: SerialLine) -> object:
    return line.receive(LONG_NS)


def _send(line: SerialLine) -> object:
    line.send(b"x")
    return None


@pytest.mark.parametrize("call", [_receive, _receive_waiting, _send])
@pytest.mark.parametrize("state", ["pulled", "closed", "never opened"])
def test_line_that_is_gone_is_a_fault(
    cable: Cable, call: Callable[[SerialLine], object], state: str
) -> None:
    """Every call raises `DISCONNECTED` without waiting."""
    line = SerialLine(str(cable.path), 115_200)
    if state != "never opened":
        line.open()
    if state == "closed":
        line.close()
    cable.pull()
    for _ in range(2):
        with pytest.raises(LineFault) as fault:
            call(line)
        assert fault.value.flag == DeviceFlag.DISCONNECTED
    line.close()


def test_partial_write(line: SerialLine, flushed: list[int]) -> None:
    """If flow control stops the device, only a part is sent, and the rest never."""
    with pytest.raises(LineFault, match="of 1000000 bytes went out") as fault:
        line.send(bytes(1_000_000))

    assert fault.value.flag == DeviceFlag.PARTIAL_WRITE
    assert flushed == [termios.TCOFLUSH]


def test_short_writes_are_gone_on_with(
    line: SerialLine, cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All bytes are sent even if the kernel accepts one at a time, or none for a while."""
    write, calls = os.write, iter(range(100))

    def byte_by_byte(fd: int, data: bytes) -> int:
        if next(calls) % 2:
            raise BlockingIOError
        return write(fd, data[:1])

    with monkeypatch.context() as patched:
        patched.setattr("os.write", byte_by_byte)
        line.send(b"hello")

    assert cable.heard(5) == b"hello"


def test_port_is_held_alone(line: SerialLine) -> None:
    """A second opening is refused until the first is closed."""
    second = SerialLine(line.where, 115_200)
    with pytest.raises(DeviceUnavailableError, match="held by another program"):
        second.open()
    line.close()
    second.open()
    second.close()


@pytest.mark.parametrize(
    ("port", "why"),
    [("/dev/serial/by-id/none", "no port"), ("/dev/null", "cannot be opened")],
)
def test_port_that_is_none(port: str, why: str) -> None:
    """The message states the path."""
    with pytest.raises(DeviceUnavailableError, match=f"{why}.*{port}|{port} {why}"):
        SerialLine(port, 115_200).open()


def test_no_access(cable: Cable, monkeypatch: pytest.MonkeyPatch) -> None:
    """The message states who may use the port."""

    def refuse(*_: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(DeviceUnavailableError, match="has to be in the group"):
        SerialLine(str(cable.path), 115_200).open()


def test_kernel_that_refuses_is_told_as_a_lock(
    cable: Cable, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A port that the kernel keeps for another program is reported like a locked one."""

    def refuse(*_: object) -> int:
        raise OSError(errno.EBUSY, "Device or resource busy")

    monkeypatch.setattr("os.open", refuse)
    with pytest.raises(DeviceUnavailableError, match="held by another program"):
        SerialLine(str(cable.path), 115_200).open()


def test_port_that_goes_while_it_is_opened(
    line: SerialLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If the port vanishes during opening, it is released and can be opened again."""

    def gone(path: Path) -> Path:
        raise FileNotFoundError(errno.ENOENT, "gone", str(path))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "resolve", gone)
        with pytest.raises(DeviceUnavailableError):
            line.open()

    line.open()


def test_other_path_is_noticed_once(line: SerialLine, cable: Cable) -> None:
    """A port that returns under another device path is reported once; the same path is not."""
    line.open()
    same = line.take_noticed()
    cable.keep()
    cable.pull()
    cable.plug()
    line.open()
    other, again = line.take_noticed(), line.take_noticed()

    assert (same, other, again) == (set(), {DeviceFlag.OTHER_PATH}, set())


def test_clock_is_monotonic(line: SerialLine) -> None:
    """The line's clock does not go back."""
    first = line.now_ns()
    line.receive(SHORT_NS)

    assert line.now_ns() >= first
