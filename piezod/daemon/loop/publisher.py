"""Turns what a cycle leaves into what goes through the shared memory."""

from collections.abc import Iterable
from typing import Any, Final, Protocol

from piezod.config.states import State
from piezod.daemon.loop.pacer import Tick
from piezod.daemon.loop.timed_channels import NOT_WRITTEN, TimedChannels
from piezod.telemetry.encoder import encode_axis, encode_cycle
from piezod.telemetry.events import EventWriter
from piezod.telemetry.learned import LearnedWriter
from piezod.telemetry.record import CycleHeader, CycleRecord, StageEvent
from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_STATES: Final = {id(state): place for place, state in enumerate(State)}
_LOW: Final = (1 << 64) - 1
_LEARNED_HZ: Final = 20
# As plain numbers: a member of an enumeration costs several times as much to index with.
_BEAT, _HEALTHY = int(Word.LOOP_BEAT_NS), int(Word.HEALTHY_CYCLES)
_STATE, _SKIPPED = int(Word.LOOP_STATE), int(Word.SKIPPED_CYCLES)


class KnowsLearned(Protocol):
    """What can tell what its axes have learned."""

    def learned(self, axis: int) -> tuple[Any, float, float, float]:
        """Return weights, offset, scale and sensor zero of an axis."""
        ...


class Publisher:
    """Writes records, events and learned parameters; all of it may be called in the loop.

    Args:
        shared: The memory, writable; this is its only writer on the loop's side.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._words = shared.words
        self._ring, self._events = RingWriter(shared), EventWriter(shared)
        self._learned = LearnedWriter(shared)
        self._axes = len(shared.layout.axes)
        self._learned_cycles = max(1, round(shared.layout.rate_hz / _LEARNED_HZ / self._axes))
        self._countdown, self._turn = 1, 0
        self._skipped = 0
        self._healthy = self._words[Word.HEALTHY_CYCLES]

    def record(self, record: CycleRecord, tick: Tick, timed: TimedChannels, end_ns: int) -> None:
        """Publish a cycle.

        Args:
            record: What it left.
            tick: Its beginning.
            timed: How long its phases took.
            end_ns: When it ended.
        """
        deadline_ns, late_ns, skipped = tick
        self._skipped += skipped
        write_late_ns = timed.write_begin_ns
        if write_late_ns != NOT_WRITTEN:
            write_late_ns -= deadline_ns
        busy_ns = end_ns - deadline_ns - late_ns
        values = encode_cycle(
            CycleHeader(
                t_ns=record.t_ns,
                late_ns=late_ns,
                read_ns=timed.read_ns,
                compute_ns=busy_ns - timed.read_ns - timed.write_ns,
                write_late_ns=write_late_ns,
                write_ns=timed.write_ns,
                skipped=self._skipped,
                present_lo=record.present & _LOW,
                present_hi=record.present >> 64,
                latched_lo=record.latched & _LOW,
                latched_hi=record.latched >> 64,
                state=record.state,
                shadow=record.shadow,
                written=record.written,
            )
        )
        for axis in record.axes:
            values += encode_axis(axis)
        self._ring.append(values)
        words = self._words
        words[_STATE] = _STATES[id(record.state)]
        words[_SKIPPED], words[_BEAT] = self._skipped, record.t_ns
        if not skipped:
            self._healthy += 1
            words[_HEALTHY] = self._healthy

    def events(self, events: Iterable[StageEvent]) -> None:
        """Hand events over."""
        for event in events:
            self._events.append(event)

    def learned(self, controller: KnowsLearned) -> None:
        """Publish what the next axis has learned when it is its turn, each 20 times a second."""
        self._countdown -= 1
        if not self._countdown:
            self._countdown = self._learned_cycles
            self._turn = (self._turn + 1) % self._axes
            self._learned.publish(self._turn, *controller.learned(self._turn))

    def learned_now(self, controller: KnowsLearned) -> None:
        """Publish what every axis has learned, whose turn it is or not."""
        for axis in range(self._axes):
            self._learned.publish(axis, *controller.learned(axis))

    def waiting(self, t_ns: int) -> None:
        """Tell that the loop is alive and its devices are absent."""
        words = self._words
        words[_STATE], words[_BEAT] = _STATES[id(State.BLIND)], t_ns
        self._healthy += 1
        words[_HEALTHY] = self._healthy
