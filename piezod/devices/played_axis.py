"""One axis of a device that plays: tables in V at the actuator, records in µm."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple, Protocol, TypeAlias, cast

import numpy as np
import numpy.typing as npt

from piezod.devices.inputs import CalibratedInput
from piezod.devices.interface import Amplifier, Device, Sample, Sensor
from piezod.devices.outputs import SLACK_V, CalibratedOutput
from piezod.devices.player import (
    Check,
    Comparison,
    EdgeWaits,
    KnowsTruePlay,
    Player,
    PlayerCapabilities,
    Table,
    go_on,
)
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError

FloatArray: TypeAlias = npt.NDArray[np.float64]


class AxisTable(NamedTuple):
    """Voltages to play on one axis."""

    interval_ns: int  #: Time between two points, in ns.
    lead_in_v: FloatArray  #: (m,) voltages that are played once, before the period, in V.
    period_v: FloatArray  #: (n,) voltages of one period, in V.
    cycles: int  #: Number of periods.
    start_ns: int = 0  #: Instant at which the play begins, in ns; 0 for as soon as possible.

    @property
    def first_v(self) -> float:
        """The first voltage, in V."""
        return float(self.lead_in_v[0] if self.lead_in_v.size else self.period_v[0])

    @property
    def duration_ns(self) -> int:
        """Duration of the whole play, in ns."""
        return (self.lead_in_v.size + self.period_v.size * self.cycles) * self.interval_ns


class AxisPlayRecord(NamedTuple):
    """Record of one axis during a play."""

    interval_ns: int  #: Time between two samples, in ns.
    #: (k,) measured displacement as the sensor gives it, in µm; NaN if it is not valid.
    position_um: FloatArray
    #: (k,) true displacement from rest, in µm; NaN if the device does not know it.
    true_um: FloatArray
    first_point: int  #: Index of the point of lead-in and period at the first sample.


class PlayingDevice(Player, Sensor, Amplifier, Protocol):
    """A device that plays, measures and drives."""


class PlayedAxis:
    """An axis whose amplifier and sensor are channels of one device that plays.

    The other outputs of the device keep their voltages during a play.

    Args:
        axis: Name of the axis.
        devices: Devices by name, open and active.
        axes: Channels of each axis.

    Raises:
        DeviceError: If its device does not play or does not report how, or its sensor belongs to
            another device.
    """

    def __init__(
        self, axis: str, devices: Mapping[str, Device], axes: Mapping[str, ChannelPair]
    ) -> None:
        pair = axes[axis]
        device = devices[pair.amplifier]
        if not isinstance(device, Player):
            raise DeviceError(
                f"device {pair.amplifier}, the amplifier of axis {axis}, does not play tables: "
                "follow the command in the loop, or use a device that plays"
            )
        if pair.sensor != pair.amplifier:
            raise DeviceError(
                f"axis {axis} is driven by device {pair.amplifier} and measured by "
                f"{pair.sensor or 'nothing'}: a record beside a play needs a sensor on the device "
                "that plays"
            )
        wiring = wiring_of(pair.amplifier, axes)
        self.device = cast("PlayingDevice", device)
        """The device that plays, measures and drives it."""
        self.output = wiring.outputs.index(pair.output or axis)
        """Index of its output among those of the device."""
        self.place = wiring.inputs.index(pair.input or axis)
        """Index of its input among those of the device."""
        self._to_v = CalibratedOutput(pair.to_v)
        self._to_um = CalibratedInput(wiring, pair.input or axis, pair.to_um, pair.light)
        self.capabilities: PlayerCapabilities = self.device.player_capabilities()
        """Capabilities of the device; asked here, before other threads use it, and only once."""
        ranges = self.device.capabilities().ranges
        if ranges:
            self._to_v.set_range(*ranges[self.output])

    @property
    def is_plain(self) -> bool:
        """Whether the device reads it in µm: no calibration and no light are applied."""
        return self._to_um.plain_place is not None

    @property
    def player(self) -> Player:
        """The device."""
        return self.device

    @property
    def step_v(self) -> float:
        """Smallest step of the voltage, in V; 0 if the device does not round."""
        step = self.capabilities.resolution[self.output]
        return abs(self._to_v.voltage(step) - self._to_v.voltage(0.0))

    def read_back_v(self, now_ns: int) -> float:
        """Return the voltage in force, in V; NaN if the device does not tell it."""
        return self._to_v.voltage(self.device.read_back(now_ns)[self.output])

    def load(self, table: AxisTable, now_ns: int, check: Check = go_on) -> AxisTable:
        """Load a table; return it as the device will play it.

        Raises:
            DeviceError: If the device refuses it, or does not know the voltage of an output that
                is to stay.
        """
        (echoed,) = load_together([self], [table], None, now_ns, check)
        return echoed

    def compare(self, table: AxisTable, loaded: AxisTable) -> None:
        """Refuse a table that the device would play otherwise than requested."""
        for part in ("lead_in_v", "period_v"):
            asked_v, echoed_v = getattr(table, part), getattr(loaded, part)
            if echoed_v.shape != asked_v.shape:
                raise DeviceError(
                    f"the device took {echoed_v.size} of {asked_v.size} points of {part}"
                )
            off_v = np.abs(echoed_v - asked_v)
            if off_v.size and not np.max(off_v) <= self.step_v + SLACK_V:
                k = int(np.argmax(off_v))
                raise DeviceError(
                    f"the device would play {echoed_v[k]:g} V in place of {asked_v[k]:g} V at "
                    f"point {k} of {part}, allowed: its resolution, {self.step_v:g} V"
                )

    def abort(self, now_ns: int) -> float:
        """Stop a play; return the voltage in force, in V, NaN if it is unknown. Never raises."""
        return self._to_v.voltage(self.device.abort(now_ns)[self.output])

    def recording(self, check: Check = go_on) -> AxisPlayRecord:
        """Return the record of the play that has ended.

        Raises:
            DeviceError: If none has ended, or the record could not be read.
        """
        record = self.device.recording(check)
        true_um = np.full(len(record.positions), np.nan)
        if isinstance(self.device, KnowsTruePlay):
            true_um = self.device.true_recording()[:, self.place]
        position_um = self.displacements_of(record.positions)
        return AxisPlayRecord(record.interval_ns, position_um, true_um, record.first_point)

    def values_of(self, drive_v: FloatArray) -> FloatArray:
        """Return the values of its output for voltages, shape (n,)."""
        values = map(self._to_v.value, drive_v.tolist())
        return np.fromiter(values, np.float64, drive_v.size)

    def voltages_of(self, columns: FloatArray) -> FloatArray:
        """Return its voltages in the columns of a table, shape (n,), in V."""
        values = map(self._to_v.voltage, columns[:, self.output].tolist())
        return np.fromiter(values, np.float64, len(columns))

    def displacements_of(self, positions: FloatArray) -> FloatArray:
        """Return its displacements in a record, shape (k,), in µm; NaN if they are not valid."""
        if self._to_um.plain_place is not None:
            return positions[:, self._to_um.plain_place].copy()
        displacements = np.full(len(positions), np.nan)
        for k, row in enumerate(positions.tolist()):
            sample = self._to_um.sample([Sample(0, value, isfinite(value)) for value in row])
            if sample.valid:
                displacements[k] = sample.position_um
        return displacements


def load_together(
    axes: Sequence[PlayedAxis],
    tables: Sequence[AxisTable],
    pulses: npt.NDArray[np.uint8] | None,
    now_ns: int,
    check: Check = go_on,
    edges: EdgeWaits | None = None,
    compared: Comparison | None = None,
) -> list[AxisTable]:
    """Load the tables of axes of one device; return them as the device will play them.

    Args:
        axes: The axes.
        tables: Table of each axis, all with as many points, the same interval and cycles.
        pulses: As in a table of the device.
        now_ns: The present instant, in ns.
        check: Called between exchanges.
        edges: As in a table of the device.
        compared: As in a table of the device.

    Raises:
        DeviceError: If the device refuses them, or does not know the voltage of an output that is
            to stay.
    """
    device, first = axes[0].device, tables[0]
    others = list(device.read_back(now_ns))
    for axis in axes:
        others[axis.output] = 0.0  # replaced by the table
    if not all(map(isfinite, others)):
        raise DeviceError("the device does not know the voltage of another output: write one")
    lead_in, period = (
        np.tile(np.array(others, dtype=np.float64), (size, 1))
        for size in (first.lead_in_v.size, first.period_v.size)
    )
    for axis, table in zip(axes, tables, strict=True):
        lead_in[:, axis.output] = axis.values_of(table.lead_in_v)
        period[:, axis.output] = axis.values_of(table.period_v)
    wanted = Table(first.interval_ns, lead_in, period, first.cycles, pulses, edges, compared)
    loaded = device.load(wanted, check)
    echoed = [
        table._replace(
            lead_in_v=axis.voltages_of(loaded.lead_in), period_v=axis.voltages_of(loaded.period)
        )
        for axis, table in zip(axes, tables, strict=True)
    ]
    for axis, table, echo in zip(axes, tables, echoed, strict=True):
        axis.compare(table, echo)
    return echoed
