"""Plays a table on an LC.400: its wavetables drive the channels, its recorder records.

A wavetable is repeated until it is stopped. Therefore lead-in and all cycles are written out.
Behind them the last value is held, in which time the computer stops the wavetable; then it returns
to its first value, so that a wavetable whose computer is gone repeats without a jump.
"""

from collections.abc import Sequence
from math import nan
from typing import Final

from piezod.devices.bus.dialogue import Reading
from piezod.devices.player import (
    AtEnd,
    Check,
    PlayedRecord,
    PlayerCapabilities,
    PlayState,
    Progress,
    Table,
)
from piezod.errors import DeviceError
from piezod_drivers.serial_line.npoint_lc400.codec import (
    CLOCK_NS,
    FULL_SCALE,
    HALF_SCALE,
    RECORD_BUFFERS,
    WAVE_POINTS,
)
from piezod_drivers.serial_line.npoint_lc400.wave_requests import PlayHost, WaveRequests

POLL_NS: Final = 100_000_000
"""Longest time between two questions for the progress."""
HOLD_NS: Final = 200_000_000
"""Time for which the last value is held; the computer has to stop the wavetable in it."""
MOST_FACTOR: Final = 10_000
"""Most clock cycles for a point; no source states the limit."""
_END: Final = 10
"""Counts by which the value at the end may differ from the last one of the table."""


