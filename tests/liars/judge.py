"""Judges the writes of a case by the trace of the amplifier."""

from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import nan
from typing import Final, NamedTuple

from tests.liars.config import HIGHEST_V, RATE_HZ, SLEW_V_PER_S, TOLERANCE_V
from tests.liars.process import Row
from tests.liars.stage import possible_um

PERIOD_S: Final = 1.0 / RATE_HZ
ROUNDING_V: Final = 0.002
LOOKED_BACK: Final = 50
"""Number of read-backs, and of steps by itself, that a write is compared with."""
VISIBLE_S: Final = 0.5
"""A read-back that is unlike the write for so long has to be told."""
BEYOND_UM: Final = 0.1 * possible_um(HIGHEST_V, HIGHEST_V)[1]
"""A position so far beyond the widest loop is not possible, as docs/faults.md says: 10 % of the
range."""


class Step(NamedTuple):
    """A write, or the start of a play, and how far it was from the voltage on the stage."""

    t_s: float  #: Its instant, in s.
    drive_v: float  #: What was written, in V.
    output_v: float  #: Voltage on the stage before it, in V.
    shown_v: float  #: Last read-back before it, in V; NaN if there was none.
    #: Distance of the write from the voltage on the stage, less what that has gone by itself since
    #: the last read-back, in V.
    distance_v: float
    allowed_v: float  #: How far it may be, in V.
    own_v: float  #: The write before it, of the same process, in V; NaN if there was none.
    honest: bool  #: Whether the last read-back was right.
    position_um: float  #: Position of the stage before it, in µm; NaN if the process has no sensor.

    @property
    def is_far(self) -> bool:
        """Whether the write is farther from the voltage on the stage than it may be."""
        return self.distance_v > self.allowed_v + ROUNDING_V

    @property
    def has_witness(self) -> bool:
        """Whether anything could tell then that the voltage on the stage was another one.

        That is a right read-back, the own last write or the end of a table if it is in force, or a
        position that the stage cannot have at the read-back.
        """
        if self.honest or abs(self.own_v - self.output_v) <= TOLERANCE_V:
            return True
        lowest_um, highest_um = possible_um(self.shown_v, HIGHEST_V)
        off_um = max(lowest_um - self.position_um, self.position_um - highest_um)
        return off_um > BEYOND_UM

    def __str__(self) -> str:
        return (
            f"{self.t_s:.3f} s: wrote {self.drive_v:.3f} V on {self.output_v:.3f} V, allowed "
            f"{self.allowed_v:.2f} V, read-back {self.shown_v:.3f} V "
            f"({'right' if self.honest else 'wrong'}), last write {self.own_v:.3f} V, "
            f"{self.position_um:.2f} µm"
        )


def steps_of(rows: Sequence[Row], known_after_s: float = 0.0) -> Iterator[Step]:
    """Yield the accepted writes of a trace, and the starts of plays, judged.

    A write may be as far from the voltage on the stage as the slew rate times the age of the last
    read-back that it can follow from and one period, plus the tolerance. What the output has gone
    by itself since that read-back does not count. A play can be started just after
    a read-back, so that one that is older than a period counts as one of a period before.

    Args:
        rows: The trace.
        known_after_s: Age of a read-back that a write can follow from, in s: if a thread of its own
            talks to the amplifier, the read-back just before a write comes too late for it.
    """
    reads, itself = deque[Row](maxlen=LOOKED_BACK), deque[Row](maxlen=LOOKED_BACK)
    last_v, position_um, sensed = nan, nan, True
    for row in rows:
        match row.kind:
            case "opened":
                last_v, sensed = nan, False
            case "sense":
                sensed = True
            case "read":
                reads.append(row)
            case "own" | "late":
                itself.append(row)
            case "play":  # nobody knows where it is
                itself.append(row)
                last_v = nan
            case "end":
                last_v = row.written_v
            case "write" | "start":
                known = [read.t_s for read in reads if read.t_s <= row.t_s - known_after_s]
                since_s = known[-1] if known else row.t_s
                age_s = row.t_s - since_s
                if row.kind == "start":
                    since_s = max(since_s, row.t_s - PERIOD_S)
                itself_v = sum(abs(o.after_v - o.before_v) for o in itself if o.t_s > since_s)
                before = row._replace(position_um=position_um if sensed else nan)
                yield _judged(before, reads[-1] if reads else row, age_s, itself_v, last_v)
                last_v = row.written_v
        position_um = row.position_um


def _judged(row: Row, read: Row, age_s: float, itself_v: float, last_v: float) -> Step:
    """Return a write, judged by the last read-back and the age of the one that it follows from."""
    if row.kind == "start":
        age_s = min(age_s, PERIOD_S)
    return Step(
        row.t_s,
        row.written_v,
        row.before_v,
        read.shown_v,
        distance_v=max(0.0, abs(row.written_v - row.before_v) - itself_v),
        allowed_v=SLEW_V_PER_S * (age_s + PERIOD_S) + TOLERANCE_V,
        own_v=last_v,
        honest=abs(read.shown_v - read.before_v) <= TOLERANCE_V,
        position_um=row.position_um,
    )


def largest_by_itself_v(rows: Sequence[Row]) -> float:
    """Return the largest step that the amplifier made by itself or in a play, in V."""
    kinds = {"own", "play"}
    return max((abs(row.after_v - row.before_v) for row in rows if row.kind in kinds), default=0.0)


def fast_points(rows: Sequence[Row]) -> list[str]:
    """Return the points of plays that are farther from the point before than the slew rate allows.

    The loop accepts a table as a whole: its points, not what an output makes of them, are judged.
    """
    points = [row for row in rows if row.kind in {"start", "play"}]
    return [
        f"{row.t_s:.3f} s: a table goes from {before.written_v:.3f} to {row.written_v:.3f} V"
        for before, row in pairwise(points)
        if row.kind == "play"
        and abs(row.written_v - before.written_v)
        > SLEW_V_PER_S * (row.t_s - before.t_s) + ROUNDING_V
    ]


def is_visible(rows: Sequence[Row]) -> bool:
    """Return whether the read-back was unlike the last write for long, before the writes ended."""
    last = max((i for i, row in enumerate(rows) if row.kind in {"write", "refused"}), default=-1)
    since_s: float | None = None
    known = True  # after the stop of a play nobody knows the last point
    # A stage that waits for its output writes nothing for a while, and a disarmed one never again.
    for row in rows[: last + 1]:
        if row.kind in {"play", "write", "end"}:
            known = row.kind != "play"
        if row.kind != "read":
            continue
        if not known or abs(row.shown_v - row.written_v) <= 2.0 * TOLERANCE_V:
            since_s = None
        elif since_s is None:
            since_s = row.t_s
        elif row.t_s - since_s > VISIBLE_S:
            return True
    return False
