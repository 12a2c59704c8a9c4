"""The wavetables and the recorder of the emulated LC.400, on its clock."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.serial_line.npoint_lc400 import codec
from piezod_drivers.serial_line.npoint_lc400.codec import CLOCK_NS, HALF_SCALE, Lc400Register

RANGE_UM: Final = 30
"""Positions go from minus to plus half of this range."""
MID_UM: Final = 13.0
"""Displacement from rest at position 0, in µm."""
MID_V: Final = 75.0
V_PER_PCT: Final = 1.5
"""Commands of -50 % and 50 % drive 0 V and 150 V at the actuator."""
_SOON: Final = 50_000
"""Clock cycles: while nothing is due within them, the wavetables stand still."""
_WORD_BYTES: Final = 4


def position_counts(position_um: float) -> int:
    """Return the counts of a sensor; without signal it is at the end of its range."""
    if not isfinite(position_um):
        return HALF_SCALE
    return _clamped(round((position_um - MID_UM) / RANGE_UM * codec.FULL_SCALE))


class Wavetables:
    """Drives all channels: their commands, and their wavetables.

    In each clock cycle with a sample the sensors are read first. Then the wavetables give their
    next values, and the recorder stores. Requests that come together act in one cycle.

    Args:
        bench: The rig; its axes are the first channels.
        words: The memory of the controller.

    Attributes:
        adds: Whether a wavetable adds to the command; else it replaces it. No source says.
        drops: Whether a wavetable that is not active counts as 0; else its point stays. No source
            says.
    """

    def __init__(self, bench: SharedRig, words: dict[int, int]) -> None:
        self._bench, self._words = bench, words
        self.adds = self.drops = True
        self._begin_ns = self._cycle = 0
        self._waited = [0] * bench.n_axes
        self._recorded = self._since_sample = 0
        self._was_active = [False] * bench.n_axes
        self._was_recording = False
        self._driven = [self.loop_input(i) for i in range(bench.n_axes)]
        bench.plays_from(None)

    def advance(self) -> None:
        """Run all clock cycles that are due; between plays nothing happens in them."""
        if not self._is_busy():
            return
        now = (self._bench.now_ns() - self._begin_ns) // CLOCK_NS
        while (step := self._next_due()) is not None and self._cycle + step <= now:
            self._wait(step)
            self._do_cycle(self._begin_ns + self._cycle * CLOCK_NS)
        if self._is_busy() and self._cycle < now:
            self._wait(now - self._cycle)
        self._lend()

    def settle(self) -> None:
        """Let the requests that have come act in one clock cycle."""
        active = [self._is_active(i) for i in range(self._bench.n_axes)]
        recording = self._get(codec.RECORD_START) != 0
        starts = [i for i, on in enumerate(active) if on and not self._was_active[i]]
        records = recording and not self._was_recording
        t_ns = None
        if starts or records:
            if not (any(self._was_active) or self._was_recording):
                self._begin_ns, self._cycle = self._bench.start_ns(), 0
            t_ns = self._begin_ns + self._cycle * CLOCK_NS
        for i in starts:
            self._waited[i] = 0
        self._was_active, self._was_recording = active, recording
        if records:
            self._recorded = self._since_sample = 0
        before = self._bench.positions_um(t_ns) if records else ()
        for i in range(self._bench.n_axes):
            if i in starts or self.loop_input(i) != self._driven[i]:
                self._drive(i, t_ns)
        if records:
            self._store(before)
        self._lend()

    def loop_input(self, axis: int) -> int:
        """Return the input of the control loop, which drives the amplifier in open loop."""
        command = self._of(axis, Lc400Register.SETPOINT)
        if not self._of(axis, Lc400Register.WAVE_ENABLE):
            return _clamped(command)
        index = self._of(axis, Lc400Register.WAVE_INDEX)
        point = self._get(codec.wave_address(axis + 1) + _WORD_BYTES * index)
        if self.drops and not self._is_active(axis):
            return _clamped(command)
        return _clamped(command + point if self.adds else point)

    def _next_due(self) -> int | None:
        """Return the number of clock cycles until something happens; None if nothing will."""
        due = [
            max(self._of(i, Lc400Register.WAVE_DELAY) + 1 - self._waited[i], 1)
            for i, on in enumerate(self._was_active)
            if on
        ]
        if self._was_recording:
            due.append(max(self._divisor() - self._since_sample, 1))
        return min(due, default=None)

    def _wait(self, cycles: int) -> None:
        self._cycle += cycles
        self._since_sample += cycles
        self._waited = [waited + cycles for waited in self._waited]

    def _do_cycle(self, t_ns: int) -> None:
        records = self._was_recording and self._since_sample >= self._divisor()
        before = self._bench.positions_um(t_ns) if records else ()
        for i, on in enumerate(self._was_active):
            if on and self._waited[i] > self._of(i, Lc400Register.WAVE_DELAY):
                index = self._of(i, Lc400Register.WAVE_INDEX) + 1
                last = self._of(i, Lc400Register.WAVE_LAST)
                self._set(i, Lc400Register.WAVE_INDEX, 0 if index > last else index)
                self._waited[i] = 0
                self._drive(i, t_ns)
        if records:
            self._store(before)

    def _drive(self, axis: int, t_ns: int | None) -> None:
        counts = self._driven[axis] = self.loop_input(axis)
        drive_v = MID_V + counts / codec.FULL_SCALE * 100 * V_PER_PCT
        self._bench.drive(axis, drive_v, t_ns)

    def _store(self, positions_um: Sequence[float]) -> None:
        values: dict[int, int] = {}
        for i, position_um in enumerate(positions_um):
            channel = i + 1
            position = codec.register_address(channel, Lc400Register.POSITION)
            values[position] = position_counts(position_um)
            values[codec.register_address(channel, Lc400Register.LOOP_INPUT)] = self.loop_input(i)
        for buffer in range(codec.RECORD_BUFFERS):
            source = self._get(codec.record_pointer(buffer))
            if source:
                place = codec.record_buffer(buffer) + _WORD_BYTES * self._recorded
                self._words[place] = values.get(source, self._get(source))
        self._recorded, self._since_sample = self._recorded + 1, 0
        if self._recorded >= min(self._get(codec.RECORD_COUNT), codec.WAVE_POINTS):
            self._words[codec.RECORD_START] = 0
            self._was_recording = False

    def _lend(self) -> None:
        """Let the clock of the rig wait for the next point, if there is one soon."""
        step = self._next_due()
        if step is None or step > _SOON:
            self._bench.plays_from(None)
        else:
            self._bench.plays_from(self._begin_ns + (self._cycle + step) * CLOCK_NS)

    def _is_busy(self) -> bool:
        return any(self._was_active) or self._was_recording

    def _is_active(self, axis: int) -> bool:
        registers = (Lc400Register.WAVE_ENABLE, Lc400Register.WAVE_ACTIVE)
        return all(self._of(axis, register) for register in registers)

    def _divisor(self) -> int:
        return max(self._get(codec.RECORD_DIVISOR), 1)

    def _get(self, address: int) -> int:
        return self._words.get(address, 0)

    def _of(self, axis: int, register: int) -> int:
        return self._get(codec.register_address(axis + 1, register))

    def _set(self, axis: int, register: int, value: int) -> None:
        self._words[codec.register_address(axis + 1, register)] = value


def _clamped(counts: int) -> int:
    return max(-HALF_SCALE, min(counts, HALF_SCALE))