class Lc400Player:
    """Implements `PlayDialogue`.

    Args:
        baud: Bits per second on the line.
    """

    def __init__(self, host: PlayHost, baud: int) -> None:
        self._host, self._requests = host, WaveRequests(host, baud)
        self._table: Table | None = None
        self._last: list[int] = []
        self._n_points = self._n_play = self._n_hold = 0
        self._ask_ns: int | None = None
        self._cycle = 0

    def forget(self) -> None:
        """Forget what another controller may have."""
        self._table = None

    def stop_found(self) -> bool:
        """Stop wavetables that another process has left enabled; return whether one was."""
        if not self._host.outputs or not self._requests.is_enabled():
            return False
        self._requests.read_scales()
        self._requests.stop()
        return True

    def capabilities(self) -> PlayerCapabilities:
        """Return the capabilities, without a request.

        Raises:
            DeviceError: If the recorder has too few buffers.
        """
        # Imported at the start, when this is asked: `load` comes long afterwards.
        from piezod_drivers.serial_line import wave_arrays  # noqa: F401, PLC0415 - numpy

        n_recorded = len(self._host.inputs) + len(self._host.outputs)
        if n_recorded > RECORD_BUFFERS:
            raise DeviceError(f"the recorder has {RECORD_BUFFERS} buffers, {n_recorded} are needed")
        return PlayerCapabilities(
            shortest_interval_ns=CLOCK_NS,
            interval_step_ns=CLOCK_NS,
            longest_interval_ns=CLOCK_NS * MOST_FACTOR,
            points=WAVE_POINTS,
            points_shared=False,
            resolution=(100.0 / FULL_SCALE,) * len(self._host.outputs),
            cycles=0,
            replaces=False,
            record_points=WAVE_POINTS,
            records_with_play=True,
            # The command is set to the last value, as part of the end.
            at_end=AtEnd.HOLDS,
        )

    def load(self, table: Table, check: Check) -> Table:
        """Write the wavetables and read them back; return them as the controller holds them.

        Raises:
            DeviceError: If they do not fit, or the controller holds other values.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        if self._requests.is_enabled():
            raise DeviceError("a wavetable of another program is enabled: disable it")
        counts = table._replace(
            lead_in=(table.lead_in * (FULL_SCALE / 100.0)).round(),
            period=(table.period * (FULL_SCALE / 100.0)).round(),
        )
        n_play, n_hold = table.n_points, -(-HOLD_NS // table.interval_ns)
        if n_play > WAVE_POINTS:  # before all of it is written out
            raise DeviceError(_too_long(n_play, WAVE_POINTS - n_hold, table))
        wave = wave_arrays.closed_wave_of(counts, n_hold)
        if len(wave) > WAVE_POINTS:
            raise DeviceError(_too_long(n_play, WAVE_POINTS - (len(wave) - n_play), table))
        for i, channel in enumerate(self._host.outputs):
            self._requests.write_wave(channel, [int(value) for value in wave[:, i]], check)
        self._n_points, self._n_play, self._n_hold = len(wave), n_play, n_hold
        self._last = [int(value) for value in wave[n_play]]
        self._table = table._replace(
            lead_in=counts.lead_in * (100.0 / FULL_SCALE),
            period=counts.period * (100.0 / FULL_SCALE),
        )
        return self._table

    def arm(self) -> None:
        """Set up wavetables and recorder.

        Raises:
            DeviceError: If the controller holds other values, or a loop input is not the command.
        """
        self._requests.read_scales()
        self._requests.check_commands()
        factor = self._require_table().interval_ns // CLOCK_NS
        self._requests.prepare(self._n_points, self._n_play, factor)

    def start(self) -> None:
        """Start wavetables and recorder in one write.

        Raises:
            DeviceError: If they do not start.
        """
        self._ask_ns, self._cycle = None, 0
        if not self._requests.start().active:
            raise DeviceError("the wavetable does not start: look for its trigger inputs")

    def progress(self, now_ns: int) -> Progress:
        """Ask for the progress now and then; end the play when its table is through.

        Real-time safe.
        """
        if self._ask_ns is not None and now_ns < self._ask_ns:
            return Progress(PlayState.PLAYING, self._cycle)
        table, state = self._require_table(), self._requests.state()
        if not state.active:
            return self._failed("another program, or a trigger input, has stopped the wavetable")
        if state.commanded:
            return self._failed("another program sets a command during the play")
        through = state.point >= self._n_play
        # If it is held at the end of a later repetition, the record is that of the first one.
        if state.point >= self._n_play + self._n_hold or not (through or state.recording):
            hold_ms = HOLD_NS // 1_000_000
            return self._failed(
                f"the computer was late: it must stop a wavetable within {hold_ms} ms after its "
                "end, and the wavetable has begun again"
            )
        if through:
            return self._ended(table)
        left_ns = (self._n_play - state.point) * table.interval_ns
        self._ask_ns = now_ns + min(POLL_NS, left_ns)
        self._cycle = max(state.point - len(table.lead_in), 0) // len(table.period)
        return Progress(PlayState.PLAYING, self._cycle)

    def stop(self) -> Sequence[float]:
        """Stop the wavetables where they are; return the values in force. Real-time safe."""
        return [count * (100.0 / FULL_SCALE) for count in self._requests.stop()]

    def recording(self, check: Check) -> PlayedRecord:
        """Read the record.

        Raises:
            DeviceError: If it is cut off, or the loop inputs do not follow the table.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        table, n_inputs = self._require_table(), len(self._host.inputs)
        columns = [
            self._requests.recorded(buffer, self._n_play, check)
            for buffer in range(n_inputs + len(self._host.outputs))
        ]
        rows = wave_arrays.columns_of(columns)
        positions = rows[:, :n_inputs] * self._host.um_per_count
        positions[abs(rows[:, :n_inputs]) >= HALF_SCALE] = nan  # the ends of the range
        outputs = rows[:, n_inputs:] * self._requests.commands_of([1] * len(self._host.outputs))
        outputs *= 100.0 / FULL_SCALE
        differences = outputs - wave_arrays.first_points(table, self._n_play)
        wave_arrays.check_followed(differences, self._host.ranges())
        return PlayedRecord(table.interval_ns, positions, 0, outputs)

    def sample(self, now_ns: int) -> Reading:
        """Read every position. Real-time safe."""
        return self._host.sample(now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:  # noqa: ARG002 - the interface's
        """Return the loop inputs. Real-time safe."""
        return [count * (100.0 / FULL_SCALE) for count in self._requests.loop_inputs()]

    def close(self) -> None:
        """Do nothing: a play needs no line of its own."""

    def _ended(self, table: Table) -> Progress:
        counts = self._requests.stop()
        if any(abs(a - b) > _END for a, b in zip(counts, self._last, strict=True)):
            return self._failed(
                f"the play has stopped at {counts}, not at the table's end, {self._last} counts"
            )
        return Progress(PlayState.ENDED, table.cycles)

    def _failed(self, reason: str) -> Progress:
        return Progress(PlayState.FAILED, self._cycle, reason)

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table


def _too_long(n_play: int, most: int, table: Table) -> str:
    return (
        f"lead-in and {table.cycles} cycles are a wavetable of {n_play} points, allowed: {most} at "
        f"an interval of {table.interval_ns // 1000} µs, because its end is held for "
        f"{HOLD_NS // 1_000_000} ms; play fewer cycles, or choose a longer interval"
    )
