"""Several axes of one device that play a scan: its table in blocks that fit into the device."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.played_axis import AxisTable, PlayedAxis, load_together
from piezod.devices.player import (
    AtEnd,
    Check,
    KnowsTruePlay,
    Player,
    PlayerCapabilities,
    go_on,
)
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError

FloatArray: TypeAlias = npt.NDArray[np.float64]
MOST_BLOCK_POINTS = 100_000
"""Most points of a block, so that a long scan needs little memory."""


class ScanBlock(NamedTuple):
    """Points that are loaded and played together."""

    first: int  #: Index of the first point of all sweeps.
    end: int  #: Index behind the last one.


class BlockRecord(NamedTuple):
    """What the device recorded of a block."""

    position_um: FloatArray  #: (k, axes) measured displacement, in µm; NaN if it is not valid.
    true_um: FloatArray  #: (k, axes) true displacement from rest, in µm; NaN if not known.
    detected: FloatArray  #: (k, inputs) values of the inputs beside, in their units.

    def joined(self, later: "BlockRecord") -> "BlockRecord":
        """Return this record with a later one behind it."""
        return BlockRecord(*map(np.concatenate, zip(self, later, strict=True)))

    def split(self, at: int) -> "tuple[BlockRecord, BlockRecord]":
        """Return the first samples, and those behind them."""
        return BlockRecord(*(part[:at] for part in self)), BlockRecord(
            *(part[at:] for part in self)
        )


class PlayedScan:
    """The axes of a scan, whose amplifiers and sensors are channels of one device that plays.

    Args:
        played: The axes by name, in the order of a table's columns.
        axes: Channels of all axes of the stage.

    Raises:
        DeviceError: If they have several devices.
    """

    def __init__(self, played: Mapping[str, PlayedAxis], axes: Mapping[str, ChannelPair]) -> None:
        used = dict.fromkeys(axes[name].amplifier for name in played)
        if len(used) > 1:
            raise DeviceError(
                f"axes {' and '.join(played)} are driven by the devices {' and '.join(used)}, "
                "which have no common clock: a scan that devices play needs one device"
            )
        (device,) = used
        self.axes = tuple(played.values())
        """Each axis, in the order of columns."""
        wiring = wiring_of(device, axes)
        self._n_outputs = len(wiring.outputs)
        self.beside = tuple(dict.fromkeys(x for name in played for x in axes[name].beside))
        """Names of the inputs that are recorded beside."""
        self._beside_places = [wiring.inputs.index(name) for name in self.beside]

    @property
    def player(self) -> Player:
        """The device."""
        return self.axes[0].player

    @property
    def capabilities(self) -> PlayerCapabilities:
        """Capabilities of the device."""
        return self.axes[0].capabilities

    def misfit(self, table: ScanTable) -> str:
        """Return why the device cannot play a scan; empty if it can. Real-time safe."""
        able = self.capabilities
        if able.legal_interval_ns(table.interval_ns) != table.interval_ns:
            legal_us = able.legal_interval_ns(table.interval_ns) / 1000
            return (
                f"the device does not play at an interval of {table.interval_ns / 1000:g} µs; the "
                f"next one that it has is {legal_us:g} µs"
            )
        highest = (int(table.pulses.max()) | table.framed).bit_length() if table.pulses.size else 0
        if highest > able.pulse_lines:
            return (
                f"pulses are for line {highest}, the device has {able.pulse_lines} lines of "
                "pulses; see the options of its driver"
            )
        lead_in, room = len(table.lead_in_v), self._room(table)
        if table.points > room:
            return (
                f"behind the lead-in of {lead_in} points the device has room for {room} points of "
                f"each axis, a sweep has {table.points}: choose a longer interval"
            )
        if able.at_end is not AtEnd.HOLDS:
            return (
                "it is not known whether the device holds its last voltages, as it must at the end "
                "of a scan and between its parts; see wave_end"
            )
        return ""

    def _room(self, table: ScanTable, *, first: bool = True) -> int:
        """Return the most points of a block; of the first one, behind the lead-in."""
        able = self.capabilities
        lead_in = len(table.lead_in_v) if first else table.run_up_points
        columns = self._n_outputs + (1 if table.pulses.size else 0)
        points = able.points // columns if able.points_shared else able.points
        if able.record_shared:  # which needs no lead-in
            return min((points - lead_in) // 2, MOST_BLOCK_POINTS)
        return min(min(points, able.record_points) - lead_in, MOST_BLOCK_POINTS)

    def blocks(self, table: ScanTable) -> Iterator[ScanBlock]:
        """Yield the blocks of a scan that `misfit` has not refused.

        Each ends where the fast axis stands still. Those after the first begin with a run-up.
        """
        first, room = 0, self._room(table)
        while first < table.n_rows:
            whole = (first + room - table.pause) // table.points
            end = min(whole * table.points + table.pause, table.n_rows)
            if first + room >= table.n_rows:
                end = table.n_rows
            yield ScanBlock(first, end)
            first, room = end, self._room(table, first=False)

    def columns(self, table: ScanTable, block: ScanBlock) -> list[AxisTable]:
        """Return the table of each axis in a block, for the guard."""
        rows = table.rows(block.first, block.end)
        lead_in = table.run_up(block.first) if block.first else table.lead_in_v
        return [
            AxisTable(table.interval_ns, lead_in[:, i], rows[:, i], 1)
            for i in range(len(self.axes))
        ]

    def load(
        self,
        table: ScanTable,
        block: ScanBlock,
        columns: Sequence[AxisTable],
        now_ns: int,
        check: Check = go_on,
    ) -> FloatArray:
        """Load a block; return the last voltage of each axis, shape (axes,), in V.

        Args:
            table: The scan.
            block: The block.
            columns: Its `columns`, which the guard has seen.
            now_ns: The present instant, in ns.
            check: Called between exchanges.

        Raises:
            DeviceError: If the device refuses it, or does not know the voltage of an output that
                is to stay.
        """
        masks = table.masks(block.first, block.end)
        pulses = masks if masks.size else None
        echoed = load_together(self.axes, columns, pulses, now_ns, check)
        return np.array([echo.period_v[-1] for echo in echoed])

    def recording(self, block: ScanBlock, lead_in: int, check: Check = go_on) -> BlockRecord:
        """Return the record of a block that has ended, without its lead-in of this many points.

        Raises:
            DeviceError: If it has not ended, or the record could not be read.
        """
        device = self.axes[0].device
        record = device.recording(check)
        positions = np.stack(
            [axis.displacements_of(record.positions) for axis in self.axes], axis=1
        )
        true_um = np.full(positions.shape, np.nan)
        if isinstance(device, KnowsTruePlay):
            true_um = device.true_recording()[:, [axis.place for axis in self.axes]]
        first = lead_in - record.first_point
        if first < 0:
            raise DeviceError(f"the record begins {-first} points after the first sweep")
        detected = record.positions[:, self._beside_places]
        kept = slice(first, first + block.end - block.first)
        return BlockRecord(positions[kept], true_um[kept], detected[kept])
