"""A TCP connection as a line, with a socket of this process at its end."""

import socket
from collections.abc import Callable, Iterator

import pytest

from piezod.devices.bus.line import LineFault
from piezod.devices.bus.tcp_line import TcpLine
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceUnavailableError
from tests.daemon.waiting import eventually

LONG_NS = 10_000_000_000
SHORT_NS = 1_000_000


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    """Yield a socket that listens at a port of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        yield found


@pytest.fixture
def line(listener: socket.socket) -> Iterator[TcpLine]:
    """Yield an open line to the listener."""
    found = TcpLine(*listener.getsockname(), unacknowledged_s=0.2)
    found.open()
    yield found
    found.close()


@pytest.fixture
def device(listener: socket.socket, line: TcpLine) -> Iterator[socket.socket]:
    """Yield the device end of the line."""
    assert line.where
    end, _ = listener.accept()
    with end:
        yield end


def test_bytes_go_both_ways(line: TcpLine, device: socket.socket) -> None:
    """Bytes are sent and received."""
    line.send(b"ask")
    asked = device.recv(100)
    device.send(b"answer")

    assert (asked, line.receive(LONG_NS)) == (b"ask", b"answer")


@pytest.mark.parametrize("within_ns", [0, SHORT_NS])
def test_nothing_came(line: TcpLine, within_ns: int) -> None:
    """It returns no bytes, with or without a wait, and raises no fault."""
    assert line.receive(within_ns) == b""


def _receive(line: TcpLine) -> object:
    return line.receive(LONG_NS)


def _send(line: TcpLine) -> object:
    line.send(b"x")
    return line.receive(LONG_NS)  # the kernel does not refuse the first send after the end yet


@pytest.mark.parametrize("call", [_receive, _send])
@pytest.mark.parametrize("state", ["reset", "ended", "closed"])
def test_connection_that_is_gone_is_a_fault(
    line: TcpLine, device: socket.socket, call: Callable[[TcpLine], object], state: str
) -> None:
    """Every call raises `DISCONNECTED`."""
    if state == "closed":
        line.close()
    if state == "reset":
        device.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    device.close()
    for _ in range(2):
        with pytest.raises(LineFault) as fault:
            call(line)
        assert fault.value.flag == DeviceFlag.DISCONNECTED


@pytest.mark.usefixtures("device")
def test_partial_write_ends_the_connection(line: TcpLine) -> None:
    """The sent part cannot be taken back, so the next call is refused."""
    with pytest.raises(LineFault, match="bytes went out") as fault:
        line.send(bytes(100_000_000))
    with pytest.raises(LineFault) as next_fault:
        line.send(b"next")

    assert fault.value.flag == DeviceFlag.PARTIAL_WRITE
    assert next_fault.value.flag == DeviceFlag.DISCONNECTED


@pytest.mark.usefixtures("device")
def test_nothing_acknowledged_is_half_open(line: TcpLine) -> None:
    """A device that accepts no bytes for too long is disconnected; the fault says so."""
    flags = []

    def given_up() -> bool:
        try:
            line.send(bytes(10_000))
            line.receive(0)
        except LineFault as fault:
            flags.append(fault.flag)
        return DeviceFlag.HALF_OPEN in flags

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(line, "close", lambda: None)  # goes on, so that the kernel has to give up
        eventually(given_up)

    assert set(flags) <= {DeviceFlag.PARTIAL_WRITE, DeviceFlag.HALF_OPEN}


def test_nobody_listens(listener: socket.socket) -> None:
    """The message states the address."""
    host, port = listener.getsockname()
    listener.close()
    with pytest.raises(DeviceUnavailableError, match=f"no connection to {host}:{port}"):
        TcpLine(host, port).open()


def test_opening_again_connects_anew(listener: socket.socket, line: TcpLine) -> None:
    """The earlier connection is closed."""
    first, _ = listener.accept()
    line.open()
    second, _ = listener.accept()
    line.send(b"x")
    with first, second:
        assert first.recv(10) == b""
        assert second.recv(10) == b"x"


def test_clock_is_monotonic(line: TcpLine) -> None:
    """The line's clock does not go back."""
    first = line.now_ns()
    line.receive(SHORT_NS)

    assert line.now_ns() >= first
