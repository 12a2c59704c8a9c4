"""A play: a device plays a table by its own clock, and the loop neither reads nor writes meanwhile.

The devices are lent to a thread outside of the cycle, the `PlayRunner`. The cycle only looks
whether they are back. A stop, an emergency stop or a fault aborts the play; the ramp to the safe
voltage begins when the devices are back, at the voltage that they then report.
"""

from collections.abc import Sequence
from math import isfinite, nan
from typing import NamedTuple, Protocol

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.stage.axis import StageAxis
from piezod.control.stage.boundary import SILENT_CYCLES, DeviceBoundary, OutputKnowledge
from piezod.control.table_guard import TableGuard, scan_problem
from piezod.devices.played_axis import AxisTable
from piezod.devices.player import PlayerCapabilities
from piezod.devices.scan_table import ScanTable
from piezod.errors import DataError


class PlayOutcome(NamedTuple):
    """The end of a play."""

    drives_v: tuple[float, ...]  #: Voltage in force on each axis of it, in V; NaN if unknown.
    failed: str = ""  #: Why it failed; empty if it ended, or was aborted.
    #: Whether the voltage was commanded: the last one of the table, or before its start the first
    #: one. Otherwise the amplifier has measured it: its read-back is no second witness.
    commanded: bool = False


class PlayRunner(Protocol):
    """Runs plays outside of the cycle; `daemon.loop.play_thread` implements it. Real-time safe."""

    def refusal(self, axis: int) -> str:
        """Return why an axis cannot play; empty if it can."""
        ...

    def capabilities(self, axis: int) -> PlayerCapabilities:
        """Return the capabilities of the player of an axis that can play."""
        ...

    def begin(self, axis: int, table: AxisTable) -> None:
        """Begin a play, of a table in V. The runner has the devices now."""
        ...

    def scan_refusal(self, axes: Sequence[int], table: ScanTable) -> str:
        """Return why axes cannot play a scan; empty if they can."""
        ...

    def begin_scan(self, axes: Sequence[int], table: ScanTable) -> None:
        """Begin a scan, of a table in V. The runner has the devices now."""
        ...

    def abort(self) -> None:
        """Abort the play; its outcome follows."""
        ...

    def outcome(self) -> PlayOutcome | None:
        """Return the end of the play, once; None while the runner has the devices."""
        ...


class StagePlay:
    """The play of a stage, as its state machine sees it. All methods are real-time safe.

    Args:
        runner: Runs the play; None if no device can.
        boundary: The devices.
        output: Whether the voltages in force are known.
    """

    def __init__(
        self, runner: PlayRunner | None, boundary: DeviceBoundary, output: OutputKnowledge
    ) -> None:
        self._runner, self._boundary, self._output = runner, boundary, output
        self._axes: tuple[int, ...] = ()
        self._silent_cycles = 0
        self._outcome: PlayOutcome | None = None
        self._aborted = False

    def refusal(self, axis: int, of: StageAxis, table: AxisTable) -> str:
        """Return why a table cannot be played now; empty if it can.

        Args:
            axis: Index of the axis.
            of: The axis; it will ramp to the first voltage before.
            table: The table.
        """
        if self._boundary.shadow:
            return "in shadow nothing is driven: arm the stage without it"
        if self._runner is None:
            return "this stage has no device that plays tables"
        if why := self._runner.refusal(axis):
            return why
        able = self._runner.capabilities(axis)
        guard = TableGuard(of.law.limits, of.config.limits.rest_v, able.at_end, able.cycles)
        try:
            guard.check(table, table.first_v)
        except DataError as error:
            return f"axis {of.name}: {error}"
        return ""

    def begin(self, axis: int, table: AxisTable) -> None:
        """Lend the devices and begin a play, of a table in V, which `refusal` has not refused."""
        if self._runner is not None:
            self._lend((axis,))
            self._runner.begin(axis, table)

    def scan_refusal(self, axes: Sequence[int], of: Sequence[StageAxis], table: ScanTable) -> str:
        """Return why a scan cannot be played now; empty if it can.

        Args:
            axes: Indices of the axes, in the order of the table.
            of: The axes; they will ramp to the first voltages before.
            table: The table.
        """
        if self._boundary.shadow:
            return "in shadow nothing is driven: arm the stage without it"
        if self._runner is None:
            return "this stage has no device that plays tables"
        for place, axis in enumerate(of):
            if why := scan_problem(table, place, axis.law.limits):
                return f"axis {axis.name}: the scan is refused: {why}"
        return self._runner.scan_refusal(axes, table)

    def begin_scan(self, axes: Sequence[int], table: ScanTable) -> None:
        """Lend the devices and begin a scan, which `scan_refusal` has not refused."""
        if self._runner is not None:
            self._lend(tuple(axes))
            self._runner.begin_scan(axes, table)

    def _lend(self, axes: tuple[int, ...]) -> None:
        self._axes, self._aborted, self._silent_cycles = axes, False, 0
        self._output.lend()
        self._boundary.lent = True

    def abort(self) -> None:
        """Abort the play, if there is one."""
        if self._runner is not None and self._boundary.lent and not self._aborted:
            self._aborted = True
            self._runner.abort()

    def advance(
        self, axes: Sequence[StageAxis], read_back_v: Sequence[float]
    ) -> PlayOutcome | Detection | None:
        """Take the devices back when the play has ended.

        If an amplifier reads back, only a read-back from after the end tells its voltage in force;
        a voltage that was commanded counts as the last write.
        Call once per cycle while `DeviceBoundary.played`. Real-time safe.

        Args:
            axes: The axes of the stage.
            read_back_v: Voltage of each axis, in V; NaN if the amplifier does not report it.

        Returns:
            The end of the play when the voltages are known again; A1 if they stay unknown; None if
            the play goes on.
        """
        if self._runner is not None and self._boundary.lent:
            self._outcome = self._runner.outcome()
            if self._outcome is not None:  # the next cycle reads and reads back
                self._boundary.take_back()
            return None
        outcome = self._outcome
        if outcome is None:
            return None
        left_v = [axis.law.in_force_v for axis in axes]
        for axis, drive_v in zip(self._axes, outcome.drives_v, strict=True):
            left_v[axis] = drive_v
        reads_back = self._boundary.reads_back
        told_v = [
            read_v if reads else kept_v
            for read_v, reads, kept_v in zip(read_back_v, reads_back, left_v, strict=True)
        ]
        if not all(map(isfinite, told_v)):
            self._silent_cycles += 1
            may_come = self._output.missing(read_back_v)
            if may_come and self._silent_cycles < SILENT_CYCLES + self._boundary.lag_cycles:
                return None
            self._outcome = None
            return Detection(Fault.A1, self._axes[0], nan, nan)
        for axis, drive_v in zip(self._axes, outcome.drives_v, strict=True):
            if not reads_back[axis]:
                axes[axis].track(drive_v)
            elif not outcome.commanded:
                left_v[axis] = nan
        self._boundary.written_v = left_v
        self._output.know(known=True)
        self._outcome, self._boundary.returned = None, False
        return outcome
