"""The stage of an experiment: its devices in virtual time, run phase by phase.

It has no states, faults and waits of a running stage, because its time stands still between two
cycles: nothing can happen there, and nobody else can ask for anything.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.control.cycle import CycleAxis, CycleParts, run_cycle
from piezod.control.guard import Guard
from piezod.control.law.axis import TimeFunction
from piezod.control.law.compensated import limits_of
from piezod.control.stage.boundary import DeviceBoundary
from piezod.control.stage.zeroing import ZERO_OVER_S
from piezod.control.table_guard import TableGuard
from piezod.devices.channels import Channels
from piezod.devices.interface import Device, Identity, KnowsTruth
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.played_scan import BlockRecord, PlayedScan, ScanBlock
from piezod.devices.player import Player, PlayState
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import construct, pairs_of
from piezod.errors import DeviceError
from piezod.experiment.error_rows import NEED_TRUTH
from piezod.experiment.session.devices import owned
from piezod.experiment.virtual.open_loop import OpenLoopAxis
from piezod.hysteresis.memory import FloatArray
from piezod.telemetry.record import CycleRecord
from piezod.units import NS_PER_S, s_to_ns

RAMP_SHARE = 0.5
"""Share of a rest in which the voltage goes to the rest voltage; then it is held."""

COLUMNS = 5
IN_FORCE_V, POSITION_UM, COMMAND_UM, UNCOMPENSATED_V, TRUE_UM = range(COLUMNS)
"""Columns of a trace; unknown values are NaN."""

Advance = Callable[[float], None]
"""Called with the number of further seconds that have run."""
TOLD_CYCLES = 500
"""`Advance` is called after this many cycles each."""


@contextmanager
def opened(config: ExperimentConfig, advance: Advance) -> Iterator["VirtualStage"]:
    """Open and activate the devices of an experiment; leave them safe in any case.

    Raises:
        DeviceError: If a device cannot be opened or cannot have its role, or if metrics need a
            truth that only simulated devices know.
    """
    stage: VirtualStage | None = None
    axes = pairs_of(config.axes)
    devices = construct(config.devices, axes, config.seed)
    _check_truth(config, devices)
    channels = Channels(devices, axes)
    with owned(channels, lambda: stage.now_ns if stage else 0, partial(_too_fast, config.rate_hz)):
        stage = VirtualStage(channels, config, advance)
        yield stage


def _check_truth(config: ExperimentConfig, devices: Mapping[str, Device]) -> None:
    needing = ", ".join(name for name in config.metrics if name in NEED_TRUTH)
    for name, axis in config.axes.items():
        sensor = axis.sensor.device if axis.sensor is not None else ""
        if needing and not isinstance(devices.get(sensor), KnowsTruth):
            message = (
                f"metrics requests {needing}, but device {sensor}, the sensor of axis {name}, "
                "does not know the true displacement, as simulated devices do; remove these"
            )
            raise DeviceError(message)


def _too_fast(rate_hz: float, channels: Channels) -> str:
    """Return why the devices do not allow a rate, "" if they do."""
    max_rate_hz = channels.capabilities().max_rate_hz
    if rate_hz <= max_rate_hz:
        return ""
    return f"rate_hz is {rate_hz:g} Hz; these devices allow at most {max_rate_hz:g} Hz"


class VirtualStage:
    """All axes of an experiment; time advances from phase to phase."""

    def __init__(self, channels: Channels, config: ExperimentConfig, advance: Advance) -> None:
        self._channels, self._advance = channels, advance
        unread = [False] * len(config.axes)
        self._devices = DeviceBoundary(channels, len(unread), reads_back=unread, holds=False)
        # There is no state machine in virtual time: writes always reach the amplifiers.
        self._devices.open = True
        self._axes = tuple(config.axes.values())
        self._names = tuple(config.axes)
        self._pairs = pairs_of(config.axes)
        self.period_ns = round(NS_PER_S / config.rate_hz)
        self.now_ns = 0
        self.in_force_v = channels.read_back(self.now_ns)
        """Voltage in force on each axis, in V."""
        self._zero_um = [0.0] * len(self._axes)
        self._true_zero_um = [0.0] * len(self._axes)

    def run(
        self,
        axes: Sequence[CycleAxis],
        duration_s: float,
        before: Callable[[int], None] | None = None,
        after: Callable[[CycleRecord], None] | None = None,
    ) -> FloatArray:
        """Run cycles for a duration; return the trace, shape (axes, cycles, COLUMNS).

        Args:
            axes: Axis objects, in the order of the configuration.
            duration_s: Duration, in s.
            before: Called before each cycle with its number.
            after: Called after each cycle with its record.

        Raises:
            DeviceError: If the amplifier refuses a voltage.
        """
        # Time is counted in ns, so that cycles never drift from their instants.
        cycles = s_to_ns(duration_s) // self.period_ns
        period_s = self.period_ns / NS_PER_S
        guard = Guard([limits_of(axis) for axis in self._axes], period_s)
        parts = CycleParts(self._devices, axes, guard, period_s)
        trace = np.full((len(axes), cycles, COLUMNS), np.nan)
        for k in range(cycles):
            if before is not None:
                before(k)
            record = run_cycle(parts, self.now_ns)
            self._store(record, trace[:, k])
            if after is not None:
                after(record)
            # The truth at the instant of the cycle, before the new voltage acts.
            trace[:, k, TRUE_UM] = self._channels.true_position_um(self.now_ns)
            self.now_ns += self.period_ns
            if self.now_ns // self.period_ns % TOLD_CYCLES == 0:
                self._advance(TOLD_CYCLES * period_s)
        return trace

    def open_loop(self, waveforms_v: Sequence[TimeFunction], duration_s: float) -> FloatArray:
        """Drive voltage waveforms, one per axis; return the trace as `run` does."""
        axes = [
            OpenLoopAxis(waveform, limits_of(axis), in_force_v, self.now_ns, self.period_ns)
            for waveform, axis, in_force_v in zip(
                waveforms_v, self._axes, self.in_force_v, strict=True
            )
        ]
        return self.run(axes, duration_s)

    def rest(self, duration_s: float) -> FloatArray:
        """Go to the rest voltage and hold it, then zero the sensors.

        Returns:
            The trace as of `run`; its positions are from the previous zero.
        """
        trace = self.go_to_rest(duration_s)
        last = max(1, s_to_ns(ZERO_OVER_S) // self.period_ns)
        self._zero(trace[:, -last:])
        return trace

    def go_to_rest(self, duration_s: float) -> FloatArray:
        """Go to the rest voltage and hold it; return the trace as `run` does."""
        ramps = [
            _ramp(in_force_v, axis.limits.rest_v, RAMP_SHARE * duration_s)
            for axis, in_force_v in zip(self._axes, self.in_force_v, strict=True)
        ]
        return self.open_loop(ramps, duration_s)

    def played(self, axis: str) -> PlayedAxis:
        """Return an axis as one that plays.

        Raises:
            DeviceError: If its device does not play.
        """
        return PlayedAxis(axis, self._channels.devices, self._pairs)

    def identity(self, axis: str) -> Identity:
        """Return the identity of the amplifier of an axis."""
        return self._channels.identities[self._pairs[axis].amplifier]

    def read_back_v(self, axis: str) -> float:
        """Return the read-back voltage of an axis, in V."""
        return self._channels.read_back(self.now_ns)[self._names.index(axis)]

    def play(self, axis: str, table: AxisTable, guard: TableGuard) -> AxisPlayRecord:
        """Play a table on one axis, while the others hold their voltages; return its record.

        Raises:
            DataError: If the guard refuses the table.
            DeviceError: If the device does not play, refuses the table, or fails.
        """
        place, played = self._names.index(axis), self.played(axis)
        guard.check(table, self.read_back_v(axis))
        loaded = played.load(table, self.now_ns)
        self._play_out(played.player, loaded, f"the play of axis {axis}")
        self.in_force_v[place] = float(loaded.period_v[-1])
        record = played.recording()
        return record._replace(
            position_um=record.position_um - self._zero_um[place],
            true_um=record.true_um - self._true_zero_um[place],
        )

    def _play_out(self, player: Player, loaded: AxisTable, what: str, most_ns: int = 0) -> None:
        """Play a loaded table to its end, which edges may delay until `most_ns`."""
        player.arm()
        player.start(self.now_ns)
        duration_ns = loaded.duration_ns + loaded.interval_ns  # a device may start a point later
        step_ns = -(-duration_ns // self.period_ns) * self.period_ns
        last_ns = self.now_ns + most_ns
        self.now_ns += step_ns
        while (progress := player.progress(self.now_ns)).state is PlayState.PLAYING:
            if self.now_ns > last_ns:
                break
            self.now_ns += step_ns
        if progress.state is not PlayState.ENDED:
            player.abort(self.now_ns)
            why = progress.reason or f"it is {progress.state.value} after its duration"
            raise DeviceError(f"{what} failed: {why}")

    def played_scan(self, axes: Sequence[str]) -> PlayedScan:
        """Return axes that play together.

        Raises:
            DeviceError: If their device does not play, or they have several.
        """
        return PlayedScan({name: self.played(name) for name in axes}, self._pairs)

    def play_block(
        self,
        scan: PlayedScan,
        table: ScanTable,
        block: ScanBlock,
        guards: Mapping[str, TableGuard],
    ) -> BlockRecord | None:
        """Play some sweeps of a scan; return their record, relative to the zeros of the sensors.

        What comes before a wait for an edge has no sweep, and so no record.

        Raises:
            DataError: If a guard refuses the table.
            DeviceError: If the device refuses the table, or fails.
        """
        columns = scan.columns(table, block)
        for name, column in zip(table.axes, columns, strict=True):
            guards[name].check(column, self.read_back_v(name))
        held_v = scan.load(table, block, columns, self.now_ns)
        most_ns = columns[0].duration_ns + block.longest_wait_ns(table)
        self._play_out(scan.player, columns[0], "the scan", most_ns)
        if block.is_before:
            self._keep_in_force(table, held_v[-1])
            return None
        record = scan.recording(block, columns[0].lead_in_v.size)
        if record.played:  # an edge has started it
            self._keep_in_force(table, held_v[record.played - 1])
        places = [self._names.index(name) for name in table.axes]
        return record._replace(
            position_um=record.position_um - np.array(self._zero_um)[places],
            true_um=record.true_um - np.array(self._true_zero_um)[places],
        )

    def _keep_in_force(self, table: ScanTable, drives_v: FloatArray) -> None:
        for name, drive_v in zip(table.axes, drives_v.tolist(), strict=True):
            self.in_force_v[self._names.index(name)] = drive_v

    def _zero(self, trace: FloatArray) -> None:
        """Zero the sensors to their means, and the truth to its means over the same samples."""
        for i, axis in enumerate(trace):
            measured = axis[np.isfinite(axis[:, POSITION_UM])]
            if measured.size:
                self._zero_um[i] += float(np.mean(measured[:, POSITION_UM]))
                self._true_zero_um[i] += float(np.mean(measured[:, TRUE_UM]))
        self._channels.zero(self._zero_um, self._true_zero_um)

    def _store(self, record: CycleRecord, row: FloatArray) -> None:
        if self._devices.crash is not None:
            raise self._devices.crash
        if not record.written:
            asked = ", ".join(f"{axis.asked_v:g} V" for axis in record.axes)
            message = f"the amplifier refused {asked} at {record.t_ns / NS_PER_S:.3f} s"
            raise DeviceError(message)
        for i, axis in enumerate(record.axes):
            row[i, IN_FORCE_V] = axis.in_force_v
            row[i, POSITION_UM] = axis.position_um
            row[i, COMMAND_UM] = axis.command_um
            row[i, UNCOMPENSATED_V] = axis.uncompensated_v
            self.in_force_v[i] = axis.drive_v


def _ramp(from_v: float, to_v: float, over_s: float) -> TimeFunction:
    def value(t_s: float) -> float:
        if t_s >= over_s:
            return to_v
        return from_v + (to_v - from_v) * t_s / over_s

    return value
