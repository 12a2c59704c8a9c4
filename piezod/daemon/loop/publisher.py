"""Publishes the results of each cycle in the shared memory: record, counts, events, parameters."""

from collections.abc import Iterable
from typing import Final, Protocol

from piezod.config.states import State
from piezod.control.watch.loop import LATE_PART
from piezod.daemon.loop.pacer import Tick
from piezod.daemon.loop.timed_channels import NOT_WRITTEN, TimedChannels
from piezod.telemetry.cycle_counts import CycleCounter
from piezod.telemetry.encoder import encode_axis
from piezod.telemetry.events import EventWriter
from piezod.telemetry.learned import LearnedValues
from piezod.telemetry.learned_writer import LearnedWriter
from piezod.telemetry.record import CycleRecord, StageEvent
from piezod.telemetry.ring import RingWriter
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_STATES: Final = {id(state): place for place, state in enumerate(State)}
_LOW: Final = (1 << 64) - 1
_LEARNED_HZ: Final = 20
# As plain integers: indexing with a member of an enumeration costs several times as much.
_BEAT: Final = int(Word.LOOP_BEAT_NS)
_HEALTHY: Final = int(Word.HEALTHY_CYCLES)
_STATE: Final = int(Word.LOOP_STATE)
_SKIPPED: Final = int(Word.SKIPPED_CYCLES)


class LearnedSource(Protocol):
    """Gives the parameters that its axes have learned."""

    def learned(self, axis: int) -> LearnedValues:
        """Return what `LearnedWriter.publish` takes, of an axis."""
        ...


class Publisher:
    """Writes records, events and learned parameters. All methods are real-time safe.

    Args:
        shared: The memory, writable; in the loop process this object is its only writer.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._words = shared.words
        self._ring, self._events = RingWriter(shared), EventWriter(shared)
        self._learned = LearnedWriter(shared)
        self._counter = CycleCounter(shared, round(LATE_PART * shared.layout.period_ns))
        self._axes = len(shared.layout.axes) - shared.layout.users
        # The axes take turns, so that no cycle publishes the weights of more than one.
        self._learned_cycles = max(1, round(shared.layout.rate_hz / _LEARNED_HZ / self._axes))
        self._countdown, self._turn = 1, 0
        self._skipped = 0
        # The count continues the one made while the process waited for its devices.
        self._healthy = self._words[Word.HEALTHY_CYCLES]

    def record(self, record: CycleRecord, tick: Tick, timed: TimedChannels, end_ns: int) -> None:
        """Publish a cycle.

        Args:
            record: The record of the cycle.
            tick: The beginning of the cycle.
            timed: How long its phases took.
            end_ns: Instant at which it ended.
        """
        deadline_ns, late_ns, skipped = tick.deadline_ns, tick.late_ns, tick.skipped
        self._skipped += skipped
        write_late_ns = timed.write_begin_ns
        if write_late_ns != NOT_WRITTEN:
            write_late_ns -= deadline_ns
        busy_ns = end_ns - deadline_ns - late_ns  # the cycle began at deadline + late
        t_ns, state, shadow, written, present, latched, axes, lines = record
        read_ns, write_ns, place = timed.read_ns, timed.write_ns, _STATES[id(state)]
        compute_ns = busy_ns - read_ns - write_ns
        # The fields of a `CycleHeader`, without the tuple.
        values: list[float] = [t_ns, late_ns, read_ns, compute_ns, write_late_ns, write_ns]
        values += self._skipped, present & _LOW, present >> 64, latched & _LOW, latched >> 64
        values += lines, place, shadow, written
        counter = self._counter
        for index, axis in enumerate(axes):
            values += encode_axis(axis)
            counter.error(index, axis.command_um - axis.position_um)
        self._ring.append(values)
        counter.cycle(late_ns, skipped, read_ns, write_ns, busy_ns)
        words = self._words
        words[_STATE], words[_SKIPPED], words[_BEAT] = place, self._skipped, t_ns
        if not skipped:  # a late cycle is a sign of life too, but not a healthy cycle
            self._healthy += 1
            words[_HEALTHY] = self._healthy

    def events(self, events: Iterable[StageEvent]) -> None:
        """Publish events."""
        for event in events:
            self._events.append(event)

    def learned(self, controller: LearnedSource) -> None:
        """Publish the learned parameters of one axis, in turn: 20 times a second for each axis."""
        self._countdown -= 1
        if not self._countdown:
            self._countdown = self._learned_cycles
            self._turn = (self._turn + 1) % self._axes
            self._learned.publish(self._turn, controller.learned(self._turn))

    def learned_all(self, controller: LearnedSource) -> None:
        """Publish the learned parameters of every axis."""
        for axis in range(self._axes):
            self._learned.publish(axis, controller.learned(axis))

    def waiting(self, t_ns: int) -> None:
        """Report that the process is alive and its devices are absent."""
        words = self._words
        words[_STATE], words[_BEAT] = _STATES[id(State.BLIND)], t_ns
        # An absent device is no reason to restart the process, so that it counts as healthy.
        self._healthy += 1
        words[_HEALTHY] = self._healthy
