"""The table of a scan: a line that repeats, its offset and size in each sweep, and its pulses.

A frame of a million pixels has millions of points. They are a few curves: the fast axis repeats its
line, the slow one goes from level to level in the turns. So a table has the curves, and the points
of some sweeps are made when they are loaded.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.player import Comparison, EdgeWaits

FloatArray: TypeAlias = npt.NDArray[np.float64]
Mask: TypeAlias = npt.NDArray[np.uint8]
"""A bit for each line of pulses, the lowest for line 1."""


class ScanTable(NamedTuple):
    """Voltages of a scan: `offset + scale · line`, where both go to the next ones in the turns."""

    axes: tuple[str, ...]  #: Names of the axes, in the order of columns.
    interval_ns: int  #: Time between two points, in ns.
    lead_in_v: FloatArray  #: (l, axes) voltages before the first sweep, in V.
    line_v: FloatArray  #: (p · m, axes) shape of p sweeps of m points, which repeat, in V.
    offset_v: FloatArray  #: (sweeps, axes) offset of each sweep, in V.
    scale: FloatArray  #: (sweeps, axes) size of the line in each sweep.
    blend: FloatArray  #: (m, axes) share of the next sweep's offset and scale, 0 to 1.
    pulses: Mask  #: (q · m,) pulses of q sweeps, which repeat; empty for none.
    framed: int = 0  #: Line of pulses, as a bit, that pulses once, at the first point.
    frame_points: int = 0  #: Points for which that pulse is high.
    pause: int = 0  #: Point of a sweep at which the fast axis stands still: a scan may pause there.
    #: Where the device waits for edges, counted from the first sweep; None for nowhere.
    edges: EdgeWaits | None = None
    tail: int = 0  #: Points behind the last sweep, at its last voltages, in which edges count.
    #: Pulses that the device itself gives by the reading of the axis of this column; None for none.
    compared: Comparison | None = None

    @property
    def is_whole(self) -> bool:
        """Whether all sweeps are loaded together, without what precedes them."""
        return self.edges is not None or self.compared is not None

    @property
    def sweeps(self) -> int:
        """Number of sweeps."""
        return len(self.offset_v)

    @property
    def points(self) -> int:
        """Number of points of a sweep."""
        return len(self.blend)

    @property
    def first_v(self) -> FloatArray:
        """First voltage of each axis, in V, shape (axes,)."""
        first = self.lead_in_v[0] if len(self.lead_in_v) else self.rows(0, 1)[0]
        return np.asarray(first)

    @property
    def n_rows(self) -> int:
        """Number of points of all sweeps and the tail."""
        return self.sweeps * self.points + self.tail

    def rows(self, first: int, end: int) -> FloatArray:
        """Return the voltages of points, shape (end - first, axes), in V.

        Args:
            first: Index of the first point of all sweeps; negative for the turn before them.
            end: Index behind the last one.
        """
        m, axes = self.blend.shape
        if end > self.sweeps * m:  # the tail
            last = self.sweeps * m
            rows = self.rows(min(first, last - 1), last)
            return np.concatenate((rows, np.repeat(rows[-1:], end - last, axis=0)))[first - end :]
        begin = first // m
        sweeps = np.arange(begin, -(-end // m))
        lines = self.line_v.reshape(-1, m, axes)[sweeps % (len(self.line_v) // m)]
        offset, scale = self._levels(sweeps[:, None], self.blend)
        rows = (offset + scale * lines).reshape(-1, axes)
        return np.asarray(rows[first - begin * m : end - begin * m])

    def _levels(self, sweep: npt.NDArray[np.int64], blend: FloatArray) -> list[FloatArray]:
        """Return offset and scale on the way to the next sweep; before the first one, its own."""
        here, after = (np.clip(sweep + k, 0, self.sweeps - 1) for k in (0, 1))
        return [
            np.asarray(value[here] + (value[after] - value[here]) * blend)
            for value in (self.offset_v, self.scale)
        ]

    @property
    def run_up_points(self) -> int:
        """Points of a run-up: one period of the line; 0 if the line does not move."""
        return len(self.line_v) if np.any(np.ptp(self.line_v, axis=0)) else 0

    def run_up(self, first: int) -> FloatArray:
        """Return the period of the line that ends before a point, at its offset and scale.

        It brings a stage that has waited there to the motion before the wait.
        """
        sweep, point = divmod(first, self.points)
        offset, scale = self._levels(np.array(sweep), self.blend[point])
        lines = self.line_v[np.arange(first - self.run_up_points, first) % len(self.line_v)]
        return np.asarray(offset + scale * lines)

    @property
    def points_from_pause(self) -> int:
        """Points between the pause before the first sweep and that sweep; 0 if no line moves."""
        return self.points - self.pause if self.run_up_points else 0

    @property
    def points_before(self) -> int:
        """Points of the lead-in and a run-up, which bring a stage to the first sweep."""
        return len(self.lead_in_v) + self.run_up_points

    def before(self, first: int, end: int) -> FloatArray:
        """Return voltages of these points, shape (end - first, axes), in V.

        Args:
            first: Index of the first one, from `-points_before` on: 0 is that of the first sweep.
            end: Index behind the last one, at most 0.
        """
        rows = np.concatenate((self.lead_in_v, self.run_up(0)))
        return rows[len(rows) + first : len(rows) + end]

    def masks(self, first: int, end: int) -> Mask:
        """Return the pulses at points, shape (end - first,); empty without pulses."""
        if not self.pulses.size:
            return self.pulses
        at = np.arange(first, end)
        masks = self.pulses[at % self.pulses.size]
        masks[(at < 0) | (at >= self.sweeps * self.points)] = 0
        masks[(at >= 0) & (at < self.frame_points)] |= np.uint8(self.framed)
        return masks

    def bounds_v(self) -> FloatArray:
        """Return the lowest and the highest voltage of each axis, shape (2, axes), in V.

        Offset and scale of a point are between those of two sweeps, so these are the ends.
        """
        ends = np.stack((self.line_v.min(axis=0), self.line_v.max(axis=0)))
        values = self.offset_v + self.scale * ends[:, None]
        low, high = values.min(axis=(0, 1)), values.max(axis=(0, 1))
        if len(self.lead_in_v):
            low = np.minimum(low, self.lead_in_v.min(axis=0))
            high = np.maximum(high, self.lead_in_v.max(axis=0))
        return np.stack((low, high))

    def largest_step_v(self, place: int) -> float:
        """Return an upper bound of the steps from point to point of an axis, in V.

        Args:
            place: Column of the axis.
        """
        line, scale = self.line_v[:, place], self.scale[:, place]
        along = np.max(np.abs(np.diff(line, append=line[0]))) * np.max(np.abs(scale))
        blending = np.max(np.abs(np.diff(self.blend[:, place], prepend=0.0, append=1.0)))
        changes = np.abs(np.diff(self.offset_v[:, place]))
        changes += np.abs(np.diff(scale)) * np.max(np.abs(line))
        largest = float(along + blending * np.max(changes, initial=0.0))
        if len(self.lead_in_v):
            lead_in = np.append(self.lead_in_v[:, place], self.rows(0, 1)[0, place])
            largest = max(largest, float(np.max(np.abs(np.diff(lead_in)))))
        return largest
