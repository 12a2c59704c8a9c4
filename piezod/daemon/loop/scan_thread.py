"""A scan on a device: block after block, each loaded, played and stored while the outputs hold."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezod.control.guard import Limits
from piezod.control.stage.playing import PlayOutcome
from piezod.control.table_guard import TableGuard
from piezod.daemon.clock import Clock
from piezod.daemon.loop.device_play import DevicePlay
from piezod.daemon.paths import SCANNED, SCANNED_ROWS
from piezod.devices.played_scan import BlockRecord, PlayedScan, ScanBlock, missing_edge
from piezod.devices.player import AtEnd
from piezod.devices.scan_table import ScanTable
from piezod.records.atomic import replacing
from piezod.units import NS_PER_S


class ScanJob(NamedTuple):
    """One scan: who plays what, within which limits."""

    scan: PlayedScan
    table: ScanTable
    guards: Sequence[tuple[Limits, float]]  #: Limits of each axis, and its voltage at rest in V.
    near_v: Sequence[float]  #: How far an output may be from the first point, in V.
    zero_um: Sequence[float]  #: Zero of the sensor of each axis, in µm.


class ScanStore:
    """The record of the last scan: its state, and its samples as rows of float32.

    Args:
        folder: Folder of both files.
        number: Number of the play.
        table: The table.
        inputs: Names of the inputs beside.
    """

    def __init__(
        self, folder: Path, number: int, table: ScanTable, inputs: tuple[str, ...]
    ) -> None:
        self._file, self._rows = folder / SCANNED, folder / SCANNED_ROWS
        self._document: dict[str, Any] = {
            "number": number,
            "axes": table.axes,
            "inputs": inputs,
            "interval_s": table.interval_ns / NS_PER_S,
            "points": table.points,
            "sweeps": table.sweeps,
            "edges": [],
        }

    def begin(self) -> None:
        """Forget the record before."""
        self._rows.write_bytes(b"")
        self.note(0, ended=False)

    def add(self, record: BlockRecord, zero_um: Sequence[float]) -> None:
        """Add the samples of a block, and its edges."""
        self._document["edges"] += [[edge.t_ns, edge.used] for edge in record.edges]
        position_um = record.position_um - np.array(zero_um)
        rows = np.concatenate((position_um, record.detected), axis=1)
        with self._rows.open("ab") as file:
            file.write(rows.astype("<f4").tobytes())

    def note(
        self, done: int, *, ended: bool, failed: str = "", waits_s: float | None = None
    ) -> None:
        """Write how the scan goes on.

        Args:
            done: Number of sweeps that are stored.
            ended: Whether it has ended.
            failed: Why it failed.
            waits_s: Longest wait for an edge, in s, while the device waits for edges.
        """
        document = {**self._document, "done": done, "ended": ended, "failed": failed}
        document["waits_s"] = waits_s
        with replacing(self._file) as temporary:
            temporary.write_text(json.dumps(document), encoding="utf-8")


class ScanThread(DevicePlay):
    """Plays one scan."""

    def __init__(
        self, job: ScanJob, store: ScanStore, idle: Callable[[], bool], clock: Clock
    ) -> None:
        super().__init__(job.scan.axes, job.table.first_v.tolist(), job.near_v, idle, clock)
        self._job, self._store, self._done = job, store, 0
        able = job.scan.capabilities
        self._holds = able.at_end is AtEnd.HOLDS
        self._guards = [
            TableGuard(limits, rest_v, able.at_end, able.cycles) for limits, rest_v in job.guards
        ]

    def _failed(self, why: str) -> None:
        self._store.note(self._done, ended=True, failed=why)

    def _play(self) -> PlayOutcome:
        self._store.begin()
        missing = ""
        for block in self._job.scan.blocks(self._job.table):
            missing = self._play_block(block)
        self._store.note(self._done, ended=True, failed=missing)
        return PlayOutcome(self._resting_v, missing, commanded=True)

    def _play_block(self, block: ScanBlock) -> str:
        """Play a block; return that an edge has not come, "" if all have."""
        scan, table = self._job.scan, self._job.table
        columns, first_v = scan.columns(table, block), self._resting_v
        for guard, column, in_force_v in zip(self._guards, columns, first_v, strict=True):
            guard.check(column, in_force_v)
        held_v = scan.load(table, block, columns, self._now_ns(), self._check)
        self._check()
        scan.player.arm()
        self._start(first_v)
        wait_ns = block.longest_wait_ns(table)
        if wait_ns and table.edges is not None:
            self._store.note(0, ended=False, waits_s=table.edges.within_ns / NS_PER_S)
        ended = self._wait(columns[0].duration_ns + wait_ns)
        if ended and self._holds and not wait_ns:
            self._resting_v = tuple(held_v[-1].tolist())
        self._check()
        if block.is_before:
            return ""
        record = scan.recording(block, columns[0].lead_in_v.size, self._check)
        if wait_ns and self._holds:  # without an edge it has ended early
            last = record.played - 1
            self._resting_v = first_v if last < 0 else tuple(held_v[last].tolist())
        self._store.add(record, self._job.zero_um)
        done = max(block.first, 0) + len(record.position_um)
        self._done = min(done // table.points, table.sweeps)
        self._store.note(self._done, ended=False)
        return missing_edge(table, record)
