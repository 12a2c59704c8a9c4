"""Work for a disk or a terminal that takes nothing: it is dropped and counted, and nobody waits."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from piezod.daemon.background import Background, BackgroundStream
from piezod.daemon.logging import logger, set_up_logging
from piezod.daemon.stores.audit import AuditLog
from piezod.daemon.stores.audit_queue import AuditQueue
from tests.daemon.waiting import eventually


class StalledDisk(AuditLog):
    """An audit log whose disk stands still until `works` is set."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.works = threading.Event()

    def _append(self, line: bytes) -> None:
        self.works.wait(60.0)
        super()._append(line)


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    """Return the ends of a pipe."""
    ends = os.pipe()
    yield ends
    os.close(ends[0])


def test_items_are_consumed_in_order() -> None:
    """All items that fit arrive, in their order."""
    taken: list[int] = []
    background = Background[int]("test", taken.append, taken.append)
    for number in range(100):
        background.put(number)

    assert background.close()
    assert taken == list(range(100))


def test_too_many_items_are_dropped_and_counted() -> None:
    """While the consumer is blocked, putting never waits."""
    goes_on, taken, lost = threading.Event(), list[int](), list[int]()

    def consume(number: int) -> None:
        goes_on.wait(60.0)
        taken.append(number)

    background = Background[int]("test", consume, lost.append, most=3)
    background.put(0)
    eventually(lambda: background.waiting == 0)
    for number in range(1, 10):
        background.put(number)
    assert not background.flush(0.001)
    goes_on.set()
    eventually(lambda: lost)

    assert (taken, lost) == ([0, 1, 2, 3], [6])


def test_log_of_a_stopped_terminal_is_dropped(pipe: tuple[int, int]) -> None:
    """Lines for a stream that nobody reads block nothing; later its reader gets their number."""
    read, write = pipe
    with os.fdopen(write, "w") as terminal, BackgroundStream(terminal) as log:
        set_up_logging(log, {})
        for number in range(3000):
            logger("test").error(f"line {number} {'x' * 200}")
        text = b""
        while b"lines of the log were dropped" not in text:
            text += os.read(read, 1 << 16)

    assert b"line 0 " in text


def test_audit_of_a_stalled_disk_blocks_nothing(tmp_path: Path) -> None:
    """Entries keep the time of their request, and the log has the number of those that are lost."""
    disk = StalledDisk(tmp_path / "audit.jsonl")
    audit = AuditQueue(disk)
    for number in range(1100):
        audit.write(1000, "ann", "", f"estop {number}", accepted=True)
    disk.works.set()
    eventually(lambda: "missing" in audit.last(1)[0].what)

    newest, *entries = audit.last(2000)
    audit.close()
    assert newest.what == f"{1100 - len(entries)} entries are missing before this one"
    assert entries[-1].what == "estop 0"
    assert entries[0].when < newest.when
