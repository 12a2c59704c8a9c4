"""A device that is too slow for the cycle, used by a thread of its own; nobody waits for it.

Between the loop and the thread there is one slot each way: the newest setpoint, which replaces one
that was not sent yet, and what came of the last round, samples with the instants at which they were
taken. Each cycle asks for a round when it begins and when it writes, so that a device that takes
nearly a period has no pause.
"""

import threading
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
"""After a round in which its driver failed, a thread leaves the device alone for so long."""
DEADLINE: Final = 2
"""A round that takes so many periods, or so many times as long as it should, is late: nothing is
known meanwhile. A setpoint of that age is not sent any more."""
STUCK_NS: Final = NS_PER_S // 4
"""One that takes so long is stuck: the longest that a driver waits for a reply in the loop is less.
"""
ROUNDS_TO_TELL: Final = 3
_STUCK: Final = frozenset({DeviceFlag.STUCK})
_LATE: Final = frozenset({DeviceFlag.SLOW_REPLY})


class _Call(Enum):
    """What a thread is asked for."""

    ROUND = auto()
    ACTIVATE = auto()
    DEACTIVATE = auto()
    END = auto()


class _Wish(NamedTuple):
    """What is to be set.

    Attributes:
        number: One more with each.
        values: The value of each output.
        t_ns: Instant of the cycle that wished it.
    """

    number: int
    values: Sequence[float]
    t_ns: int


class _Told(NamedTuple):
    """What came of a round.

    Attributes:
        number: Of the round, one more with each.
        samples: One of each input.
        read_back: What is in force on each output.
        flags: What is the matter with each channel.
        taken: Whether the device took what it was given last.
    """

    number: int
    samples: Sequence[Sample]
    read_back: Sequence[float]
    flags: Sequence[Flags]
    taken: bool


