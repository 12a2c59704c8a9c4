"""The player of a simulated rig: it plays tables by the clock of the physics."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezod.devices.player import (
    AtEnd,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.errors import DeviceError
from piezod_drivers.simulated.axis import FloatArray, SimulatedAxis

POINTS: Final = 2_000_000
"""Longest table of each output, and longest record of each input, in points."""
LONGEST_INTERVAL_NS: Final = 1_000_000_000
CYCLES: Final = 1_000_000_000


class TablePlayer:
    """Plays a table on the axes of a rig, in the rig's time.

    Points are on the grid of the physics. A sample is taken at the instant of each point, before
    the point acts.

    Args:
        driven: Axes that are played, in the order of a table's columns.
        measured: Axis and quantity of each input.
        sub_step_ns: Sub-step of the physics, in ns.
    """

    def __init__(
        self,
        driven: Sequence[SimulatedAxis],
        measured: Sequence[tuple[SimulatedAxis, str]],
        sub_step_ns: int,
    ) -> None:
        self._driven, self._measured, self._sub_step_ns = driven, measured, sub_step_ns
        self._axes = list(
            {id(one.plant): one for one in (*driven, *(a for a, _ in measured))}.values()
        )
        self._state = PlayState.IDLE
        self._forget()

    def _forget(self) -> None:
        nothing = np.empty((0, len(self._driven)))
        self._table = Table(self._sub_step_ns, nothing, nothing, 1)
        self._period = self._next_period = nothing
        self._positions = self._truths = np.empty((0, len(self._measured)))
        self._start_ns = self._point = self._points = 0

    @property
    def capabilities(self) -> PlayerCapabilities:
        """Its capabilities; the resolution is that of the amplifiers' converters."""
        return PlayerCapabilities(
            shortest_interval_ns=self._sub_step_ns,
            interval_step_ns=self._sub_step_ns,
            longest_interval_ns=LONGEST_INTERVAL_NS,
            points=POINTS,
            points_shared=False,
            resolution=tuple(axis.step_v for axis in self._driven),
            cycles=CYCLES,
            replaces=True,
            record_points=POINTS,
            records_with_play=True,
            at_end=AtEnd.HOLDS,
        )

    @property
    def plays(self) -> bool:
        """Whether a table is being played."""
        return self._state is PlayState.PLAYING

    def load(self, table: Table) -> Table:
        """Load a table; return it as the converters will output it.

        Raises:
            DeviceError: If it does not fit, or one is being played.
        """
        if self.plays:
            raise DeviceError("a table is being played: abort it before another one is loaded")
        self._check(table)
        loaded = table._replace(
            lead_in=self._quantised("lead_in", table.lead_in),
            period=self._quantised("period", table.period),
        )
        self._forget()
        self._table = loaded
        self._period = self._next_period = loaded.period
        self._points = len(loaded.lead_in) + len(loaded.period) * loaded.cycles
        self._state = PlayState.LOADED
        return loaded

    def arm(self) -> None:
        """Prepare the start."""
        self._require(PlayState.LOADED, "arm")
        self._state = PlayState.ARMED

    def start(self, t_ns: int) -> None:
        """Start at the first sub-step at or after `t_ns`."""
        self._require(PlayState.ARMED, "start")
        record = min(self._points, POINTS), len(self._measured)
        self._positions, self._truths = np.full(record, np.nan), np.full(record, np.nan)
        self._start_ns = -(-t_ns // self._sub_step_ns) * self._sub_step_ns
        self._state = PlayState.PLAYING
        self.play_to(t_ns)

    def replace(self, period: FloatArray) -> FloatArray:
        """Replace the period from the next cycle on; return it as the converters will output it."""
        self._require(PlayState.PLAYING, "replace a period")
        if period.shape != self._period.shape:
            raise DeviceError(
                f"a period of {period.shape[0]} points cannot replace one of "
                f"{self._period.shape[0]}; give it the same number of points"
            )
        self._next_period = self._quantised("period", period)
        return self._next_period

    def progress(self) -> Progress:
        """Return the progress. Real-time safe."""
        lead_in, period = len(self._table.lead_in), max(len(self._table.period), 1)
        # A cycle is complete when the interval of its last point is over, not when it begins.
        whole = self._point if self._state is PlayState.ENDED else self._point - 1
        return Progress(self._state, max(whole - lead_in, 0) // period)

    def abort(self) -> None:
        """Stop; the outputs keep their values. Real-time safe."""
        if self._state is not PlayState.ENDED:
            self._state = PlayState.IDLE

    def recording(self) -> PlayedRecord:
        """Return the record of the play that has ended."""
        self._require(PlayState.ENDED, "read a record")
        without = np.empty((len(self._positions), 0))
        return PlayedRecord(self._table.interval_ns, self._positions.copy(), 0, without)

    def true_recording(self) -> FloatArray:
        """Return the true displacements of the play that has ended, in µm, shape (k, inputs)."""
        self._require(PlayState.ENDED, "read a record")
        return self._truths.copy()

    def play_to(self, t_ns: int) -> None:
        """Play all points up to an instant in the rig's time."""
        while self.plays:
            at_ns = self._start_ns + self._point * self._table.interval_ns
            if at_ns > t_ns:
                return
            if self._point == self._points:
                self._state = PlayState.ENDED
                return
            for axis in self._axes:
                axis.plant.advance_to(at_ns)
            self._record()
            for axis, value in zip(self._driven, self._next_values(), strict=True):
                axis.plant.command(value)
            self._point += 1

    def _record(self) -> None:
        if self._point >= len(self._positions):
            return
        for i, (axis, quantity) in enumerate(self._measured):
            _, value, valid = axis.present_sample(0, quantity)
            if valid:
                self._positions[self._point, i] = value
            self._truths[self._point, i] = axis.plant.true_displacement_um

    def _next_values(self) -> list[float]:
        at = self._point - len(self._table.lead_in)
        if at < 0:
            row = self._table.lead_in[self._point]
        else:
            place = at % len(self._period)
            if place == 0:
                self._period = self._next_period
            row = self._period[place]
        return [float(value) for value in row]

    def _require(self, state: PlayState, what: str) -> None:
        if self._state is not state:
            raise DeviceError(
                f"the player cannot {what}: it is {self._state.value}, it must be {state.value}"
            )

    def _check(self, table: Table) -> None:
        able = self.capabilities
        interval_ns = table.interval_ns
        if interval_ns <= 0 or able.legal_interval_ns(interval_ns) != interval_ns:
            raise DeviceError(
                f"the interval of a table is {interval_ns} ns, allowed: multiples of "
                f"{self._sub_step_ns} ns up to {LONGEST_INTERVAL_NS} ns"
            )
        points = len(table.lead_in) + len(table.period)
        if not len(table.period) or points > POINTS:
            raise DeviceError(
                f"a table has {points} points, {len(table.period)} of them in its period, "
                f"allowed: at least 1 in the period, and at most {POINTS}"
            )
        if not 1 <= table.cycles <= CYCLES:
            raise DeviceError(f"a table has {table.cycles} cycles, allowed: 1 to {CYCLES}")

    def _quantised(self, part: str, values: FloatArray) -> FloatArray:
        """Return values as the converters output them.

        Raises:
            DeviceError: If there is not one column for each output, or a value is out of range.
        """
        if values.ndim != 2 or values.shape[1] != len(self._driven):
            raise DeviceError(
                f"{part} has the shape {values.shape}, allowed: (points, {len(self._driven)})"
            )
        for i, axis in enumerate(self._driven):
            column = values[:, i]
            outside = ~((column >= axis.lowest_v) & (column <= axis.highest_v))  # NaN is outside
            if np.any(outside):
                point = int(np.argmax(outside))
                raise DeviceError(
                    f"point {point} of {part} of output {i} is {column[point]:g} V, allowed range "
                    f"{axis.lowest_v:g} to {axis.highest_v:g} V"
                )
        steps = np.array([axis.step_v for axis in self._driven])
        with np.errstate(divide="ignore", invalid="ignore"):
            stepped = np.round(values / steps) * steps
        return np.where(steps > 0.0, stepped, values)
