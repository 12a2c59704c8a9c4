"""Plays a table on a player board: its own clock gives the points, and samples beside them."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.player import (
    AtEnd,
    Check,
    EdgeWaits,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.errors import DeviceError
from piezod.units import NS_PER_S
from piezod_drivers.serial_line.piezo_board.codec import CODES, LINES, BoardStatus
from piezod_drivers.serial_line.piezo_board.wave_requests import PlayHost, WaveRequests

POLL_NS: Final = 100_000_000
"""Time between two questions for the progress; they also tell the board that its host is there."""
_MOST_POINTS: Final = 2**32 - 1


class BoardPlayer:
    """Implements `PlayDialogue`."""

    def __init__(self, host: PlayHost) -> None:
        self._host, self._requests = host, WaveRequests(host)
        self._table: Table | None = None
        self._crc = self._first = 0
        self._lines = ""
        self._asked_ns: int | None = None
        self._cycle = 0
        self._seen, self._since_ns, self._given_up = -1, 0, False

    def forget(self) -> None:
        """Forget what another board may have."""
        self._table = None

    def capabilities(self) -> PlayerCapabilities:
        """Return the capabilities, without a request."""
        # Imported at the start, when this is asked: `load` comes long afterwards.
        from piezod_drivers.serial_line import wave_arrays  # noqa: F401, PLC0415 - numpy

        facts = self._host.facts
        low, high = self._host.options.output_v
        step = facts.step
        return PlayerCapabilities(
            shortest_interval_ns=facts.ns(-(-facts.shortest // step) * step),
            interval_step_ns=facts.ns(step),
            longest_interval_ns=facts.ns(facts.longest // step * step),
            points=facts.memory,
            points_shared=False,
            resolution=(abs(high - low) / CODES,) * len(self._host.outputs),
            cycles=_MOST_POINTS // facts.memory - 1,
            replaces=False,
            record_points=facts.memory,
            records_with_play=True,
            at_end=AtEnd.HOLDS,
            watchdog_while_playing=True,
            edge_waits=facts.memory // 8 if facts.waits else 0,
            pulse_lines=LINES,
            record_shared=True,
        )

    def load(self, table: Table, check: Check) -> Table:
        """Write the table; return it as the board plays it."""
        import numpy as np  # noqa: PLC0415 - what brings a stage down needs none

        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        self._require_room(table)
        lines = self._lines_of(table)
        low, high = self._host.options.output_v
        status = self._host.ask_status("?")
        once = np.rint((wave_arrays.once_of(table) - low) * (CODES / (high - low))).astype(int)
        # An output that is not in use stays.
        rows = np.tile(np.array(status.outputs), (len(once), 1))
        rows[:, self._host.outputs] = once
        self._crc = self._requests.write_table(rows.ravel().tolist(), check)
        self._lines = lines
        held = low + once * ((high - low) / CODES)
        n_lead_in = len(table.lead_in)
        self._table = table._replace(lead_in=held[:n_lead_in], period=held[n_lead_in:])
        return self._table

    def arm(self) -> None:
        """Prepare the play: the board compares the table that it has with that which was sent."""
        table = self._require_table()
        ticks = table.interval_ns * self._host.facts.clock_hz // NS_PER_S
        n_rows = len(table.lead_in), len(table.period)
        self._requests.wait_for(table.edges)
        self._first = self._requests.prepare(self._lines, n_rows, table.cycles, ticks, self._crc)

    def start(self) -> None:
        """Start the play and its record."""
        self._asked_ns, self._cycle = None, 0
        self._seen, self._given_up = -1, False
        self._requests.start(self._require_table().edges)

    def progress(self, now_ns: int) -> Progress:
        """Ask now and then for the progress. Real-time safe."""
        if self._asked_ns is not None and now_ns - self._asked_ns < POLL_NS:
            return Progress(PlayState.PLAYING, self._cycle)
        self._asked_ns = now_ns
        edges = self._require_table().edges
        if edges is not None and self._waits_too_long(edges, now_ns):
            self._given_up = True
            self._host.ask_status("A")
        return self._progress_of(self._host.ask_status("?"))

    def _waits_too_long(self, edges: EdgeWaits, now_ns: int) -> bool:
        """Ask for the edges; return whether the next one has not come within its limit."""
        seen, _, waiting = self._requests.edges()
        if not waiting or seen != self._seen:
            self._seen, self._since_ns = seen, now_ns
        return now_ns - self._since_ns > edges.within_ns

    def stop(self) -> Sequence[float]:
        """Stop the play where it is; return the outputs. Real-time safe."""
        return self._host.in_force_volts(self._host.ask_status("A"))

    def recording(self, check: Check) -> PlayedRecord:
        """Read the record.

        Raises:
            DeviceError: If it is shorter than it must be.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        table, host = self._require_table(), self._host
        n_rows = table.n_points - self._first
        kept = host.ask_status("?").kept
        if self._given_up and kept < n_rows:
            n_rows = kept
        if kept != n_rows:
            raise DeviceError(f"the record has {kept} samples, allowed: {n_rows}")
        rows = self._requests.recorded(n_rows, check)
        channels = host.facts.channels
        columns = [list(map(host.input_volts, rows[i::channels])) for i in host.inputs]
        positions = wave_arrays.columns_of(columns).reshape(n_rows, len(host.inputs))
        edges = self._requests.stored_edges(check) if table.edges else ()
        without = wave_arrays.rows_of([()] * n_rows)
        return PlayedRecord(table.interval_ns, positions, self._first, without, edges)

    def sample(self, now_ns: int) -> Reading:
        """Return the sample of the last point, in V. Real-time safe."""
        return self._host.reading(self._host.ask_status("?"), now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Return the outputs, in V. Real-time safe."""
        return self._host.in_force_volts(self._host.ask_status("?"))

    def close(self) -> None:
        """Do nothing: a play needs no line of its own."""

    def _progress_of(self, status: BoardStatus) -> Progress:
        table = self._require_table()
        self._cycle = status.cycle
        if "l" in status.flags:
            return self._failed("a point was late: the board had no time for the interval")
        if status.state == "play":
            return Progress(PlayState.PLAYING, status.cycle)
        if status.state == "off":
            tripped = "w" in status.flags
            why = "its watchdog has tripped" if tripped else "the board was reset"
            return self._failed(f"{why} during the play")
        if status.cycle != table.cycles and not self._given_up:
            return self._failed(f"the play has stopped after {status.cycle} cycles")
        return Progress(PlayState.ENDED, table.cycles)

    def _require_room(self, table: Table) -> None:
        """Refuse a table that waits for edges, and whose record does not fit beside it.

        Raises:
            DeviceError: If it does not fit.
        """
        if table.edges is None:
            return
        needed = 2 * table.n_points + self._requests.edge_rows(table.edges)
        if needed > self._host.facts.memory:
            raise DeviceError(
                f"table, record and edges need {needed} rows of the memory, allowed: "
                f"{self._host.facts.memory}; choose a longer interval"
            )

    def _failed(self, reason: str) -> Progress:
        return Progress(PlayState.FAILED, self._cycle, reason)

    def _lines_of(self, table: Table) -> str:
        """Return the request for the pulses of a table, or for those of the configuration."""
        if table.pulses is None:
            pulses = self._host.options.pulses
            return f"L {pulses.point} {pulses.line or len(table.period)}"
        from piezod_drivers.serial_line.piezo_board.line_pulses import LinePulses  # noqa: PLC0415

        return LinePulses.of(table.pulses).request

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table
