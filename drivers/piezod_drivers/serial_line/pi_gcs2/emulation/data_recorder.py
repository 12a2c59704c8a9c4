"""The data recorder of the emulated controller."""

from collections.abc import Callable
from typing import Final

TARGET, POSITION, VOLTAGE, OPEN_LOOP_INPUT = 1, 2, 7, 14
"""Record options."""
N_TABLES: Final = 8
"""Number of tables, at first and at most."""
MOST_POINTS: Final = 262_144
"""Points of all tables together; each one has an equal share."""
_NAMES: Final = {
    TARGET: "Target Position of axis{}",
    POSITION: "Current Position of axis{}",
    VOLTAGE: "Control Voltage of output chan{}",
    OPEN_LOOP_INPUT: "Open-Loop Control Value of axis{}",
}


class DataRecorder:
    """Records a value for each table at every few servo cycles, until all tables are full.

    Args:
        value_of: Returns the value of an option for the axis with this index.
    """

    def __init__(self, value_of: Callable[[int, int], float]) -> None:
        self._value_of = value_of
        # By default the positions of the axes.
        self.sources = [(i + 1, POSITION) for i in range(N_TABLES)]
        self.rate, self.n_tables = 1, N_TABLES
        self._rows: list[list[float]] = []
        self._cycle = 0
        self.running = False

    def start(self) -> None:
        """Forget the last record and start with the next servo cycle."""
        self._rows, self._cycle, self.running = [], 0, True

    def set_tables(self, n_tables: int) -> None:
        """Set the number of tables, and forget the record."""
        self.n_tables, self.running, self._rows = n_tables, False, []

    def record(self, n_axes: int) -> None:
        """Record the values of a servo cycle, if they are due."""
        if self.running and self._cycle % self.rate == 0:
            self._rows.append(
                [
                    self._value_of(source - 1, option) if source <= n_axes else 0.0
                    for source, option in self.sources
                ]
            )
            self.running = len(self._rows) < MOST_POINTS // self.n_tables
        self._cycle += 1

    def length(self) -> int:
        """Return the number of recorded points."""
        return len(self._rows)

    def column(self, table: int, first: int, n_points: int) -> tuple[str, list[float]]:
        """Return name and values of a table, from a point on that is counted from 1."""
        source, option = self.sources[table - 1]
        rows = self._rows[first - 1 : first - 1 + n_points]
        return _NAMES[option].format(source), [row[table - 1] for row in rows]

    def options(self) -> frozenset[int]:
        """Return the known record options."""
        return frozenset(_NAMES)
