"""Several axes of one device that play a scan: its table in blocks that fit into the device."""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from piezod.devices.bus.table_check import waits_problem, way_problem
from piezod.devices.played_axis import AxisTable, PlayedAxis, load_together
from piezod.devices.player import (
    AtEnd,
    Check,
    Comparison,
    KnowsTruePlay,
    Player,
    PlayerCapabilities,
    SeenEdge,
    go_on,
)
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import ChannelPair, wiring_of
from piezod.errors import DeviceError
from piezod.units import NS_PER_S

FloatArray: TypeAlias = npt.NDArray[np.float64]
MOST_BLOCK_POINTS = 100_000
"""Most points of a block, so that a long scan needs little memory."""


class ScanBlock(NamedTuple):
    """Points that are loaded and played together."""

    first: int  #: Index of the first point of all sweeps; negative if it begins before them.
    end: int  #: Index behind the last one.

    @property
    def is_before(self) -> bool:
        """Whether it has no sweep."""
        return self.end <= 0

    def longest_wait_ns(self, table: ScanTable) -> int:
        """Return the longest time for which it waits for edges, in ns."""
        return 0 if table.edges is None or self.is_before else table.edges.longest_ns


class BlockRecord(NamedTuple):
    """What the device recorded of a block."""

    position_um: FloatArray  #: (k, axes) measured displacement, in µm; NaN if it is not valid.
    true_um: FloatArray  #: (k, axes) true displacement from rest, in µm; NaN if not known.
    detected: FloatArray  #: (k, inputs) values of the inputs beside, in their units.
    edges: tuple[SeenEdge, ...] = ()  #: The edges, if it waits for them.
    played: int = 0  #: Points of the block that were played.

    def joined(self, later: "BlockRecord") -> "BlockRecord":
        """Return this record with a later one behind it."""
        columns = [np.concatenate(both) for both in zip(self[:3], later[:3], strict=True)]
        position_um, true_um, detected = columns
        return BlockRecord(position_um, true_um, detected, self.edges + later.edges)

    def split(self, at: int) -> "tuple[BlockRecord, BlockRecord]":
        """Return the first samples, and those behind them."""
        p, t, d = self[:3]
        return BlockRecord(p[:at], t[:at], d[:at]), BlockRecord(p[at:], t[at:], d[at:])


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
        if table.compared is not None:
            highest = max(highest, table.compared.line)
        if highest > able.pulse_lines:
            return (
                f"pulses are for line {highest}, the device has {able.pulse_lines} lines of "
                "pulses; see the options of its driver"
            )
        if why := self._too_large(table):
            return why
        if able.at_end is not AtEnd.HOLDS:
            return (
                "it is not known whether the device holds its last voltages, as it must at the end "
                "of a scan and between its parts; see wave_end"
            )
        return ""

    def _too_large(self, table: ScanTable) -> str:
        """Return why a scan does not fit into the device, or waits too often; empty if it fits."""
        if not table.is_whole:
            run_up = table.run_up_points
            room = self._room(table, run_up)
            if table.points <= room:
                return ""
            return (
                f"behind a run-up of {run_up} points the device has room for {room} points of "
                f"each axis, a sweep has {table.points}: choose a longer interval"
            )
        room = self._memory(table)
        able = self.capabilities
        if table.edges is not None and (why := waits_problem(table.edges, able.edge_waits)):
            return why
        if table.compared is not None and (why := self._compares_not(table.compared)):
            return why
        points = table.n_rows + table.points_from_pause
        if points <= room:
            return ""
        return (
            "a scan that waits for edges, or whose device compares, is loaded at once: it has "
            f"{points} points for each axis, the device takes {room}; choose a longer interval, or "
            "fewer sweeps"
        )

    def _compares_not(self, compared: Comparison) -> str:
        """Return why the device cannot compare; empty if it can."""
        if self.axes[compared.input].is_plain:
            return way_problem("device", self.capabilities.pulses_at)
        return "the device compares its own reading, which has a calibration here: pulse by time"

    def _memory(self, table: ScanTable) -> int:
        """Return the most points of a table, if all of them are recorded."""
        able = self.capabilities
        points = self._table_points(table)
        return points // 2 if able.record_shared else min(points, able.record_points)

    def _table_points(self, table: ScanTable) -> int:
        able = self.capabilities
        columns = self._n_outputs + (1 if table.pulses.size else 0)
        return able.points // columns if able.points_shared else able.points

    def _room(self, table: ScanTable, lead_in: int) -> int:
        """Return the most points of a block behind a lead-in, which needs no record."""
        if self.capabilities.record_shared:
            return min((self._table_points(table) - lead_in) // 2, MOST_BLOCK_POINTS)
        return min(self._memory(table) - lead_in, MOST_BLOCK_POINTS)

    def _begins_with_lead_in(self, table: ScanTable) -> bool:
        """Return whether the first block has the whole lead-in."""
        return not table.is_whole and table.points <= self._room(table, len(table.lead_in_v))

    def blocks(self, table: ScanTable) -> Iterator[ScanBlock]:
        """Yield the blocks of a scan that `misfit` has not refused.

        Each ends where the fast axis stands still. Those after the first begin with a run-up. Where
        a device waits for edges, one block has all sweeps. There, and where the lead-in does not
        fit with a sweep, what comes before the pause is played in blocks of its own.
        """
        first, room = 0, self._room(table, len(table.lead_in_v))
        later = self._room(table, table.run_up_points)
        if not self._begins_with_lead_in(table):
            first, room = -table.points_from_pause, later
            most = min(self._table_points(table), MOST_BLOCK_POINTS)
            for begin in range(-table.points_before, first, most):
                yield ScanBlock(begin, min(begin + most, first))
        if table.is_whole:
            yield ScanBlock(first, table.n_rows)
            return
        while first < table.n_rows:
            whole = (first + room - table.pause) // table.points
            end = min(whole * table.points + table.pause, table.n_rows)
            if first + room >= table.n_rows:
                end = table.n_rows
            yield ScanBlock(first, end)
            first, room = end, later

    def columns(self, table: ScanTable, block: ScanBlock) -> list[AxisTable]:
        """Return the table of each axis in a block, for the guard."""
        lead_in = table.lead_in_v[:0]
        if block.is_before:
            rows = table.before(*block)
        else:
            rows = table.rows(*block)
            if block.first == 0 and self._begins_with_lead_in(table):
                lead_in = table.lead_in_v
            elif not table.is_whole:
                lead_in = table.run_up(block.first)
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
        """Load a block; return its voltages as the device plays them, shape (k, axes), in V.

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
        edges, compared = (None, None) if block.is_before else (table.edges, table.compared)
        if compared is not None:
            compared = compared._replace(input=self.axes[compared.input].place)
        echoed = load_together(self.axes, columns, pulses, now_ns, check, edges, compared)
        return np.stack([echo.period_v for echo in echoed], axis=1)

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
        before = 0 if block.is_before else max(-block.first, 0)
        kept = slice(first + before, first + block.end - block.first)
        played = len(positions) - first
        return BlockRecord(positions[kept], true_um[kept], detected[kept], record.edges, played)


def missing_edge(table: ScanTable, record: BlockRecord) -> str:
    """Return that an edge has not come, from the record of all sweeps; empty if all have."""
    edges = table.edges
    if edges is None or len(record.position_um) >= table.n_rows:
        return ""
    n = sum(edge.used for edge in record.edges)
    where = f"in plane {n + 1} of {table.sweeps}" if edges.first else "before its first sweep"
    within_s = edges.within_ns / NS_PER_S
    return f"no pulse came within {within_s:g} s (within_s): the scan has ended {where}"
