"""Pulses of a table as a board gives them: some numbers, in place of a mask for each point."""

from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from piezod.devices.scan_table import Mask
from piezod.errors import DeviceError
from piezod_drivers.serial_line.piezo_board.codec import LINES

_WHOLE = 65_535


class LinePulses(NamedTuple):
    """Arguments of the request `L`, in rows of the period."""

    point: int  #: From a pulse to the next one in a line; 0 for none.
    line: int  #: 1 if each line pulses at its first row.
    length: int  #: From a line to the next one; 0 if there is one.
    active: int  #: Rows of a line in which points pulse.
    skip: int  #: Rows before the first line.
    frame: int  #: Rows from the first line in which the frame is high.

    @classmethod
    def of(cls, mask: Mask) -> Self:
        """Return the pulses whose rising edges are those of a mask, shape (n,).

        Raises:
            DeviceError: If a board cannot pulse so.
        """
        points, lines, frames = (_rising(mask, line) for line in range(LINES))
        point = int(np.min(np.diff(points))) if points.size > 1 else int(points.size)
        groups = points[np.diff(points, prepend=-_WHOLE) != point]
        starts = lines if lines.size else groups if groups.size else frames
        length = int(starts[1] - starts[0]) if starts.size > 1 else 0
        per_line = points.size // max(starts.size, 1)
        skip = int(starts[0]) if starts.size else 0
        low = np.flatnonzero(mask[skip:] >> (LINES - 1) & 1 == 0)
        found = cls(
            point,
            int(lines.size > 0),
            length,
            max(per_line - 1, 0) * point + 1 if per_line else 0,
            skip,
            min(int(low[0]) if low.size else mask.size - skip, _WHOLE - 1),
        )
        given_points, given_lines = found.rising(mask.size)
        same = np.array_equal(given_points, points) and np.array_equal(given_lines, lines)
        if not same or frames.tolist() != [skip][: found.frame]:
            raise DeviceError(
                "the pulses are not those that a board can give: points at equal distances from "
                "the beginning of lines of equal length, one frame with the first line"
            )
        return found

    @property
    def request(self) -> str:
        """The request."""
        return " ".join(("L", *map(str, self)))

    def rising(self, n_rows: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Return the rows, of so many, at which points and lines pulse."""
        starts = np.arange(self.skip, n_rows, self.length or n_rows)
        within = np.arange(0, self.active, self.point) if self.point else np.arange(0)
        points = (starts[:, None] + within).ravel()
        return points[points < n_rows], starts if self.line else starts[:0]


def _rising(mask: Mask, line: int) -> npt.NDArray[np.int64]:
    levels = (mask >> line & 1).astype(np.int8)
    return np.flatnonzero(np.diff(levels, prepend=np.int8(0)) == 1)
