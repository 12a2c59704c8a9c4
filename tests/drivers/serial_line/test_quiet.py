"""Reading until a line is quiet."""

from piezod_drivers.serial_line.quiet import read_until_quiet
from tests.drivers.serial_line.scripted_line import MS, T0_NS, ScriptedLine

QUIET_NS = 50 * MS


def test_all_that_comes_is_read_until_it_is_quiet() -> None:
    """Parts in quick succession are read together; bytes after a silence are left."""
    line = ScriptedLine()
    line.open()
    for part, after_ns in ((b"a", 10 * MS), (b"b", 40 * MS), (b"c", 60 * MS)):
        line.comes(part, after_ns)

    assert read_until_quiet(line, QUIET_NS, 20) == b"ab"
    assert line.receive(QUIET_NS) == b"c"


def test_nothing_may_come() -> None:
    """A quiet line is read once."""
    line = ScriptedLine()
    line.open()

    assert read_until_quiet(line, QUIET_NS, 20) == b""
    assert line.now_ns() == T0_NS + QUIET_NS


def test_a_line_that_is_never_quiet_is_left() -> None:
    """At most the given number of parts is read."""
    line = ScriptedLine()
    line.open()
    for _ in range(5):
        line.comes(b"x", MS)

    assert read_until_quiet(line, QUIET_NS, 3) == b"xxx"
