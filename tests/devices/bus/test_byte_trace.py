"""The bytes on serial ports and TCP connections, as people see them."""

import logging
import os
import pty
import socket
import tty
from collections.abc import Iterator
from contextlib import closing

import pytest

from piezod.devices.bus.byte_trace import shown, tracing
from piezod.devices.bus.line import Line
from piezod.devices.bus.serial_line import SerialLine
from piezod.devices.bus.tcp_line import TcpLine

LONG_NS = 10_000_000_000


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"OK\r\n", r"'OK\r\n' (4F 4B 0D 0A)"),
        (b"\xde\x07", r"'\xde\x07' (DE 07)"),
        (b"", "'' ()"),
        (b"a" * 66, f"'{'a' * 64}' ({' '.join(['61'] * 64)}) and 2 more"),
    ],
)
def test_bytes_are_text_and_hexadecimal(data: bytes, text: str) -> None:
    """Bytes are shown as text and as numbers; the end of a long message is counted."""
    assert shown(data) == text


@pytest.fixture(params=["serial", "tcp"])
def line_with_far_end(request: pytest.FixtureRequest) -> Iterator[tuple[Line, int]]:
    """Yield an open line of each kind, and the descriptor of its far end."""
    if request.param == "serial":
        far_end, slave = pty.openpty()
        tty.setraw(slave)
        line: Line = SerialLine(os.ttyname(slave), 9600)
        line.open()
        yield line, far_end
        line.close()
        os.close(far_end)
        os.close(slave)
        return
    with closing(socket.create_server(("127.0.0.1", 0))) as server:
        line = TcpLine(*server.getsockname())
        line.open()
        with closing(server.accept()[0]) as peer:
            yield line, peer.fileno()
        line.close()


def test_both_directions_are_traced(line_with_far_end: tuple[Line, int]) -> None:
    """A traced line reports each sent and each received message, with its port."""
    line, far_end = line_with_far_end
    lines: list[str] = []
    with tracing(lines.append):
        line.send(b"POS?\n")
        os.read(far_end, 100)
        os.write(far_end, b"1=2\n")
        line.receive(LONG_NS)
    line.send(b"later\n")

    assert [each.partition(" ")[2] for each in lines] == [
        rf"{line.where} sent 'POS?\n' (50 4F 53 3F 0A)",
        rf"{line.where} got  '1=2\n' (31 3D 32 0A)",
    ]


def test_a_debug_log_has_the_bytes(
    line_with_far_end: tuple[Line, int], caplog: pytest.LogCaptureFixture
) -> None:
    """A program that sets the logger `piezod.bytes` to DEBUG finds the bytes in its log."""
    line, _ = line_with_far_end
    line.send(b"quiet\n")
    with caplog.at_level(logging.DEBUG, "piezod.bytes"):
        line.send(b"loud\n")

    assert [record.getMessage() for record in caplog.records] == [
        rf"{line.where} sent 'loud\n' (6C 6F 75 64 0A)"
    ]
