"""Listening until a device has said all that it says."""

from piezod_drivers.serial_line.quiet import until_quiet
from tests.drivers.serial_line.scripted_line import MS, T0_NS, ScriptedLine

QUIET_NS = 50 * MS


def test_all_that_comes_is_read_until_it_is_quiet() -> None:
    """Parts that follow each other soon are one; what comes after a silence is left."""
    line = ScriptedLine()
    line.open()
    for part, after_ns in ((b"a", 10 * MS), (b"b", 40 * MS), (b"c", 60 * MS)):
        line.comes(part, after_ns)

    assert until_quiet(line, QUIET_NS, 20) == b"ab"
    assert line.receive(QUIET_NS) == b"c"


def test_nothing_may_come() -> None:
    """A line that is quiet already is listened to once."""
    line = ScriptedLine()
    line.open()

    assert until_quiet(line, QUIET_NS, 20) == b""
    assert line.now_ns() == T0_NS + QUIET_NS


def test_a_line_that_is_never_quiet_is_left() -> None:
    """No more parts are read than somebody wants."""
    line = ScriptedLine()
    line.open()
    for _ in range(5):
        line.comes(b"x", MS)

    assert until_quiet(line, QUIET_NS, 3) == b"xxx"
