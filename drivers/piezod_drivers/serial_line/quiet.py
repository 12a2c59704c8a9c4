"""Listening until a device has said all that it says."""

from piezod.devices.bus.line import Line


def until_quiet(line: Line, quiet_ns: int, most_chunks: int) -> bytes:
    """Return all that comes until the line is quiet; waits, and is not for the loop.

    Args:
        line: The line, open.
        quiet_ns: After so long without a byte it is quiet, in ns.
        most_chunks: Of a device that is never quiet, no more than so many parts are read.

    Raises:
        LineFault: If the line is gone.
    """
    told = b""
    for _ in range(most_chunks):
        more = line.receive(quiet_ns)
        if not more:
            break
        told += more
    return told
