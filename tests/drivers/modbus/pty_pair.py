"""Two connected serial ports, for two programs that each need a port."""

import os
import select
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def wired_ports() -> Iterator[tuple[str, str]]:
    """Yield the paths of two ports; bytes written to one can be read from the other."""
    ends = [os.openpty() for _ in range(2)]
    for _, port in ends:
        tty.setraw(port)
    stop_reader, stop_writer = os.pipe()
    wire = threading.Thread(target=_carry, args=(ends[0][0], ends[1][0], stop_reader))
    wire.start()
    try:
        yield os.ttyname(ends[0][1]), os.ttyname(ends[1][1])
    finally:
        os.write(stop_writer, b"x")
        wire.join()
        for fd in (*ends[0], *ends[1], stop_reader, stop_writer):
            os.close(fd)


def _carry(one: int, other: int, stop: int) -> None:
    while True:
        readable, _, _ = select.select([one, other, stop], [], [])
        if stop in readable:
            return
        for end, opposite in ((one, other), (other, one)):
            if end in readable:
                os.write(opposite, os.read(end, 4096))
