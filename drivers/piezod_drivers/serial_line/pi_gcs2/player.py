"""Plays a table on a PI controller: wave generators drive the axes, the data recorder records.

A wave generator repeats its whole table. A table with a lead-in is therefore written out: lead-in
and all its cycles become one wave, which is played once.
"""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.bus_device import LOSING
from piezod.devices.bus.dialogue import Reading
from piezod.devices.bus.line import LineFault
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
from piezod_drivers.serial_line.gcs.reply import GcsReply
from piezod_drivers.serial_line.gcs.syntax import ASK_ERROR, NUMBER
from piezod_drivers.serial_line.pi_gcs2.wave_requests import (
    IS_PLAYING,
    MASK,
    Memory,
    PlayHost,
    WaveRequests,
    command,
    follows_generators,
)

POLL_NS: Final = 100_000_000
"""Time between two questions for the progress."""
LONGEST_RATE: Final = 10_000
"""Most servo cycles for a point; no source states the limit."""
CYCLES: Final = 1_000_000
_POSITION, _VOLTAGE = 2, 7
"""Record options: position of an axis, voltage of an output."""


class Gcs2Player:
    """Implements `PlayDialogue`.

    Args:
        at_end: What an output does after its last cycle.
        measures: Whether the voltages in force are measured; otherwise a stop leaves them unknown.
        byte_ns: Time of a byte on the line, in ns.
        pulse_lines: Number of digital outputs for pulses.
    """

    def __init__(
        self, host: PlayHost, at_end: AtEnd, *, measures: bool, byte_ns: int, pulse_lines: int = 0
    ) -> None:
        self._host, self._at_end, self._measures = host, at_end, measures
        self._pulse_lines = pulse_lines
        self._requests = WaveRequests(host, byte_ns)
        self._memory: Memory | None = None
        self._table: Table | None = None
        self._asked_ns: int | None = None
        self._cycle = 0

    def forget(self) -> None:
        """Forget what another controller may have reported."""
        self._memory = self._table = None

    def stop_found(self) -> bool:
        """Stop generators that another process has left running; return whether one ran."""
        if not self._host.numbers or not self._requests.has_generators():
            return False
        found = self._ours(self._requests.running())
        if found:
            self._requests.do(command("WGO", found, ["0"] * len(found)))
        return bool(found)

    def capabilities(self) -> PlayerCapabilities:
        """Ask for sizes and servo time, once.

        Raises:
            DeviceError: If the controller cannot play, or cannot tell where a play has stopped.
        """
        # Imported at the start, when this is asked: `load` comes long afterwards.
        from piezod_drivers.serial_line import wave_arrays  # noqa: F401, PLC0415 - numpy

        if not self._measures:
            raise DeviceError("playing needs read_back: VOL?, because SVA? reports no generator")
        if not self._requests.has_generators():
            raise DeviceError("the controller has no wave generator")
        inputs, outputs = self._host.wiring
        n_recorded = len(inputs) + len(outputs)
        self._memory = memory = self._memory or self._requests.memory(n_recorded)
        if n_recorded > memory.n_record_tables:
            raise DeviceError(
                f"the data recorder has {memory.n_record_tables} tables, {n_recorded} are needed"
            )
        return PlayerCapabilities(
            shortest_interval_ns=memory.servo_ns,
            interval_step_ns=memory.servo_ns,
            longest_interval_ns=memory.servo_ns * LONGEST_RATE,
            points=memory.wave_points,
            points_shared=True,
            resolution=(1e-4,) * len(outputs),
            cycles=CYCLES,
            replaces=False,
            record_points=memory.record_points // memory.n_record_tables,
            records_with_play=True,
            at_end=self._at_end,
            pulse_lines=self._pulse_lines,
            pulses_at=("time", "device") if self._pulse_lines else (),
        )

    def load(self, table: Table, check: Check) -> Table:
        """Write the waves and read them back; return them as the controller holds them.

        Raises:
            DeviceError: If they do not fit, or the controller holds other values.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        able, n_points = self.capabilities(), table.n_points
        if len(table.lead_in) and n_points * len(self._host.numbers) > able.points:
            raise DeviceError(
                f"lead-in and {table.cycles} cycles are a wave of {n_points} points for each "
                f"output, allowed: {able.points} together; without a lead-in a wave is repeated"
            )
        if self._requests.running():
            raise DeviceError("a wave generator is running: stop it")
        wave = wave_arrays.wave_of(table)
        held = [
            self._requests.write_wave(number, [float(value) for value in wave[:, i]], check)
            for i, number in enumerate(self._host.numbers)
        ]
        if self._pulse_lines:
            high = wave_arrays.high_points(table)
            self._requests.set_pulses(self._pulse_lines, high, check)
        if (own := table.compared) is not None:
            self._requests.compare(own, self._host.wiring.inputs[own.input])
        self._table = wave_arrays.table_of(table, held)
        return self._table

    def arm(self) -> None:
        """Connect generators, waves and recorder.

        Raises:
            DeviceError: If the controller refuses.
        """
        table, able, numbers = self._require_table(), self.capabilities(), self._host.numbers
        rate = table.interval_ns // able.shortest_interval_ns
        cycles = "1" if len(table.lead_in) else str(table.cycles)
        recorded = [(axis, _POSITION) for axis in self._host.wiring.inputs]
        recorded += [(number, _VOLTAGE) for number in numbers]
        request = command("WSL", numbers, numbers) + command(
            "WGC", numbers, [cycles] * len(numbers)
        )
        # A start at the end of an earlier play may have moved the offset.
        request += command("WOS", numbers, ["0"] * len(numbers))
        request += f"WTR 0 {rate} 0\nRTR {rate}\n".encode()
        self._requests.do(request)
        for i, (source, option) in enumerate(recorded):
            self._requests.do(f"DRC {i + 1} {source} {option}\n".encode())

    def start(self) -> None:
        """Start all generators in one command, and with them the recorder."""
        self._asked_ns, self._cycle = None, 0
        numbers = self._host.numbers
        self._requests.do(command("WGO", numbers, ["1"] * len(numbers)))

    def progress(self, now_ns: int) -> Progress:
        """Ask now and then which generators are running. Real-time safe."""
        if self._asked_ns is not None and now_ns - self._asked_ns < POLL_NS:
            return Progress(PlayState.PLAYING, self._cycle)
        self._asked_ns = now_ns
        number, table = self._host.numbers[0], self._require_table()
        n_lead_in = len(table.lead_in)
        # A wave with a lead-in is one cycle of the generator, so its point is asked.
        query = "WGI?" if n_lead_in else "WGN?"
        reply = GcsReply(MASK, f"{number}={NUMBER}\n", whole=True)
        request = IS_PLAYING + f"{query} {number}\n".encode() + ASK_ERROR
        mask, count = reply.texts(self._host.conversation.ask(request, reply.length_of))
        if not self._ours(int(mask, 16)):
            return Progress(PlayState.ENDED, table.cycles)
        done = int(float(count))
        self._cycle = max(done - n_lead_in, 0) // len(table.period) if n_lead_in else done
        return Progress(PlayState.PLAYING, self._cycle)

    def stop(self) -> Sequence[float]:
        """Stop the generators; return the measured voltages. Real-time safe.

        A second exchange if the controller refuses, because they have ended already.

        Raises:
            LineFault: If the controller does not reply, or they are still running.
        """
        numbers, ask = self._host.numbers, self._host.conversation.ask
        query = f"VOL? {' '.join(numbers)}\n".encode() + ASK_ERROR
        volts = r" \n".join(f"{number}={NUMBER}" for number in numbers) + r"\n"
        reply = GcsReply(volts)
        request = command("WGO", numbers, ["0"] * len(numbers))
        if self._table is not None and (own := self._table.compared) is not None:
            request += follows_generators(own.line)
        request += query
        try:
            return reply.numbers(ask(request, reply.length_of))
        except LineFault as fault:
            if fault.flag is DeviceFlag.LATE_REPLY or fault.flag in LOSING:
                raise
            both = GcsReply(MASK, volts, whole=True)
            mask, *values = both.texts(ask(IS_PLAYING + query, both.length_of))
            if self._ours(int(mask, 16)):
                raise
            return [float(value) for value in values]

    def recording(self, check: Check) -> PlayedRecord:
        """Read the record.

        Raises:
            DeviceError: If it is too short, or the voltages do not follow the table.
        """
        from piezod_drivers.serial_line import wave_arrays  # noqa: PLC0415 - numpy

        table, n_inputs = self._require_table(), len(self._host.wiring.inputs)
        if table.compared is not None:  # the way to rest passes the positions, too
            self._requests.follow_generators(table.compared.line)
        n_points = min(table.n_points, self.capabilities().record_points)
        tables = [str(i + 1) for i in range(n_inputs + len(self._host.numbers))]
        length = self._requests.record_length()
        if length < n_points:
            raise DeviceError(f"the record has {length} points, expected {n_points}")
        rows = wave_arrays.rows_of(self._requests.read_array("DRR?", n_points, tables, check))
        positions, outputs = rows[:, :n_inputs], rows[:, n_inputs:]
        differences = outputs - wave_arrays.first_points(table, n_points)
        wave_arrays.check_followed(differences, self._host.ranges())
        return PlayedRecord(table.interval_ns, positions, 0, outputs)

    def sample(self, now_ns: int) -> Reading:
        """Read every position. Real-time safe."""
        return self._host.sample(now_ns)

    def in_force(self, now_ns: int) -> Sequence[float]:
        """Return the measured voltages. Real-time safe."""
        return self._host.in_force(now_ns)

    def close(self) -> None:
        """Do nothing: a play needs no line of its own."""

    def _ours(self, mask: int) -> list[str]:
        """Return the numbers of our generators that a mask has."""
        return [number for number in self._host.numbers if mask >> (int(number) - 1) & 1]

    def _require_table(self) -> Table:
        if self._table is None:
            raise DeviceError("no table is loaded")
        return self._table
