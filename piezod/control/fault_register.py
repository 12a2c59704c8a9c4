"""Which faults are present and latched, which are consequences of others, and what to do now."""

from typing import NamedTuple


class Detection(NamedTuple):
    """A fault that a watch finds in this cycle; it is told in every cycle in which it is there.

    Attributes:
        fault: Its id, as in "S5".
        axis: Index of the axis, -1 where it concerns all.
        measured: The value that was found, NaN where there is none.
        limit: What it was compared with, NaN where there is none.
    """

    fault: str
    axis: int = -1
    measured: float = float("nan")
    limit: float = float("nan")
