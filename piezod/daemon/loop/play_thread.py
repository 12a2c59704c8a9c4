"""Plays tables in a thread: while it runs, it and not the loop has the device.

Loading a table over a slow bus takes seconds, and a record takes as long to be read. The loop only
asks whether the play has ended. The record goes to a file that the supervisor serves.
"""

import json
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from math import isfinite, nan
from pathlib import Path
from typing import Final, NamedTuple

from piezod.config.daemon import DaemonConfig
from piezod.control.guard import Limits
from piezod.control.law.compensated import limits_of
from piezod.control.stage.playing import PlayOutcome
from piezod.daemon.clock import Clock
from piezod.daemon.loop.placement import Placement
from piezod.daemon.loop.worker import DeviceWorker
from piezod.devices.channels import Channels
from piezod.devices.interface import Identity
from piezod.devices.played_axis import AxisPlayRecord, AxisTable, PlayedAxis
from piezod.devices.player import AtEnd, PlayerCapabilities, PlayState
from piezod.devices.wiring import pairs_of
from piezod.errors import DeviceError, PiezodError, PlayCancelledError
from piezod.records.atomic import replacing
from piezod.units import NS_PER_S

POLL_S: Final = 0.01
"""Period with which the progress is looked at, and so the longest delay of an abort, in s."""
GRACE_NS: Final = 2 * NS_PER_S
"""A play has failed if it takes this much longer than its table, in ns."""
IDLE_WITHIN_S: Final = 2.0
"""A play fails if another thread uses its device for this long, in s: the device is lost then, or
does not answer."""


class AxisPlayer(NamedTuple):
    """The player of an axis."""

    axis: PlayedAxis  #: The axis of the device that plays.
    identity: Identity  #: Identity of that device.
    limits: Limits  #: Limits of the drive.
    period_ns: int  #: Period of the loop, in ns.

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
    """

    def __init__(
        self,
        players: Mapping[int, AxisPlayer],
        refusals: Mapping[int, str],
        idle: Callable[[], bool],
        zero_um: Callable[[int], float],
        clock: Clock,
        file: Path,
    ) -> None:
        self._players, self._refusals = players, refusals
        self._idle, self._zero_um = idle, zero_um
        self._clock, self._file = clock, file
        self._number = 0
        self._thread: _PlayThread | None = None

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


class _PlayThread(threading.Thread):
    """Plays one table; `outcome` is valid when it has ended."""

    def __init__(self, job: _PlayJob, idle: Callable[[], bool], clock: Clock, file: Path) -> None:
        super().__init__(name="play", daemon=True)
        self._job, self._axis = job, job.player.axis
        self._idle, self._now_ns, self._file = idle, clock.now_ns, file
        self.aborted, self._may_play = threading.Event(), False
        self._ended_v = nan
        self.outcome = PlayOutcome(nan, "the play did not end in order")

    def run(self) -> None:
        if not self._becomes_idle():  # the device is not ours: nothing may be sent
            why = f"for {IDLE_WITHIN_S:g} s the device was lost, or did not answer"
            self.outcome = PlayOutcome(nan, why)
            self._store(self._job.table, None, why)
            return
        try:
            self.outcome = self._play()
        except PlayCancelledError as cancelled:
            self.outcome = self._stopped()
            self._store(self._job.table, None, str(cancelled))
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            why = str(error) if isinstance(error, PiezodError) else repr(error)
            self.outcome = self._stopped()._replace(failed=why)
            self._store(self._job.table, None, why)

    def _stopped(self) -> PlayOutcome:
        """Stop the device; return the voltage in force: before the start, that of the loop.

        A play that has ended keeps its last voltage, even if its record cannot be read.
        """
        drive_v = self._axis.abort(self._now_ns())
        if not isfinite(drive_v):  # nor is it known if the device does not answer
            return PlayOutcome(drive_v)
        commanded_v = self._ended_v if self._may_play else self._job.table.first_v
        known = isfinite(commanded_v)
        return PlayOutcome(commanded_v if known else drive_v, commanded=known)

    def _check(self) -> None:
        """End the play here if it is to be aborted.

        Raises:
            PlayCancelledError: If it is.
        """
        if self.aborted.is_set():
            raise PlayCancelledError("it was aborted")

    def _becomes_idle(self) -> bool:
        """Wait for the last round of a worker; return whether it ends, and leaves the device."""
        seen = 0
        for _ in range(round(IDLE_WITHIN_S / POLL_S)):
            time.sleep(POLL_S)
            seen = seen + 1 if self._idle() else 0
            if seen == 2:  # twice in a row: a worker may just be taking its last job
                return True
        return False

    def _play(self) -> PlayOutcome:
        taken = self._axis.load(self._job.table, self._now_ns(), self._check)
        self._check()
        self._axis.player.arm()
        self._wait_for_start(taken)
        self._check()
        self._check_output(taken)
        self._may_play = True  # nobody knows whether a request that fails has started it
        self._axis.player.start(self._now_ns())
        if self._wait(taken):
            self._ended_v = self._end_v(taken)
        self._check()
        self._store(taken, self._axis.recording(self._check), "")
        return PlayOutcome(self._ended_v, commanded=True)

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

    def _check_output(self, taken: AxisTable) -> None:
        """Refuse to start where the output is not: it may have moved while the table was loaded.

        Raises:
            PlayError: If the output is not at the first point, or is not read back.
        """
        output_v, near_v = self._axis.read_back_v(self._now_ns()), self._job.player.near_v
        if not abs(output_v - taken.first_v) <= near_v:
            raise PlayError(
                f"the output is at {output_v:.4g} V before the start, allowed: within {near_v:.3g} "
                f"V of the first point, {taken.first_v:.4g} V: check the amplifier"
            )

    def _wait(self, taken: AxisTable) -> bool:
        """Wait until the play has ended, or is to be aborted; return whether it has ended.

        Raises:
            PlayError: If it fails or does not end.
        """
        end_ns = self._now_ns() + taken.duration_ns + GRACE_NS
        while not self.aborted.wait(POLL_S):
            asked_ns = self._now_ns()
            progress = self._axis.player.progress(asked_ns)
            if progress.state is PlayState.ENDED:
                return True
            if progress.state is not PlayState.PLAYING:
                raise PlayError(progress.reason or f"the device is {progress.state.value}")
            if asked_ns > end_ns:  # not the present time: this thread may have been delayed
                raise PlayError("the device plays on after the end of the table")
        return False

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
            players[i] = AxisPlayer(played, identity, limits_of(config.axes[axis]), period_ns)
        except DeviceError as error:
            refusals[i] = str(error)
            continue
        if len(channels.devices) > 1:
            refusals[i] = _too_many(axis, pairs[axis].amplifier, channels.devices)
    return PlayThreads(
        players, refusals, partial(all_free, placements), channels.zero_um, clock, file
    )


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


class PlayError(PiezodError):
    """Raised when a device does not play as it was told."""
