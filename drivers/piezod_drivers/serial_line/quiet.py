"""Reads from a line until the device is silent."""

from piezod.devices.bus.line import Line


def read_until_quiet(line: Line, quiet_ns: int, most_chunks: int) -> bytes:
    """Return all bytes that come until the line is quiet. Waits, so not real-time safe.

    Args:
        line: The open line.
        quiet_ns: The line is quiet after this time without a byte, in ns.
        most_chunks: Highest number of reads, for a device that is never quiet.

    Raises:
        LineFault: If the line is lost.
    """
    got = b""
    for _ in range(most_chunks):
        more = line.receive(quiet_ns)
        if not more:
            break
        got += more
    return got
