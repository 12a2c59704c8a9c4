"""The loop on one screen: wait, run a cycle, publish its record, take a request."""

from collections.abc import Callable, Sequence
from os import getppid
from typing import Final, Protocol

from piezod.config.faults import Fault
from piezod.control.faults.detection import Detection
from piezod.control.stage.answer import Answer
from piezod.control.watch.loop import CycleTiming
from piezod.daemon.clock import Clock, clock_offsets_ns
from piezod.daemon.loop.absences import Absences
from piezod.daemon.loop.counters import ProcessCounters
from piezod.daemon.loop.device_counters import DeviceCounters
from piezod.daemon.loop.pacer import Pacer
from piezod.daemon.loop.publisher import LearnedSource, Publisher
from piezod.daemon.loop.timed_channels import TimedChannels
from piezod.messages.requests import Estop, Request, Shutdown
from piezod.telemetry.mailbox import MailboxReader
from piezod.telemetry.record import CycleRecord, StageEvent
from piezod.telemetry.requests_codec import decode
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.stream import StreamReader
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from piezod.units import NS_PER_S

SUPERVISOR_LOST_NS: Final = NS_PER_S
"""If the beat of a supervisor whose process has ended stays unchanged for longer, it is lost."""
SUPERVISOR_LATE_NS: Final = 3 * NS_PER_S
"""The same while its process lives: on a busy machine it beats late, though nothing is wrong."""
_COUNTERS_PERIOD_NS: Final = NS_PER_S
_OF_SUPERVISOR: Final = tuple(enumerate(map(Detection, SUPERVISOR_FAULTS)))
_ESTOP: Final = Estop()  # made once, because validation costs time in the cycle


class Controller(LearnedSource, Protocol):
    """Decides in each cycle; `control.controller.StageController` implements it. Real-time safe."""

    @property
    def finished(self) -> bool:
        """Whether the process may end."""
        ...

    def execute(self, request: Request, t_ns: int) -> Answer:
        """Execute a request; return whether it was accepted, with the reason if not."""
        ...

    def stream_um(self, axis: int, position_um: float, t_ns: int) -> None:
        """Take the newest setpoint of a stream."""
        ...

    def cycle(self, t_ns: int, timing: CycleTiming) -> CycleRecord:
        """Run one cycle."""
        ...

    def report(self, detection: Detection) -> None:
        """Take a fault that was detected outside, for the next cycle."""
        ...

    def take_events(self) -> Sequence[StageEvent]:
        """Return the events since the last call, oldest first."""
        ...


