"""A device that is too slow for the cycle: a thread of its own uses it, and the loop never waits.

Between the loop and the thread there is one slot in each direction: the newest setpoint, which
replaces one that was not sent yet, and the result of the last round, with samples and the instants
at which they were taken. Each cycle requests a round when it begins and when it writes, so that a
device that needs nearly a period is never idle.
"""

import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from enum import Enum, auto
from math import inf
from queue import SimpleQueue
from typing import Final, NamedTuple

from piezod.daemon.clock import Clock
from piezod.devices.interface import Device, Sample
from piezod.devices.status import PASSING, DeviceFlag, Flags
from piezod.devices.wrapper import DeviceWrapper
from piezod.units import NS_PER_S

PAUSE_S: Final = 1.0
"""Pause of the thread after a round in which the driver failed, in s."""
LATE_FACTOR: Final = 2
"""A round is late after this many periods or usual durations, whichever is longer: samples and
read-back are then unknown. A setpoint of this age is not sent any more."""
STUCK_NS: Final = NS_PER_S // 4
"""A round that takes longer is stuck: no driver waits longer for a reply in the loop."""
AGES: Final = 9
"""The usual age of a read-back is the median of those of so many rounds."""
ROUNDS_TO_READ_BACK: Final = 3
"""A setpoint waits for the present round, is sent in the next one, and read back in a third."""
_STUCK: Final = frozenset({DeviceFlag.STUCK})
_LATE: Final = frozenset({DeviceFlag.SLOW_REPLY})


class _Job(Enum):
    """What the thread is asked for."""

    ROUND = auto()
    ACTIVATE = auto()
    DEACTIVATE = auto()
    END = auto()


class _Setpoint(NamedTuple):
    """The values to write."""

    number: int  #: Counts setpoints.
    values: Sequence[float]  #: Value of each output.
    t_ns: int  #: Instant of the cycle that made it.


class _RoundResult(NamedTuple):
    """The result of a round."""

    number: int  #: Counts rounds.
    era: int  #: The era in which it began.
    samples: Sequence[Sample]  #: Sample of each input; none if the device was not read.
    read_back: Sequence[float]  #: Read-back value of each output.
    flags: Sequence[Flags]  #: Flags of each channel.
    taken: bool  #: Whether the device accepted the last setpoint.
    setpoint: _Setpoint  #: The newest setpoint when it began, which the read-back can show.
    began_ns: int  #: Instant at which it began.


