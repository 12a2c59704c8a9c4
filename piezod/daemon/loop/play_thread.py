"""Plays tables in a thread: while it runs, it and not the loop has the device.

Loading a table over a slow bus takes seconds, and a record takes as long to be read. The loop only
asks whether the play has ended. The record goes to a file that the supervisor serves.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import NamedTuple

from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.control.law.compensated import limits_of
from piezod.control.stage.playing import PlayOutcome
from piezod.daemon.clock import Clock
from piezod.daemon.loop.device_play import POLL_S, DevicePlay, PlayError
from piezod.daemon.loop.placement import Placement
from piezod.daemon.loop.scan_thread import ScanJob, ScanStore, ScanThread
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.played_scan import PlayedScan
from piezod.devices.player import AtEnd, PlayerCapabilities
from piezod.devices.scan_table import ScanTable
from piezod.devices.wiring import ChannelPair, pairs_of
from piezod.errors import DeviceError
from piezod.records.atomic import replacing
from piezod.units import NS_PER_S


class AxisPlayer(NamedTuple):
    """The player of an axis."""

    axis: PlayedAxis  #: The axis of the device that plays.
    identity: Identity  #: Identity of that device.
    limits: Limits  #: Limits of the drive.
    period_ns: int  #: Period of the loop, in ns.
    rest_v: float = 0.0  #: Voltage at rest, in V.

    @property
    def near_v(self) -> float:
        """How far the first point may be from the output, in V: as far as a write of the loop."""
        return self.limits.reach_v(self.period_ns / NS_PER_S)


class PlayThreads:
    """Implements `control.stage.playing.PlayRunner`: one thread for each play.

    Args:
        players: The player of each axis that has one, by index.
        refusals: Why each other axis has none, by index.
        idle: Returns whether the devices are there, and no other thread uses them.
        zero_um: Returns the displacement that counts as zero on an axis, in µm.
        clock: The clock of the loop.
        file: Where the record of the last play goes.
        scans: Returns the axes of a scan that play together, by their names.
    """

    def __init__(
        self,
        players: Mapping[int, AxisPlayer],
        refusals: Mapping[int, str],
        idle: Callable[[], bool],
        zero_um: Callable[[int], float],
        clock: Clock,
        file: Path,
        scans: Callable[[Sequence[str]], PlayedScan],
    ) -> None:
        self._players, self._refusals = players, refusals
        self._idle, self._zero_um = idle, zero_um
        self._clock, self._file, self._scans = clock, file, scans
        self._number = 0
        self._thread: DevicePlay | None = None

    def refusal(self, axis: int) -> str:
        """Return why an axis cannot play; empty if it can. Real-time safe."""
        return self._refusals.get(axis, "")

    def capabilities(self, axis: int) -> PlayerCapabilities:
        """Return the capabilities of the player of an axis that can play. Real-time safe."""
        return self._players[axis].axis.capabilities

    def begin(self, axis: int, table: AxisTable) -> None:
        """Begin a play, of a table in V. Starts a thread."""
        self._number += 1
        job = _PlayJob(self._players[axis], table, self._number, self._zero_um(axis))
        self._thread = _PlayThread(job, self._idle, self._clock, self._file)
        self._thread.start()

    def scan_refusal(self, axes: Sequence[int], table: ScanTable) -> str:
        """Return why axes cannot play a scan; empty if they can. Real-time safe."""
        for axis in axes:
            if why := self.refusal(axis):
                return why
        try:
            return self._scans(table.axes).misfit(table)
        except DeviceError as error:
            return str(error)

    def begin_scan(self, axes: Sequence[int], table: ScanTable) -> None:
        """Begin a scan, of a table in V. Starts a thread."""
        self._number += 1
        players = [self._players[axis] for axis in axes]
        job = ScanJob(
            self._scans(table.axes),
            table,
            [(each.limits, each.rest_v) for each in players],
            [each.near_v for each in players],
            [self._zero_um(axis) for axis in axes],
        )
        store = ScanStore(self._file.parent, self._number, table, job.scan.beside)
        self._thread = ScanThread(job, store, self._idle, self._clock)
        self._thread.start()

    def abort(self) -> None:
        """Abort the play. Real-time safe."""
        if self._thread is not None:
            self._thread.aborted.set()

    def outcome(self) -> PlayOutcome | None:
        """Return the end of the play, once; None while it goes on. Real-time safe."""
        if self._thread is None or self._thread.is_alive():
            return None
        outcome, self._thread = self._thread.outcome, None
        return outcome


class _PlayJob(NamedTuple):
    """One play: its player, table, number, zero of the sensor in µm."""

    player: AxisPlayer
    table: AxisTable
    number: int
    zero_um: float


class _PlayThread(DevicePlay):
    """Plays one table."""

    def __init__(self, job: _PlayJob, idle: Callable[[], bool], clock: Clock, file: Path) -> None:
        axis, first_v, near_v = job.player.axis, job.table.first_v, job.player.near_v
        super().__init__((axis,), (first_v,), (near_v,), idle, clock)
        self._job, self._axis, self._file = job, axis, file

    def _failed(self, why: str) -> None:
        self._store(self._job.table, None, why)

    def _play(self) -> PlayOutcome:
        taken = self._axis.load(self._job.table, self._now_ns(), self._check)
        self._check()
        self._axis.player.arm()
        self._wait_for_start(taken)
        self._check()
        self._start((taken.first_v,))
        if self._wait(taken.duration_ns):
            self._resting_v = (self._end_v(taken),)
        self._check()
        self._store(taken, self._axis.recording(self._check), "")
        return PlayOutcome(self._resting_v, commanded=True)

    def _wait_for_start(self, taken: AxisTable) -> None:
        """Wait for the instant at which the play is to begin, or until it is aborted.

        Raises:
            PlayError: If the instant has passed.
        """
        late_ns = self._now_ns() - taken.start_ns
        if taken.start_ns and late_ns > 0:
            late_s = late_ns / NS_PER_S
            raise PlayError(f"the device was ready {late_s:.3g} s after the start: start later")
        while (left_ns := taken.start_ns - self._now_ns()) > 0:
            if self.aborted.wait(min(left_ns / NS_PER_S, POLL_S)):
                return

    def _end_v(self, taken: AxisTable) -> float:
        """Return the voltage after the end, in V; NaN if no source says what the device does."""
        holds = self._axis.capabilities.at_end is AtEnd.HOLDS
        return float(taken.period_v[-1]) if holds else nan

    def _store(self, taken: AxisTable, record: AxisPlayRecord | None, failed: str) -> None:
        position_um = [] if record is None else (record.position_um - self._job.zero_um).tolist()
        maker, model, serial, _ = self._job.player.identity
        document = {
            "device": {"maker": maker, "model": model, "serial": serial},
            "number": self._job.number,
            "failed": failed,
            "lead_in_v": taken.lead_in_v.tolist(),
            "drive_v": taken.period_v.tolist(),
            "interval_s": taken.interval_ns / NS_PER_S,
            "cycles": taken.cycles,
            "position_um": [each if isfinite(each) else None for each in position_um],
            "record_interval_s": 0.0 if record is None else record.interval_ns / NS_PER_S,
            "first_point": 0 if record is None else record.first_point,
            "lag_s": self._axis.capabilities.lag_ns / NS_PER_S,
        }
        with replacing(self._file) as temporary:
            temporary.write_text(json.dumps(document), encoding="utf-8")


def play_threads(
    config: DaemonConfig,
    channels: Channels,
    placements: Sequence[Placement],
    clock: Clock,
    file: Path,
) -> PlayThreads:
    """Return what runs the plays of a stage; its devices are open and not yet wrapped.

    Args:
        config: Configuration of the stage.
        channels: Its devices, active.
        placements: Where the loop uses them.
        clock: The clock of the loop.
        file: Where the record of the last play goes.
    """
    pairs, refusals = pairs_of(config.axes), dict[int, str]()
    players, period_ns = dict[int, AxisPlayer](), round(NS_PER_S / config.rate_hz)
    for i, axis in enumerate(pairs):
        try:
            played = PlayedAxis(axis, channels.devices, pairs)
            identity = channels.identities[pairs[axis].amplifier]
            limits, rest_v = limits_of(config.axes[axis]), config.axes[axis].limits.rest_v
            players[i] = AxisPlayer(played, identity, limits, period_ns, rest_v)
        except DeviceError as error:
            refusals[i] = str(error)
            continue
        if len(channels.devices) > 1:
            refusals[i] = _too_many(axis, pairs[axis].amplifier, channels.devices)
    known = {axis: players[i].axis for i, axis in enumerate(pairs) if i in players}
    scans = partial(_scan_of, known, pairs)
    free = partial(all_free, placements)
    return PlayThreads(players, refusals, free, channels.zero_um, clock, file, scans)


def _scan_of(
    known: Mapping[str, PlayedAxis], pairs: Mapping[str, ChannelPair], names: Sequence[str]
) -> PlayedScan:
    """Return axes that play together. Real-time safe: no device is asked for anything."""
    return PlayedScan({name: known[name] for name in names}, pairs)


def all_free(placements: Iterable[Placement]) -> bool:
    """Return whether all devices are there, and no other thread uses one of them.

    Only while the loop requests nothing.
    """
    return all(_is_free(each) for each in placements)


def _is_free(placed: Placement) -> bool:
    # In this order: the last round of a worker may find that its device is lost.
    if isinstance(placed.device, DeviceWorker) and not placed.device.idle:
        return False
    return placed.link is None or placed.link.there


def _too_many(axis: str, player: str, devices: Iterable[str]) -> str:
    """Return why an axis cannot play on a stage with several devices, and what to do."""
    return (
        f"a play needs a stage with one device, because the loop pauses for it, and this one has "
        f"{', '.join(sorted(devices))}: run axis {axis}, with {player} as its only device, from a "
        "configuration of its own, and its other devices from another one"
    )
