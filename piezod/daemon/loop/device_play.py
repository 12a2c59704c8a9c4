"""A thread that plays on a device: it has the device until the play has ended or was aborted."""

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import isfinite, nan
from typing import Final

from piezod.control.stage.playing import PlayOutcome
from piezod.daemon.clock import Clock
from piezod.devices.played_axis import PlayedAxis
from piezod.devices.player import PlayState
from piezod.errors import PiezodError, PlayCancelledError
from piezod.units import NS_PER_S

POLL_S: Final = 0.01
"""Period with which the progress is looked at, and so the longest delay of an abort, in s."""
GRACE_NS: Final = 2 * NS_PER_S
"""A play has failed if it takes this much longer than its table, in ns."""
IDLE_WITHIN_S: Final = 2.0
"""A play fails if another thread uses its device for this long, in s: the device is lost then, or
does not answer."""


class PlayError(PiezodError):
    """Raised when a device does not play as it was told."""


class DevicePlay(threading.Thread, ABC):
    """Plays on one device; `outcome` is valid when it has ended.

    Args:
        axes: The axes that are played, all of one device.
        first_v: Voltage of each at the start, in V: the loop has gone there.
        near_v: How far the output of each may be from that, in V.
        idle: Returns whether the devices are there, and no other thread uses them.
        clock: The clock of the loop.
    """

    def __init__(
        self,
        axes: Sequence[PlayedAxis],
        first_v: Sequence[float],
        near_v: Sequence[float],
        idle: Callable[[], bool],
        clock: Clock,
    ) -> None:
        super().__init__(name="play", daemon=True)
        self._axes, self._near_v = axes, near_v
        self._idle, self._now_ns = idle, clock.now_ns
        self.aborted = threading.Event()
        self._unknown = (nan,) * len(axes)
        # Voltages that were commanded and are in force; NaN while the device plays.
        self._resting_v = tuple(first_v)
        self.outcome = PlayOutcome(self._unknown, "the play did not end in order")

    @abstractmethod
    def _play(self) -> PlayOutcome:
        """Play; return the end."""

    @abstractmethod
    def _failed(self, why: str) -> None:
        """Store that the play was aborted, or has failed."""

    def run(self) -> None:
        """Play, and leave the outcome."""
        if not self._becomes_idle():  # the device is not ours: nothing may be sent
            why = f"for {IDLE_WITHIN_S:g} s the device was lost, or did not answer"
            self.outcome = PlayOutcome(self._unknown, why)
            self._failed(why)
            return
        try:
            self.outcome = self._play()
        except PlayCancelledError as cancelled:
            self.outcome = self._stopped()
            self._failed(str(cancelled))
        except Exception as error:  # noqa: BLE001 - a driver may fail in any way
            why = str(error) if isinstance(error, PiezodError) else repr(error)
            self.outcome = self._stopped()._replace(failed=why)
            self._failed(why)

    def _stopped(self) -> PlayOutcome:
        """Stop the device; return the voltages in force: before the start, those of the loop.

        A play that has ended keeps its last voltages, even if its record cannot be read.
        """
        drives_v = tuple(axis.abort(self._now_ns()) for axis in self._axes)
        if not all(map(isfinite, drives_v)):  # nor are they known if the device does not answer
            return PlayOutcome(drives_v)
        known = all(map(isfinite, self._resting_v))
        return PlayOutcome(self._resting_v if known else drives_v, commanded=known)

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

    def _start(self, first_v: Sequence[float]) -> None:
        """Start an armed device, whose table begins at these voltages in V."""
        self._check_output(first_v)
        self._resting_v = self._unknown  # nobody knows whether a request that fails has started it
        self._axes[0].player.start(self._now_ns())

    def _check_output(self, first_v: Sequence[float]) -> None:
        """Refuse to start where an output is not: it may have moved while the table was loaded.

        Raises:
            PlayError: If an output is not at the first point, or is not read back.
        """
        for axis, near_v, wanted_v in zip(self._axes, self._near_v, first_v, strict=True):
            output_v = axis.read_back_v(self._now_ns())
            if not abs(output_v - wanted_v) <= near_v:
                raise PlayError(
                    f"the output is at {output_v:.4g} V before the start, allowed: within "
                    f"{near_v:.3g} V of the first point, {wanted_v:.4g} V: check the amplifier"
                )

    def _wait(self, duration_ns: int) -> bool:
        """Wait until the play has ended, or is to be aborted; return whether it has ended.

        Raises:
            PlayError: If it fails or does not end.
        """
        end_ns = self._now_ns() + duration_ns + GRACE_NS
        while not self.aborted.wait(POLL_S):
            asked_ns = self._now_ns()
            progress = self._axes[0].player.progress(asked_ns)
            if progress.state is PlayState.ENDED:
                return True
            if progress.state is not PlayState.PLAYING:
                raise PlayError(progress.reason or f"the device is {progress.state.value}")
            if asked_ns > end_ns:  # not the present time: this thread may have been delayed
                raise PlayError("the device plays on after the end of the table")
        return False