class DeviceWorker(DeviceWrapper):
    """Implements the roles of a device by a thread that is the only user of the device.

    Each sample is delivered once; a cycle without a new one gets an invalid sample. `write` returns
    True as long as the device accepted the last setpoint that reached it and no round is late.

    Args:
        device: The device, open and active; a `ReconnectingDevice` if it can be lost.
        clock: The clock of the loop.
        period_ns: Period of the loop.
        round_ns: Measured duration of a round.
        exchanges: Whether the device reads and writes in one exchange.
        pace_ns: Shortest time between the beginnings of two rounds.
        pause_s: Pause after its driver failed, in s.
    """

    def __init__(
        self,
        device: Device,
        clock: Clock,
        period_ns: int,
        round_ns: int,
        *,
        exchanges: bool = False,
        pace_ns: int = 0,
        pause_s: float = PAUSE_S,
    ) -> None:
        super().__init__(device)
        lag_ns = self._told_lag_ns + ROUNDS_TO_READ_BACK * max(round_ns, pace_ns)
        self._able = self._able._replace(lag_ns=lag_ns)
        # An amplifier gets the newest setpoint as soon as it can take one: any loop may be faster.
        if not self._able.inputs:
            self._able = self._able._replace(max_rate_hz=inf)
        self._clock_ns, self._pause_s = clock.now_ns, pause_s
        self._exchanges, self._period_ns, self._pace_ns = exchanges, period_ns, pace_ns
        self._deadline_ns = LATE_FACTOR * max(period_ns, round_ns, pace_ns)
        self._stuck_ns = max(STUCK_NS, self._deadline_ns)
        self._setpoint = _Setpoint(0, (), 0)
        self._newest = _RoundResult(
            0, 0, (), self._first_read_back(), self._no_flags, True, self._setpoint, clock.now_ns()
        )
        self._jobs: SimpleQueue[_Job] = SimpleQueue()
        self._closing = threading.Event()
        self._began_ns = 0
        self.crash: Exception | None = None
        """Exception of the driver in the last round; None if that round succeeded."""
        self.rounds = self.rounds_ns = 0
        """Number of rounds, and the time that they took, in ns."""
        # No locks: each attribute has one writer, and the tuples that pass between are immutable.
        self._era = 0  # written by the loop: the rounds of an earlier era count no more
        # Used by the loop only.
        self._seen, self._delivered = self._newest, 0
        self._cycle_ns, self._late, self._stuck = -1, False, False
        self._age_ns = self._longest_ns = 0
        self._ages_ns = deque[int](maxlen=AGES)
        # Used by the thread only.
        self._active, self._sent, self._taken = True, 0, True
        self.thread = threading.Thread(target=self._work, name="device", daemon=True)
        """Thread that uses the device; the creator of this object starts it."""

    @property
    def idle(self) -> bool:
        """Whether the thread has nothing to do; only while the loop requests nothing."""
        return self._jobs.empty() and not self._began_ns

    # ------------------------------------------------------------------ the loop

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Return the samples that came since the last cycle. Real-time safe."""
        self._begin(now_ns)
        if self._seen.number == self._delivered or self._late or not self._seen.samples:
            return self._no_samples(now_ns)
        self._delivered = self._seen.number
        return self._seen.samples

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Replace the setpoint that waits to be sent. Real-time safe."""
        self._begin(now_ns)
        self._setpoint = _Setpoint(self._setpoint.number + 1, tuple(drive_v), now_ns)
        self._request_round()
        return self._seen.taken and not self._late

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Return the read-back values of the last round, NaN if it is late. Real-time safe."""
        self._begin(now_ns)
        return self._unknown if self._late else self._seen.read_back

    def read_back_age_ns(self, now_ns: int) -> int:
        """Return the age of the read-back of the last round, in ns. Real-time safe.

        It counts from the cycle that made the first setpoint which that round did not send; it is 0
        if there is none. A round that takes much longer than usual adds nothing: whoever reckons
        with the age then waits for it.
        """
        self._begin(now_ns)
        shown = self._seen.setpoint.number == self._setpoint.number
        own_ns = 0 if shown else min(self._age_ns, self._longest_ns)
        return own_ns + super().read_back_age_ns(now_ns)

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of the last round, and of a thread that is late. Real-time safe."""
        self._begin(now_ns)
        if self._late:
            of_thread = _STUCK if self._stuck else _LATE
            return [(flags - PASSING) | of_thread for flags in self._seen.flags]
        return self._seen.flags

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the thread reads the clock itself
        """Let the thread activate the device. Real-time safe."""
        self._jobs.put(_Job.ACTIVATE)

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the thread reads the clock itself
        """Let the thread deactivate the device. Never raises. Real-time safe."""
        self._jobs.put(_Job.DEACTIVATE)

    def forget(self) -> None:
        """Drop the last round, and the one under way: only rounds that begin from now on count.

        Until the first of them has ended, there are no samples, and the read-back is unknown.
        Real-time safe.
        """
        self._era += 1
        self._seen = self._seen._replace(samples=(), read_back=self._unknown)

    def close(self) -> None:
        """End the thread after its present round, and close the device. Never raises."""
        self._closing.set()
        self._jobs.put(_Job.END)
        if self.thread.is_alive():
            self.thread.join()
        super().close()

    def _begin(self, now_ns: int) -> None:
        """At the first call of a cycle, take the newest round and look for a late thread."""
        if now_ns == self._cycle_ns:
            return
        self._cycle_ns = now_ns
        # All calls of a cycle see the same round.
        newest, began_ns = self._newest, self._began_ns
        running_ns = now_ns - began_ns if began_ns else 0
        self._stuck = self.crash is not None or running_ns > self._stuck_ns
        self._late = self._stuck or running_ns > self._deadline_ns
        if newest.number != self._seen.number and newest.era == self._era:
            self._seen = newest
            self._ages_ns.append(self._age_ns)  # the largest of the round before
            usual_ns = sorted(self._ages_ns)[len(self._ages_ns) // 2]
            self._longest_ns = LATE_FACTOR * usual_ns + self._period_ns
        elif any(self._seen.flags):  # the passing flags of this round were reported already
            seen = self._seen
            self._seen = seen._replace(flags=[flags - PASSING for flags in seen.flags])
        # The next setpoint came a period later; or, if nothing was written for a while, in the
        # cycle in which the round began, or later.
        seen, period_ns = self._seen, self._period_ns
        since_ns = max(seen.setpoint.t_ns + period_ns, seen.began_ns - period_ns)
        self._age_ns = max(now_ns - since_ns, 0)
        self._request_round()

    def _request_round(self) -> None:
        """Request a round, unless a job is waiting already."""
        if self._jobs.empty():
            self._jobs.put(_Job.ROUND)

    # ------------------------------------------------------------------ the thread

    def _first_read_back(self) -> Sequence[float]:
        """Read back before the thread begins, because the first cycle needs the voltages."""
        with suppress(Exception):  # a driver may fail in any way; the first round reports it
            return self._device.read_back(self._clock_ns())
        return self._unknown

    def _work(self) -> None:
        while (job := self._jobs.get()) is not _Job.END:
            self._began_ns = began_ns = self._clock_ns()
            try:
                self._do(job)
            except Exception as error:  # noqa: BLE001 - a driver may fail in any way: fault B15
                self.crash = error
                self._closing.wait(self._pause_s)
            else:
                self.crash = None
            self._began_ns = 0
            ended_ns = self._clock_ns()
            self.rounds += 1
            self.rounds_ns += ended_ns - began_ns
            left_ns = began_ns + self._pace_ns - ended_ns
            if left_ns > 0:
                self._closing.wait(left_ns / NS_PER_S)

    def _do(self, job: _Job) -> None:
        if job is _Job.ROUND:
            self._round()
        elif job is _Job.ACTIVATE:
            self._sent = self._setpoint.number  # an older setpoint must not be sent
            self._device.activate(self._clock_ns())
            self._active = self._taken = True
        else:
            self._active = False  # before the call: even if it fails, nothing is written any more
            self._device.deactivate(self._clock_ns())

    def _round(self) -> None:
        samples: Sequence[Sample] = ()
        era, began_ns = self._era, self._began_ns  # before the first exchange
        setpoint = self._setpoint  # once: the loop may replace it meanwhile
        if setpoint.number != self._sent:
            samples = self._send(setpoint)
        now_ns = self._clock_ns()
        # An exchange has given the samples already.
        if self._active and not samples and self._able.inputs:
            samples = self._device.read(now_ns)
        read_back = self._device.read_back(now_ns) if self._able.outputs else ()
        flags = super().status(now_ns)
        # No cycle has seen the round before: keep its passing flags for the next one.
        if self._seen.number < self._newest.number:
            missed = [flags & PASSING for flags in self._newest.flags]
            flags = [new | old for new, old in zip(flags, missed, strict=True)]
        number = self._newest.number + 1
        self._newest = _RoundResult(
            number, era, samples, read_back, flags, self._taken, setpoint, began_ns
        )

    def _send(self, setpoint: _Setpoint) -> Sequence[Sample]:
        """Set the outputs if the setpoint is not too old and the device is active.

        Returns:
            The samples of the same exchange, if there was one.
        """
        self._sent = setpoint.number
        samples: Sequence[Sample] = ()
        now_ns = self._clock_ns()
        if not self._active or now_ns - setpoint.t_ns > self._deadline_ns:
            self._taken = False
        elif self._exchanges:
            self._taken, samples = self._device.exchange(setpoint.values, now_ns)
        else:
            self._taken = self._device.write(setpoint.values, now_ns)
        return samples
