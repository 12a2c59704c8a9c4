"""Bounds of memory and time that one process sets for another."""

import subprocess
import sys
from resource import RLIMIT_AS, RLIMIT_CPU, prlimit

from piezod.resource_limits import bound_other

SELF = """from piezod.resource_limits import bound
bound(5 * 10**8, 7); print('bounded'); bytearray(10**9)"""


def test_process_that_was_started_gets_both_bounds() -> None:
    """The kernel keeps them; a process that has ended meanwhile is no error."""
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    bound_other(process.pid, 10**9, 7)
    found = [prlimit(process.pid, kind)[0] for kind in (RLIMIT_AS, RLIMIT_CPU)]
    process.communicate(b"\n")
    bound_other(process.pid, 10**9, 7)

    assert found == [10**9, 7]


def test_memory_beyond_the_bound_is_an_error() -> None:
    """A bounded process cannot take the memory of the machine."""
    done = subprocess.run([sys.executable, "-c", SELF], capture_output=True, text=True, check=False)

    assert done.stdout == "bounded\n"
    assert "MemoryError" in done.stderr
