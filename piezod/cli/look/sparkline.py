"""Sparklines: the recent past of a quantity as one line of Unicode blocks."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from math import floor
from typing import Final, TypeAlias

from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.text import Text

BLOCKS: Final = "▁▂▃▄▅▆▇█"
PLAIN_BLOCKS: Final = "_.-:=+*#"
"""For terminals that have ASCII only."""
SPAN_S: Final = 30.0

Merge: TypeAlias = Callable[[Sequence[float]], float]


class History:
    """The values of a quantity in the last half minute.

    Args:
        merge: Makes one value of those that share a column.
    """

    def __init__(self, merge: Merge) -> None:
        self._merge = merge
        self._points: deque[tuple[float, float]] = deque()
        self._now_s = 0.0

    def add(self, t_s: float, value: float | None) -> None:
        """Take the value of an instant; None if it is unknown."""
        self._now_s = t_s
        if value is not None:
            self._points.append((t_s, value))
        while self._points and self._points[0][0] <= t_s - SPAN_S:
            self._points.popleft()

    @property
    def range(self) -> tuple[float, float] | None:
        """Smallest and largest value; None without values."""
        values = [value for _, value in self._points]
        return (min(values), max(values)) if values else None

    def columns(self, count: int) -> list[float | None]:
        """Return one value for each of so many columns, the newest last; None without values."""
        width_s = SPAN_S / count
        # Columns begin at multiples of their width, so that a value stays in its column.
        newest = floor(self._now_s / width_s)
        found: list[list[float]] = [[] for _ in range(count)]
        for t_s, value in self._points:
            place = count - 1 - newest + floor(t_s / width_s)
            if place >= 0:
                found[place].append(value)
        return [self._merge(values) if values else None for values in found]


class Sparkline:
    """A history as wide as its place; rich draws it.

    Args:
        history: The values.
        low: Value of the lowest block; None for the smallest value.
        high: Value of the highest block; None for the largest value.
        style: Style of the blocks.
    """

    def __init__(
        self,
        history: History,
        low: float | None = None,
        high: float | None = None,
        style: str = "",
    ) -> None:
        self._history, self._low, self._high, self._style = history, low, high, style

    def __rich_console__(self, _console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield one line."""
        smallest, largest = self._history.range or (0.0, 0.0)
        low = smallest if self._low is None else self._low
        high = largest if self._high is None else self._high
        blocks = PLAIN_BLOCKS if options.ascii_only else BLOCKS
        columns = self._history.columns(options.max_width)
        yield Text(blocks_of(columns, low, high, blocks), self._style)

    def __rich_measure__(self, _console: Console, options: ConsoleOptions) -> Measurement:
        """Return that any width will do."""
        return Measurement(1, options.max_width)


def blocks_of(values: Iterable[float | None], low: float, high: float, blocks: str = BLOCKS) -> str:
    """Return a block for each value, between the lowest and the highest one; a blank for None."""
    size = high - low
    shares = [
        # Without a range every value is the lowest.
        None if value is None else (value - low) / size if size > 0 else 0.0
        for value in values
    ]
    top = len(blocks) - 1
    return "".join(
        " " if share is None else blocks[round(min(max(share, 0.0), 1.0) * top)] for share in shares
    )
