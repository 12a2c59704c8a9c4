"""The wave generators of the emulated controller, which play tables by the servo clock."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod_drivers.serial_line.gcs.emulator import GcsAxis, GcsRefusal
from piezod_drivers.serial_line.pi_gcs2.emulation.data_recorder import (
    POSITION,
    VOLTAGE,
    DataRecorder,
)
from piezod_drivers.serial_line.pi_gcs2.emulation.trigger_outputs import TriggerOutputs

SERVO_NS: Final = 50_000
MOST_POINTS: Final = 262_144
"""Points of all wave tables together."""
STOP, START, START_AT_END = 0, 1, 0x101
"""Modes of a generator; the last one starts each cycle where the one before has ended."""
_NO_TABLE, _NO_MODE = 75, 406


@dataclass
class WaveGenerator:
    """A generator, which drives the axis of the same number."""

    table: int = 0  #: Wave table; 0 for none.
    cycles: int = 0  #: Number of cycles; 0 for no end.
    offset: float = 0.0  #: Added to every value; a generator that starts at its end changes it.
    mode: int = STOP  #: Mode of the last start.
    running: bool = False  #: Whether it plays.
    point: int = 0  #: Index of the next point.
    done: int = 0  #: Complete cycles since the start.
    output: float | None = None  #: Its last value; None before the first.


class WaveGenerators:
    """All generators, their tables, and the data recorder, on one servo clock.

    A start of generators starts the recorder. In each servo cycle the sensors are read first, then
    the generators give their next values, then the recorder stores. After the last cycle, and after
    a stop, an output keeps its value.

    Args:
        axes: State of each axis.

    Attributes:
        tables: Values of each wave table that has any.
        generators: The generators.
        rate: Servo cycles for each point of a table.
        recorder: The data recorder.
        triggers: The digital outputs.
    """

    def __init__(self, bench: SharedRig, axes: Sequence[GcsAxis]) -> None:
        self._bench, self._axes = bench, axes
        self.tables: dict[int, list[float]] = {}
        self.generators = [WaveGenerator() for _ in axes]
        self.rate = 1
        self.recorder = DataRecorder(self._value_of)
        self.triggers = TriggerOutputs()
        self._next_ns = self._cycle = 0
        self._positions_um: Sequence[float] = ()
        self._drive_v = [0.0] * len(axes)
        bench.plays_from(None)

    def advance(self) -> None:
        """Run all servo cycles that are due; between plays nothing happens in them."""
        now_ns, was_busy = self._bench.now_ns(), self._is_busy()
        while self._is_busy() and self._next_ns <= now_ns:
            self._servo_cycle(self._next_ns)
            self._next_ns += SERVO_NS
        if was_busy:
            self._bench.plays_from(self._next_ns if self._is_busy() else None)

    def running(self) -> int:
        """Return the mask of the running generators."""
        return sum(1 << i for i, each in enumerate(self.generators) if each.running)

    def go(self, modes: Mapping[int, int]) -> None:
        """Start and stop generators, by their indices; all or none."""
        for i, mode in modes.items():
            if mode not in {STOP, START, START_AT_END}:
                raise GcsRefusal(_NO_MODE)
            if mode and not self.tables.get(self.generators[i].table):
                raise GcsRefusal(_NO_TABLE)
        idle = not self.running()
        for i, mode in modes.items():
            each = self.generators[i]
            each.mode, each.running = mode, bool(mode)
            if mode:
                each.point = each.done = 0
        if any(modes.values()):
            self.recorder.start()
            if idle:
                self._cycle, self._next_ns = 0, self._bench.start_ns() + SERVO_NS
                self._drive_v = [axis.setpoint_v for axis in self._axes]
        self._bench.plays_from(self._next_ns if self._is_busy() else None)

    def stop_all(self) -> None:
        """Stop every generator."""
        self.go(dict.fromkeys(range(len(self.generators)), STOP))

    def position_um(self, i: int) -> float:
        """Return the position of an axis, during a play that of the last servo cycle."""
        playing = self.running() and self._positions_um
        return self._positions_um[i] if playing else self._bench.position_um(i)

    def measured_v(self, i: int) -> float:
        """Return the measured voltage of an axis, during a play that of the last servo cycle."""
        if self.running() and self._positions_um:
            return self._bench.drives_v(self._next_ns - SERVO_NS)[i]
        return self._bench.drive_v(i)

    def _is_busy(self) -> bool:
        return bool(self.running()) or self.recorder.running

    def _servo_cycle(self, t_ns: int) -> None:
        self._positions_um = self._bench.positions_um(t_ns)
        if self._cycle % self.rate == 0:
            for i, each in enumerate(self.generators):
                if each.running:
                    self._next_point(i, each, t_ns)
            # The point of the first generator counts; all that play together have the same.
            self.triggers.at(self.generators[0].point if self.running() else 0)
        self.triggers.measured(self._positions_um)
        self.recorder.record(len(self._axes))
        self._cycle += 1

    def _next_point(self, i: int, each: WaveGenerator, t_ns: int) -> None:
        table = self.tables[each.table]
        if each.point == len(table):
            each.done, each.point = each.done + 1, 0
            if each.mode == START_AT_END and each.output is not None:
                each.offset = each.output
            if each.cycles and each.done >= each.cycles:
                each.running = False
                return
        each.output = each.offset + table[each.point]
        each.point += 1
        axis = self._axes[i]
        if axis.online and not axis.servo and self._bench.drive(i, each.output, t_ns):
            self._drive_v[i] = each.output

    def _value_of(self, i: int, option: int) -> float:
        if option == POSITION:
            value_um = self._positions_um[i]
            return value_um if isfinite(value_um) else 0.0
        if option == VOLTAGE:
            return self._drive_v[i]
        output = self.generators[i].output
        return self._axes[i].setpoint_v if output is None else output
