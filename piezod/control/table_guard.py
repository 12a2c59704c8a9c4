"""The last check before a table is loaded: all of it, because nothing checks it while it plays.

A table is refused as a whole; nothing is clamped. The guard trusts no caller.
"""

from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.control.guard import Limits
from piezod.devices.played_axis import AxisTable
from piezod.devices.player import AtEnd
from piezod.devices.scan_table import ScanTable
from piezod.errors import DataError
from piezod.units import NS_PER_S

FloatArray: TypeAlias = npt.NDArray[np.float64]

_ROUNDING = 1e-9
"""Share of the slew limit by which rounding may exceed it."""


class TableRefusedError(DataError):
    """Raised for a table that is not safe."""


class TableGuard:
    """Refuses tables that leave the limits of an axis. Stateless.

    Args:
        limits: Limits of the drive.
        rest_v: Voltage at rest, in V.
        at_end: What the device does at the end of a play.
        cycles: Largest number of cycles of the device; 0 if only the host can end a play.
    """

    def __init__(self, limits: Limits, rest_v: float, at_end: AtEnd, cycles: int) -> None:
        self._limits, self._rest_v = limits, rest_v
        self._at_end, self._cycles = at_end, cycles

    def check(self, table: AxisTable, in_force_v: float) -> None:
        """Refuse a table that is not safe as a whole.

        All of it is checked: finite, in range, every step within the slew rate, those from the
        voltage in force to the first point, from the lead-in to the period, from the end of the
        period to its start, and that at the end of the play.

        Args:
            table: The table.
            in_force_v: Voltage in force, read back if the device can do that, in V.

        Raises:
            TableRefusedError: If it is not safe; the text names the point, its value, the limit,
                and the remedy.
        """
        problem = next(self._problems(table, in_force_v), "")
        if problem:
            raise TableRefusedError(f"the table is refused: {problem}")

    def _problems(self, table: AxisTable, in_force_v: float) -> Iterator[str]:
        """Yield problems; each check relies on those before it."""
        limits, lead_in = self._limits, len(table.lead_in_v)
        if not len(table.period_v) or table.cycles < 1 or table.interval_ns <= 0:
            yield (
                f"it has {len(table.period_v)} points in its period, {table.cycles} cycles and an "
                f"interval of {table.interval_ns} ns, allowed: at least 1 of each"
            )
            return
        values = np.concatenate((table.lead_in_v, table.period_v))
        low_v, high_v = limits.drive_min_v, limits.drive_max_v
        outside = np.flatnonzero(~((values >= low_v) & (values <= high_v)))  # NaN is outside
        if outside.size:
            k = int(outside[0])
            yield (
                f"{_point(k, lead_in)} is {values[k]:g} V, allowed range {low_v:g} to {high_v:g} "
                "V; reduce the command"
            )
            return
        yield from self._fast_steps(table, values)
        yield from self._ends(table, values, in_force_v)

    def _fast_steps(self, table: AxisTable, values: FloatArray) -> Iterator[str]:
        lead_in, reach_v = len(table.lead_in_v), self._reach_v(table)
        steps = np.abs(np.diff(values))
        fast = np.flatnonzero(~(steps <= reach_v))
        if fast.size:
            k = int(fast[0])
            between = f"from {_point(k, lead_in)} to {_point(k + 1, lead_in)}"
            yield self._too_fast(between, values[k], values[k + 1], table, "slow the command down")
        wrap = values[-1], values[lead_in]
        if table.cycles > 1 and not abs(wrap[1] - wrap[0]) <= reach_v:
            between = "from the last point of the period to its first"
            yield self._too_fast(between, *wrap, table, "close the period")

    def _ends(self, table: AxisTable, values: FloatArray, in_force_v: float) -> Iterator[str]:
        reach_v = self._reach_v(table)
        if not abs(values[0] - in_force_v) <= reach_v:
            yield self._too_fast(
                "from the voltage in force to the first point",
                in_force_v,
                values[0],
                table,
                "begin the lead-in at the voltage in force",
            )
        if self._cycles and table.cycles > self._cycles:
            yield f"it has {table.cycles} cycles, the device plays at most {self._cycles}"
        # A device that holds its last value is ramped down by ordinary writes afterwards.
        if self._at_end is not AtEnd.HOLDS and not abs(values[-1] - self._rest_v) <= reach_v:
            yield self._too_fast(
                "from the last point to rest, where the device may go at its end,",
                values[-1],
                self._rest_v,
                table,
                "end the period at rest",
            )

    def _reach_v(self, table: AxisTable) -> float:
        return self._limits.slew_v_per_s * table.interval_ns / NS_PER_S * (1.0 + _ROUNDING)

    def _too_fast(
        self, between: str, before_v: float, after_v: float, table: AxisTable, remedy: str
    ) -> str:
        slew = abs(after_v - before_v) * NS_PER_S / table.interval_ns
        return (
            f"{between} the voltage goes from {before_v:g} to {after_v:g} V in "
            f"{table.interval_ns / 1000:g} µs, {slew:.4g} V/s, allowed: at most "
            f"{self._limits.slew_v_per_s:g} V/s; {remedy}"
        )


def _point(k: int, lead_in: int) -> str:
    return f"point {k} of the lead-in" if k < lead_in else f"point {k - lead_in} of the period"


def scan_problem(table: ScanTable, place: int, limits: Limits) -> str:
    """Return what is not safe of an axis of a scan; empty if nothing is. Real-time safe.

    Every voltage and every step is within bounds that the curves of the table have; its blocks are
    checked point by point before they are loaded.

    Args:
        table: The table.
        place: Column of the axis.
        limits: Limits of its drive.
    """
    low_v, high_v = table.bounds_v()[:, place]
    if not (low_v >= limits.drive_min_v and high_v <= limits.drive_max_v):  # NaN is outside
        return (
            f"it goes from {low_v:g} to {high_v:g} V, allowed range {limits.drive_min_v:g} to "
            f"{limits.drive_max_v:g} V; reduce the command"
        )
    fastest = table.largest_step_v(place) * NS_PER_S / table.interval_ns
    if not fastest <= limits.slew_v_per_s * (1.0 + _ROUNDING):
        return (
            f"the voltage changes by up to {fastest:.4g} V/s, allowed: at most "
            f"{limits.slew_v_per_s:g} V/s; scan more slowly"
        )
    return ""
