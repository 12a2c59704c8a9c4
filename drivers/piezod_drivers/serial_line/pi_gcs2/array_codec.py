"""Replies with many values, such as a wave table or a record: a header, and a line for each point.

Every line but the last ends with a space before its line feed. Pure.
"""

import re
from math import isfinite
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.serial_line.gcs.errors import fault_of

_END: Final = re.compile(rb"(?<! )\n")
_CODE: Final = re.compile(rb"([+-]?[0-9]{1,5})\n")
_HEADER_END: Final = re.compile(rb"# ?END_HEADER *\n")


def array_length(data: bytes) -> int:
    """Return the length of the reply and of that to `ERR?`, as `Conversation.ask` requires."""
    if not data.startswith(b"#"):
        # After an error only the reply to `ERR?` comes.
        if match := _CODE.match(data):
            return match.end()
        line_feed = data.find(b"\n")
        return -(line_feed + 1) if line_feed >= 0 else 0
    if (end := _END.search(data)) and (code := _END.search(data, end.end())):
        return code.end()
    return 0


def array_rows(frame: bytes, n_rows: int, n_columns: int) -> list[list[float]]:
    """Return the values of a reply, row by row.

    Args:
        frame: The reply, with that to `ERR?`.
        n_rows: Expected number of rows.
        n_columns: Expected number of columns.

    Raises:
        LineFault: The controller's error, or `GARBAGE` if the reply has another form.
    """
    body, code = b"", frame
    if frame.startswith(b"#") and (end := _END.search(frame)):
        body, code = frame[: end.end()], frame[end.end() :]
    error = _CODE.fullmatch(code)
    if error is not None and int(error[1]):
        raise fault_of(int(error[1]))
    rows = _rows(body) if error is not None else []
    if len(rows) == n_rows and all(
        len(row) == n_columns and all(map(isfinite, row)) for row in rows
    ):
        return rows
    what = f"not {n_rows} rows of {n_columns} values, but {len(rows)}: {frame[:80]!r}"
    raise LineFault(DeviceFlag.GARBAGE, what)


def _rows(body: bytes) -> list[list[float]]:
    """Return the lines of numbers behind the header; none if one is no line of numbers."""
    start = _HEADER_END.search(body)
    if start is None:
        return []
    try:
        return [[float(word) for word in line.split()] for line in body[start.end() :].splitlines()]
    except ValueError:
        return []