class Loop:
    """Runs a stage, cycle by cycle.

    Args:
        controller: Decides in each cycle.
        timed: The devices that it uses; measures how long each phase takes.
        shared: The memory shared with the supervisor, writable.
        clock: The clock.
        pacer: Keeps the period of this clock.
        device_counters: Publishes the counts of the devices; None for devices without counts.
        absences: Tells why lost devices cannot be opened again; None if none can be lost.
    """

    def __init__(
        self,
        controller: Controller,
        timed: TimedChannels,
        shared: SharedMap,
        clock: Clock,
        pacer: Pacer,
        device_counters: DeviceCounters | None = None,
        absences: Absences | None = None,
    ) -> None:
        self._controller, self._timed = controller, timed
        self._now_ns, self._wait = clock.now_ns, pacer.wait
        self.publisher = Publisher(shared)
        self._mailbox, self._stream = MailboxReader(shared), StreamReader(shared)
        self._supervisor, self._words = SupervisorWatch(shared), shared.words
        self.counters = ProcessCounters(shared.words)
        self._device_counters, self._absences = device_counters, absences
        self._counted_ns = self._busy_ns = 0
        # Answers to requests whose consequences the next record will show.
        self._to_answer: list[tuple[Callable[..., None], int, Answer]] = []

    def run(self) -> None:
        """Run until a shutdown was requested and the stage is at its safe voltage."""
        while not self._controller.finished:
            self.cycle()
        self._send_answers()

    def cycle(self) -> None:
        """Run one cycle. Real-time safe."""
        tick = self._wait()
        t_ns = tick.deadline_ns + tick.late_ns
        controller, publisher, timed = self._controller, self.publisher, self._timed
        timed.start()
        # Setpoints of a stream before the cycle, so that this cycle applies the newest.
        for axis, position_um, came_ns in self._stream.take():
            controller.stream_um(axis, position_um, came_ns)
        # The duration is that of the cycle before: this one has not ended.
        wall_ns, boot_ns = clock_offsets_ns()
        timing = CycleTiming(tick.late_ns, tick.skipped, self._busy_ns, wall_ns, boot_ns)
        record = controller.cycle(t_ns, timing)
        # From here on nothing delays the write of this cycle.
        publisher.record(record, tick, timed, self._now_ns())
        publisher.events(controller.take_events())
        publisher.learned(controller)
        self._send_answers()
        self._serve_after_write(t_ns, tick.skipped)
        self._busy_ns = self._now_ns() - t_ns

    def _serve_after_write(self, t_ns: int, skipped: int) -> None:
        """Do the work that can wait for the write: requests, supervisor, counters."""
        # The emergency stop has a slot of its own, so that no other request delays it.
        if number := self._mailbox.take_estop():
            answer = self._controller.execute(_ESTOP, t_ns)
            self._to_answer.append((self._mailbox.answer_estop, number, answer))
        taken = self._mailbox.take(t_ns)  # at most one a cycle: its duration stays bounded
        if taken is not None:
            number, payload = taken
            answer = self._execute(payload, t_ns)
            if answer.accepted:
                # Before the answer: the client may ask next for parameters that this one changed.
                self.publisher.learned_all(self._controller)
            self._to_answer.append((self._mailbox.answer, number, answer))
        # Without a supervisor, do what it would request: ramp down and end.
        if limit_ns := self._supervisor.lost(t_ns, skipped):
            limit_s = limit_ns / NS_PER_S
            self._controller.report(Detection(Fault.H1, measured=limit_s, limit=limit_s))
            self._controller.execute(Shutdown(), t_ns)
        if found := self._words[_SUPERVISOR_FAULTS]:
            for place, detection in _OF_SUPERVISOR:
                if found >> place & 1:
                    self._controller.report(detection)
        if t_ns - self._counted_ns >= _COUNTERS_PERIOD_NS:
            self._counted_ns = t_ns
            for detection in self.counters.publish():
                self._controller.report(detection)
            if self._device_counters is not None:
                self._device_counters.publish()
            if self._absences is not None:
                self.publisher.events(self._absences.take_events(t_ns))

    def _send_answers(self) -> None:
        """Answer the requests of the cycle before: the record of this one shows what they did."""
        if self._to_answer:
            for send, number, (accepted, why, motion, duration_s) in self._to_answer:
                send(number, accepted=accepted, why=why, motion=motion, duration_s=duration_s)
            self._to_answer.clear()

    def _execute(self, payload: bytes, t_ns: int) -> Answer:
        try:
            request = decode(payload)
        except ValueError as error:
            return Answer(accepted=False, why=f"the request cannot be read: {error}")
        return self._controller.execute(request, t_ns)


class SupervisorWatch:
    """Detects, once, that the beat of the supervisor has stopped."""

    def __init__(self, shared: SharedMap) -> None:
        self._words, self._period_ns = shared.words, shared.layout.period_ns
        self._beat_ns = -1  # differs from every beat, so that the first call sees a change
        self._seen_ns: int | None = 0  # None after the loss, which is reported once

    def lost(self, t_ns: int, skipped: int) -> int:
        """Return the limit that a silence exceeds in this cycle, in ns; 0 in all other cycles.

        Call once per cycle. Skipped periods do not count: what stopped the loop stopped the
        supervisor too. Real-time safe.
        """
        beat_ns = self._words[_SUPERVISOR_BEAT]
        if beat_ns != self._beat_ns:
            self._beat_ns, self._seen_ns = beat_ns, t_ns
        elif self._seen_ns is not None:
            self._seen_ns += skipped * self._period_ns
            silent_ns = t_ns - self._seen_ns
            if silent_ns <= SUPERVISOR_LOST_NS:  # no system call in a usual cycle
                return 0
            # The supervisor has started this process; another parent means that it has ended.
            alive = getppid() == self._words[_SUPERVISOR_PID]
            limit_ns = SUPERVISOR_LATE_NS if alive else SUPERVISOR_LOST_NS
            if silent_ns > limit_ns:
                self._seen_ns = None
                return limit_ns
        return 0


_SUPERVISOR_PID: Final = int(Word.SUPERVISOR_PID)
_SUPERVISOR_BEAT: Final = int(Word.SUPERVISOR_BEAT_NS)
_SUPERVISOR_FAULTS: Final = int(Word.SUPERVISOR_FAULTS)