class DeviceWorker(DeviceWrapper):
    """Implements the roles of a device by a thread that has it for itself.

    A sample is given once; a cycle into which no new one falls gets one that is not valid. A write
    counts as taken as long as the device took the last one that reached it, and its rounds are not
    late.

    Args:
        device: The device, open and active; `tended` where it can be lost.
        clock: The clock of the loop.
        period_ns: Period of the loop.
        round_ns: How long a round with the device takes, as measured.
        exchanges: Whether it reads and writes in one exchange.
        pace_ns: How much time there is to be between the beginnings of two rounds, at least.
        pause_s: How long to leave it alone after its driver failed.
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
        # A setpoint waits for the round under way, and is read back in the one after its own.
        self._able = self._able._replace(lag_ns=ROUNDS_TO_TELL * max(round_ns, pace_ns))
        if not self._able.inputs:  # the newest setpoint goes out as soon as one can: at any rate
            self._able = self._able._replace(max_rate_hz=inf)
        self._clock_ns, self._pause_s = clock.now_ns, pause_s
        self._exchanges, self._pace_ns = exchanges, pace_ns
        self._deadline_ns = DEADLINE * max(period_ns, round_ns, pace_ns)
        self._stuck_ns = max(STUCK_NS, self._deadline_ns)
        self._wish = _Wish(0, (), 0)
        self._told = _Told(0, (), self._first_read_back(), self._no_flags, True)
        self._calls: SimpleQueue[_Call] = SimpleQueue()
        self._ended = threading.Event()
        self._began_ns = 0
        self.crash: Exception | None = None
        """What the driver raised, if it did, until a round goes well."""
        # The loop's alone.
        self._seen, self._given = self._told, 0
        self._cycle_ns, self._late, self._stuck = -1, False, False
        # The thread's alone.
        self._active, self._sent, self._taken = True, 0, True
        self.thread = threading.Thread(target=self._work, name="device", daemon=True)
        """What has the device; to be started by whoever made this."""

    # ------------------------------------------------------------------ the loop

    def read(self, now_ns: int) -> Sequence[Sample]:
        """Give the samples that came since the last cycle; may be called in the loop."""
        self._begin(now_ns)
        if self._seen.number == self._given or self._late or not self._seen.samples:
            return self._no_samples(now_ns)
        self._given = self._seen.number
        return self._seen.samples

    def write(self, drive_v: Sequence[float], now_ns: int) -> bool:
        """Hand values over, in place of what was not sent yet; may be called in the loop."""
        self._begin(now_ns)
        self._wish = _Wish(self._wish.number + 1, tuple(drive_v), now_ns)
        self._ask()
        return self._seen.taken and not self._late

    def read_back(self, now_ns: int) -> Sequence[float]:
        """Tell what was in force in the last round; may be called in the loop."""
        self._begin(now_ns)
        return self._unknown if self._late else self._seen.read_back

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what was the matter in the last round, and of the thread; call it in the loop."""
        self._begin(now_ns)
        if self._late:
            told = _STUCK if self._stuck else _LATE
            return [(flags - PASSING) | told for flags in self._seen.flags]
        return self._seen.flags

    def activate(self, now_ns: int) -> None:  # noqa: ARG002 - the thread's own
        """Have the thread activate the device; may be called in the loop."""
        self._calls.put(_Call.ACTIVATE)

    def deactivate(self, now_ns: int) -> None:  # noqa: ARG002 - the thread's own
        """Have the thread deactivate the device; may be called in the loop. Never raises."""
        self._calls.put(_Call.DEACTIVATE)

    def close(self) -> None:
        """End the thread after the round under way, and close the device. Never raises."""
        self._ended.set()
        self._calls.put(_Call.END)
        if self.thread.is_alive():
            self.thread.join()
        super().close()

    def _begin(self, now_ns: int) -> None:
        """At the first call of a cycle, look at what has come, and whether the thread is well."""
        if now_ns == self._cycle_ns:
            return
        self._cycle_ns = now_ns
        came, began_ns = self._told, self._began_ns
        took_ns = now_ns - began_ns if began_ns else 0
        self._stuck = self.crash is not None or took_ns > self._stuck_ns
        self._late = self._stuck or took_ns > self._deadline_ns
        if came.number != self._seen.number:
            self._seen = came
        elif any(self._seen.flags):  # what passes was told
            self._seen = came._replace(flags=[flags - PASSING for flags in came.flags])
        self._ask()

    def _ask(self) -> None:
        """Have a round made, unless one is waiting to be."""
        if self._calls.empty():
            self._calls.put(_Call.ROUND)

    # ------------------------------------------------------------------ the thread

    def _first_read_back(self) -> Sequence[float]:
        """Ask what is in force, before the thread begins: the first cycle wants to know."""
        with suppress(Exception):  # a driver may fail in any way; the first round tells it
            return self._device.read_back(self._clock_ns())
        return self._unknown

    def _work(self) -> None:
        while (call := self._calls.get()) is not _Call.END:
            self._began_ns = began_ns = self._clock_ns()
            try:
                self._carry_out(call)
            except Exception as error:  # noqa: BLE001 - a driver may fail in any way; B15 tells it
                self.crash = error
                self._ended.wait(self._pause_s)
            else:
                self.crash = None
            self._began_ns = 0
            left_ns = began_ns + self._pace_ns - self._clock_ns()
            if left_ns > 0:
                self._ended.wait(left_ns / NS_PER_S)

    def _carry_out(self, call: _Call) -> None:
        if call is _Call.ROUND:
            self._round()
        elif call is _Call.ACTIVATE:
            self._sent = self._wish.number  # what was wished before is over
            self._device.activate(self._clock_ns())
            self._active = self._taken = True
        else:
            self._active = False
            self._device.deactivate(self._clock_ns())

    def _round(self) -> None:
        samples: Sequence[Sample] = ()
        wish = self._wish
        if wish.number != self._sent:
            samples = self._send(wish)
        now_ns = self._clock_ns()
        if self._active and not samples and self._able.inputs:
            samples = self._device.read(now_ns)
        read_back = self._device.read_back(now_ns) if self._able.outputs else ()
        flags = super().status(now_ns)
        if (
            self._seen.number < self._told.number
        ):  # nobody has looked since: what passes is still to be told
            missed = [flags & PASSING for flags in self._told.flags]
            flags = [new | old for new, old in zip(flags, missed, strict=True)]
        self._told = _Told(self._told.number + 1, samples, read_back, flags, self._taken)

    def _send(self, wish: _Wish) -> Sequence[Sample]:
        """Set the outputs, unless it is too late or the device inactive; return samples with it."""
        self._sent = wish.number
        samples: Sequence[Sample] = ()
        now_ns = self._clock_ns()
        if not self._active or now_ns - wish.t_ns > self._deadline_ns:
            self._taken = False
        elif self._exchanges:
            self._taken, samples = self._device.exchange(wish.values, now_ns)
        else:
            self._taken = self._device.write(wish.values, now_ns)
        return samples
