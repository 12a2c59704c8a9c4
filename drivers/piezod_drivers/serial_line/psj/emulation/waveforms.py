"""The arbitrary waveform generator and the data recorder of an emulated NV200/D, on one clock."""

from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig

CLOCK_NS: Final = 50_000
N_POINTS: Final = 1024
N_SAMPLES: Final = 6144
"""Samples of each of the two channels of the recorder."""
N_CHANNELS: Final = 2
POSITION, SETPOINT, VOLTAGE = 0, 1, 2
"""Sources of the recorder; it records nothing but 0 for the others."""
BY_COMMAND, BY_GENERATOR = 0, 3
"""Sources of the setpoint; the others keep the voltage."""
ON_SET, ON_RUN = 1, 2
"""What starts a recorder that waits."""


class Waveforms:
    """Generator, recorder, and the choice of the setpoint's source.

    At each tick the sensor is read first, then the generator gives its next value, then the
    recorder stores. A generator that has stopped keeps its last value.

    Args:
        bench: The rig; the device drives its first axis.
        range_v: Voltages at 0 and 100 % of a waveform.

    Attributes:
        percent: The waveform.
        first: Index at which the generator starts.
        loop: First index of all cycles but the first one.
        last: Last index of every cycle.
        cycles: Number of cycles; 0 for no end.
        factor: Ticks for each point.
        index: Index of the present point.
        running: Whether the generator runs.
        source: Source of the setpoint.
        set_v: Setpoint of the command, in V.
        output_v: Value of the generator, in V.
        drops: Whether a generator that stops returns to 0 % at once, as no source excludes.
        sources: Source of each channel of the recorder.
        stride: Ticks for each sample.
        length: Number of samples; 0 for no end.
        starts: What starts a recorder that waits; 0 for nothing.
        waits: Whether the recorder waits for its start.
        recording: Whether it records.
        rows: The samples.
    """

    def __init__(self, bench: SharedRig, range_v: tuple[float, float]) -> None:
        self._bench, self._range_v = bench, range_v
        self.percent = [0.0] * N_POINTS
        self.first = self.loop = self.index = self.cycles = 0
        self.last, self.factor = N_POINTS - 1, 1
        self.running = self.drops = False
        self.source, self.set_v, self.output_v = BY_COMMAND, bench.drive_v(0), bench.drive_v(0)
        self.sources, self.stride, self.length, self.starts = [POSITION, SETPOINT], 1, N_SAMPLES, 0
        self.waits = self.recording = False
        self.rows: list[tuple[float, ...]] = []
        self._next_ns = self._tick = self._done = self._run_tick = self._record_tick = 0
        bench.plays_from(None)

    def advance(self, ahead_ns: int = 0) -> None:
        """Run all ticks that are due; between plays nothing happens in them.

        Args:
            ahead_ns: Time beyond now for which they are due too, in ns.
        """
        until_ns = self._bench.now_ns() + ahead_ns
        if not self._is_busy():
            return
        while self._is_busy() and self._next_ns <= until_ns:
            self._do_tick(self._next_ns)
            ticks = self._ticks_to_next()
            self._next_ns += ticks * CLOCK_NS
            self._tick += ticks
        self._bench.plays_from(self._next_ns if self._is_busy() else None)

    def drive(self) -> bool:
        """Drive the source's voltage; return whether the rig takes it."""
        return self._bench.drive(0, self.output_v if self.source == BY_GENERATOR else self.set_v)

    def set_source(self, source: int) -> None:
        """Set the source of the setpoint; the output goes to its value."""
        self.source = source
        if source in {BY_COMMAND, BY_GENERATOR}:
            self.drive()

    def set_voltage(self, drive_v: float) -> bool:
        """Set the setpoint of the command; return whether it is possible."""
        self.set_v = drive_v
        if self.waits and self.starts == ON_SET:
            self._record()
        return self.source != BY_COMMAND or self.drive()

    def run(self, *, on: bool) -> None:
        """Start the generator at its first index, or stop it."""
        if on:
            self._wake()
            self.running, self._done, self.index = True, 0, self.first - 1
            self._run_tick = self._tick
            if self.waits and self.starts == ON_RUN:
                self._record()
        elif self.running:
            self.running = False
            self._stopped(None)
        self._bench.plays_from(self._next_ns if self._is_busy() else None)

    def record(self, *, on: bool) -> None:
        """Start the recorder, or let it wait for its start; or stop it."""
        self.recording, self.waits = False, on and self.starts != 0
        if on and not self.waits:
            self._record()

    def _record(self) -> None:
        self._wake()
        self.waits, self.recording, self.rows = False, True, []
        self._record_tick = self._tick

    def _wake(self) -> None:
        """Begin at a step of the physics, if nothing runs yet."""
        if not self._is_busy():
            self._next_ns, self._tick = self._bench.start_ns() + CLOCK_NS, 0

    def _is_busy(self) -> bool:
        return self.running or self.recording

    def _ticks_to_next(self) -> int:
        """Return the number of ticks until a point or a sample is due."""
        dues = []
        if self.running:
            dues.append(self.factor - (self._tick - self._run_tick) % self.factor)
        if self.recording:
            dues.append(self.stride - (self._tick - self._record_tick) % self.stride)
        return min(dues, default=1)

    def _do_tick(self, t_ns: int) -> None:
        records = self.recording and (self._tick - self._record_tick) % self.stride == 0
        position_um = self._bench.positions_um(t_ns)[0] if records else 0.0
        if self.running and (self._tick - self._run_tick) % self.factor == 0:
            self._next_point(t_ns)
        if records:
            self._store(position_um if isfinite(position_um) else 0.0, t_ns)

    def _next_point(self, t_ns: int) -> None:
        if self.index == self.last:
            self._done += 1
            if self.cycles and self._done >= self.cycles:
                self.running = False
                self._stopped(t_ns)
                return
            self.index = self.loop - 1
        self.index = (self.index + 1) % N_POINTS
        low_v, high_v = self._range_v
        self._output(low_v + self.percent[self.index] / 100 * (high_v - low_v), t_ns)

    def _stopped(self, t_ns: int | None) -> None:
        if self.drops:
            self._output(self._range_v[0], t_ns)

    def _output(self, drive_v: float, t_ns: int | None) -> None:
        self.output_v = drive_v
        if self.source == BY_GENERATOR:
            self._bench.drive(0, drive_v, t_ns)

    def _store(self, position_um: float, t_ns: int) -> None:
        setpoint_v = self.output_v if self.source == BY_GENERATOR else self.set_v
        values = {
            POSITION: position_um,
            SETPOINT: setpoint_v,
            VOLTAGE: self._bench.drives_v(t_ns)[0],
        }
        self.rows.append(tuple(values.get(source, 0.0) for source in self.sources))
        if self.length and len(self.rows) >= self.length:
            self.recording = False
        elif len(self.rows) > N_SAMPLES:
            del self.rows[0]
