"""Plays a table on an NV200/D: its waveform generator drives, its data recorder records.

The generator starts at the first point, and repeats the points of the period. Nothing reports its
cycles: they are counted by the clock of the computer, as long as the generator moves on.
"""

from collections.abc import Sequence
from typing import Final, Protocol

from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Wiring
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj.wave_requests import (
    CLOCK_NS,
    MOST_CYCLES,
    MOST_FACTOR,
    N_POINTS,
    N_SAMPLES,
    NEAR_PCT,
    WaveRequests,
)

POLL_NS: Final = 100_000_000
"""Time between two questions for the progress."""
HOLD_NS: Final = 20_000_000
"""Time for which the first point is held before the lead-in. In it the generator becomes the source
of the voltage, by a command of its own."""


class PlayHost(Protocol):
    """What a player uses of the dialogue."""

    @property
    def wiring(self) -> Wiring:
        """The channels in use."""
        ...

    def sample(self, now_ns: int) -> Reading:
        """Read every input. Real-time safe."""
        ...

    def ranges(self) -> Sequence[tuple[float, float]]:
        """Return the range of each output, in V."""
        ...


class Nv200Player:
    """Implements `PlayDialogue`.

    Args:
        at_end: What the output does after its last cycle.
    """

    def __init__(self, host: PlayHost, requests: WaveRequests, at_end: AtEnd) -> None:
        self._host, self._requests, self._at_end = host, requests, at_end
        self._table: Table | None = None
        self._voltages: list[float] = []
        """The whole waveform, in V; it begins with the held points."""
        self._n_held = 0
        self._begun_ns: int | None = None
        self._asked_ns = self._cycle = self._index = 0
        self._rest_um = 0.0

    def forget(self) -> None:
        """Forget what another device may have."""
        self._table, self._voltages = None, []

    def stop_found(self) -> bool:
        """Stop a play that another process has left running; return whether there was one."""
        if not self._host.wiring.outputs or self._requests.is_closed():
            return False
        found = self._requests.is_source()
        if found:
            self._requests.stop()
        return found

    def capabilities(self) -> PlayerCapabilities:
        """Return the capabilities; the held points reduce the number of points.

        Raises:
            LineFault: If the device does not report its limits.
        """
        # Imported at the start, when this is asked: `load` comes long afterwards.
        from piezod_drivers.serial_line import wave_arrays  # noqa: F401, PLC0415 - numpy

        low_v, high_v = self._requests.voltages()
        return PlayerCapabilities(
            shortest_interval_ns=CLOCK_NS,
            interval_step_ns=CLOCK_NS,
            longest_interval_ns=CLOCK_NS * MOST_FACTOR,
            points=N_POINTS - 1,
            points_shared=False,
            resolution=(NEAR_PCT / 100.0 * (high_v - low_v),),
            cycles=MOST_CYCLES,
            replaces=False,
            record_points=N_SAMPLES,
            records_with_play=True,
            at_end=self._at_end,
        )

    def load(self, table: Table, check: Check) -> Table:
        """Write the waveform point by point and read it back; return it as the device holds it.

        Raises:
            DeviceError: If it does not fit, or the device holds other values.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        n_held = -(-HOLD_NS // table.interval_ns)
        points = [float(value) for value in wave_arrays.once_of(table)[:, 0]]
        if n_held + len(points) > N_POINTS:
            raise DeviceError(
                f"a table has {len(points)} points, allowed at an interval of "
                f"{table.interval_ns // 1000} µs: at most {N_POINTS - n_held}, because the first "
                f"one is held for {HOLD_NS // 1_000_000} ms; choose a longer interval"
            )
        if self._requests.is_closed():
            raise DeviceError("the device's own loop is closed: send cl,0 at rest")
        self._requests.prepare(0, 1, 1, 1)  # stops a generator that is not the source
        low_v, high_v = self._requests.voltages()
        percents = [
            round(100.0 * (value - low_v) / (high_v - low_v), 3)
            for value in [points[0]] * n_held + points
        ]
        held = self._requests.write_points(percents, check)
        self._voltages = [low_v + percent / 100.0 * (high_v - low_v) for percent in held]
        self._n_held = n_held
        self._table = wave_arrays.table_of(table, [self._voltages[n_held:]])
        return self._table

    def arm(self) -> None:
        """Set up generator and recorder."""
        table = self._require_table()
        factor = table.interval_ns // CLOCK_NS
        n_repeated = self._n_held + len(table.lead_in)
        self._requests.prepare(n_repeated, len(self._voltages), table.cycles, factor)
        n_samples = min(self._n_held + table.n_points, N_SAMPLES)
        self._requests.prepare_record(n_samples, factor)
        self._rest_um = self._requests.position_um()

    def start(self) -> None:
        """Start generator and recorder; then let the generator drive.

        Raises:
            DeviceError: If the generator does not run; nothing moves then.
        """
        self._begun_ns, self._cycle = None, 0
        if not self._requests.start():
            raise DeviceError("the waveform generator does not start: look for its trigger input")

    def progress(self, now_ns: int) -> Progress:
        """Ask now and then whether the generator runs, and for its point. Real-time safe.

        At the end the command becomes the source of the voltage again.
        """
        table = self._require_table()
        if self._begun_ns is None:
            self._begun_ns = self._asked_ns = now_ns
            self._index = -1
        elif now_ns - self._asked_ns < POLL_NS:
            return Progress(PlayState.PLAYING, self._cycle)
        self._asked_ns = now_ns
        if not self._requests.is_running():
            self._requests.take_over(self._voltages[-1])
            return Progress(PlayState.ENDED, table.cycles)
        index = self._requests.index()
        if index != self._index:
            lead_in_ns = (self._n_held + len(table.lead_in)) * table.interval_ns
            elapsed_ns = max(now_ns - self._begun_ns - lead_in_ns, 0)
            cycle = elapsed_ns // (len(table.period) * table.interval_ns)
            self._cycle = min(cycle, table.cycles - 1)
        self._index = index
        return Progress(PlayState.PLAYING, self._cycle)

    def stop(self) -> Sequence[float]:
        """Stop the generator, measure the voltage, and keep it. Real-time safe."""
        return [self._requests.stop()]

    def recording(self, check: Check) -> PlayedRecord:
        """Read the record, without the held points. The record of a channel is one reply.

        Raises:
            DeviceError: If it is too short, or does not fit the table.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        table = self._require_table()
        n_samples = min(self._n_held + table.n_points, N_SAMPLES)
        n_inputs = len(self._host.wiring.inputs)
        channels = [0] * n_inputs + [1]
        columns = []
        for channel in channels:
            check()
            columns.append(self._requests.recorded(channel, n_samples))
        rows = wave_arrays.columns_of(columns)[self._n_held :]
        positions, outputs = rows[:, :n_inputs], rows[:, n_inputs:]
        differences = outputs - wave_arrays.first_points(table, len(rows))
        wave_arrays.check_followed(differences, self._host.ranges())
        if n_inputs:
            wave_arrays.check_beginning(positions[:, 0], columns[0][0], self._rest_um)
        return PlayedRecord(table.interval_ns, positions, 0, outputs)

    def sample(self, now_ns: int) -> Reading:
        """Read the position. Real-time safe."""
        return self._host.sample(now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Return the voltage of the present point, or the setpoint. Real-time safe."""
        if not self._requests.is_source():
            return [self._requests.setpoint_v()]
        index = self._requests.index()
        if not index < len(self._voltages):
            raise LineFault(DeviceFlag.GARBAGE, f"the waveform has no point {index}")
        return [self._voltages[index]]

    def close(self) -> None:
        """Do nothing: a play needs no line of its own."""

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table
