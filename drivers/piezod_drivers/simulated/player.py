"""The player of a simulated rig: it plays tables by the clock of the physics."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from piezod.devices.bus.table_check import check_table, check_values
from piezod.devices.player import (
    AtEnd,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.errors import DeviceError
from piezod_drivers.simulated.axis import PHOTONS, FloatArray, SimulatedAxis
from piezod_drivers.simulated.camera import TriggerInput
from piezod_drivers.simulated.options import SimulatedOptions
from piezod_drivers.simulated.pattern import counts_at

POINTS: Final = 2_000_000
"""Longest table of each output, and longest record of each input, in points."""
LONGEST_INTERVAL_NS: Final = 1_000_000_000
CYCLES: Final = 1_000_000_000
PULSE_LINES: Final = 8
EDGE_WAITS: Final = 10_000


class TablePlayer:
    """Plays a table on the axes of a rig, in the rig's time.

    Points are on the grid of the physics. A sample is taken at the instant of each point, before
    the point acts.

    Args:
        axes: All axes; those that are played first, in the order of a table's columns.
        outputs: Number of axes that are played.
        inputs: Index of the axis, and quantity, of each input.
        options: Options of the rig.
    """

    def __init__(
        self,
        axes: Sequence[SimulatedAxis],
        outputs: int,
        inputs: Sequence[tuple[int, str]],
        options: SimulatedOptions,
    ) -> None:
        self._axes, self._driven, self._inputs = axes, axes[:outputs], inputs
        self._sub_step_ns, self._trigger = options.sub_step_ns, TriggerInput(options.camera)
        self._ranges = [(axis.lowest_v, axis.highest_v) for axis in self._driven]
        self._state = PlayState.IDLE
        self.pulses = np.zeros(PULSE_LINES, np.int64)
        """Number of rising edges of each line."""
        self._forget()

    def _forget(self) -> None:
        nothing = np.empty((0, len(self._driven)))
        self._table = Table(self._sub_step_ns, nothing, nothing, 1)
        self._period = self._next_period = nothing
        self._readings_v = self._truths_um = np.empty((0, len(self._axes)))
        self._start_ns = self._point = self._points = self._gate = 0
        # The points since the last wait: the first one, and its instant.
        self._first, self._first_ns, self._waits = 0, 0, iter(range(0))

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
            pulse_lines=PULSE_LINES,
            edge_waits=EDGE_WAITS,
            pulses_at=("time",),
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
        check_table(table, self.capabilities, self._ranges)
        loaded = table._replace(
            lead_in=self._quantised(table.lead_in), period=self._quantised(table.period)
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
        record = min(self._points, POINTS), len(self._axes)
        self._readings_v, self._truths_um = np.full(record, np.nan), np.full(record, np.nan)
        self._start_ns = self._first_ns = self._on_grid(t_ns)
        self._trigger.begin()
        edges = self._table.edges
        self._waits = iter(range(0) if edges is None else edges.places)
        self._gate = next(self._waits, self._points)
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
        check_values("period", period, self._ranges)
        self._next_period = self._quantised(period)
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
        readings_v, truths_um = self._readings_v[: self._point], self._truths_um[: self._point]
        positions = [
            counts_at(truths_um[:, : len(self._driven)])
            if quantity == PHOTONS
            else self._axes[place].samples(readings_v[:, place], quantity)
            for place, quantity in self._inputs
        ]
        without = np.empty((len(readings_v), 0))
        shape = (len(readings_v), len(self._inputs))
        columns = np.stack(positions, axis=1) if positions else np.empty(shape)
        edges = tuple(self._trigger.seen) if self._table.edges else ()
        return PlayedRecord(self._table.interval_ns, columns, 0, without, edges)

    def true_recording(self) -> FloatArray:
        """Return the true displacements of the play that has ended, in µm, shape (k, inputs)."""
        self._require(PlayState.ENDED, "read a record")
        return self._truths_um[: self._point, [place for place, _ in self._inputs]]

    def play_to(self, t_ns: int) -> None:
        """Play all points up to an instant in the rig's time."""
        while self.plays:
            due = self._first + (t_ns - self._first_ns) // self._table.interval_ns + 1
            while self._point < min(due, self._gate):
                self._play_rows(self._next_rows(min(due, self._gate) - self._point))
            if due <= self._gate or not self._passes_gate(t_ns):
                return

    def _passes_gate(self, t_ns: int) -> bool:
        """Go on behind a wait, or end; return whether an edge has come by an instant."""
        ready_ns = self._instant_of(self._gate)
        self._trigger.pass_to(ready_ns - self._start_ns)
        edges = self._table.edges
        if edges is None or self._gate == self._points:
            self._state = PlayState.ENDED
            return False
        last_ns = ready_ns + edges.within_ns
        edge_ns = self._trigger.edge_by(min(t_ns, last_ns) - self._start_ns)
        if edge_ns is None:
            if t_ns > last_ns:
                self._state = PlayState.ENDED
            return False
        self._first, self._first_ns = self._gate, self._on_grid(self._start_ns + edge_ns)
        self._gate = next(self._waits, self._points)
        return True

    def _instant_of(self, point: int) -> int:
        """Return the instant of a point since the last wait, in the rig's time."""
        return self._first_ns + (point - self._first) * self._table.interval_ns

    def _on_grid(self, t_ns: int) -> int:
        return -(-t_ns // self._sub_step_ns) * self._sub_step_ns

    def _next_rows(self, most: int) -> FloatArray:
        """Return the next rows of the table: at most this number, and of one cycle only."""
        at = self._point - len(self._table.lead_in)
        if at < 0:
            return self._table.lead_in[self._point : self._point + most]
        place = at % len(self._period)
        if place == 0:
            self._period = self._next_period
        return self._period[place : place + most]

    def _play_rows(self, rows: FloatArray) -> None:
        """Play rows at consecutive points, and record them."""
        first, interval_ns = self._point, self._table.interval_ns
        kept = slice(first, first + len(rows))
        for place, axis in enumerate(self._axes):
            # An axis without an output keeps its command.
            if place < len(self._driven):
                commands_v = np.ascontiguousarray(rows[:, place])
            else:
                commands_v = np.full(len(rows), axis.plant.command_v)
            readings_v, truths_um = np.empty(len(rows)), np.empty(len(rows))
            # Calls between two points may have left the plant anywhere before the first point.
            axis.plant.advance_to(self._instant_of(first))
            readings_v[0], truths_um[0] = axis.plant.sample(), axis.plant.true_displacement_um
            axis.plant.command(float(commands_v[0]))
            steps = interval_ns // self._sub_step_ns
            axis.plant.play(commands_v[1:], steps, readings_v[1:], truths_um[1:])
            recorded = len(self._readings_v[kept])
            self._readings_v[kept, place] = readings_v[:recorded]
            self._truths_um[kept, place] = truths_um[:recorded]
        self._count_pulses(first, len(rows))
        self._point += len(rows)

    def _count_pulses(self, first: int, n: int) -> None:
        """Count the rising edges of rows from a point on; rows of one cycle are consecutive."""
        masks = self._table.pulses
        place = first - len(self._table.lead_in)
        if masks is None or place < 0:
            return
        place %= len(masks)
        before = masks[place - 1 : place] if place else np.zeros(1, np.uint8)
        seen = np.concatenate((before, masks[place : place + n]))
        rising = np.unpackbits(seen[1:] & ~seen[:-1], bitorder="little")
        self.pulses += rising.reshape(-1, PULSE_LINES).sum(axis=0, dtype=np.int64)

    def _require(self, state: PlayState, what: str) -> None:
        if self._state is not state:
            raise DeviceError(
                f"the player cannot {what}: it is {self._state.value}, it must be {state.value}"
            )

    def _quantised(self, values: FloatArray) -> FloatArray:
        """Return values as the converters output them."""
        steps = np.array([axis.step_v for axis in self._driven])
        with np.errstate(divide="ignore", invalid="ignore"):
            stepped = np.round(values / steps) * steps
        return np.where(steps > 0.0, stepped, values)
