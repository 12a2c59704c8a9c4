"""The supervisor's connection to one run of the loop process: health, requests, and readers."""

import asyncio
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from math import inf, isfinite, nan
from typing import Any, Final

from piezod.config.daemon import DaemonConfig, StageAxisConfig
from piezod.config.faults import Fault
from piezod.config.hung import hung_after_s
from piezod.config.model_file import ModelFile, load_model
from piezod.config.states import State
from piezod.config.waveforms.waveform import WaveformCostError
from piezod.control.faults.table import FAULTS, Reaction
from piezod.control.guard import read_back_tolerance_v
from piezod.control.stage.answer import Answer
from piezod.daemon.stage.errors import BadValueError, NoAnswerError, NotNowError, UnavailableError
from piezod.daemon.stage.status import STATES, masks
from piezod.messages.requests import Disarm, Estop, Hold, Request, Shutdown, Stop
from piezod.telemetry.arrays import Records, RingReader
from piezod.telemetry.events import EventReader
from piezod.telemetry.learned import LearnedReader
from piezod.telemetry.mailbox import EXPIRED, MailboxAnswer, MailboxFullError, MailboxWriter
from piezod.telemetry.requests_codec import encode
from piezod.telemetry.ring import Record, RecordReader
from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.stream import StreamWriter
from piezod.telemetry.succession import Succession, succession_of
from piezod.telemetry.words import SUPERVISOR_FAULTS, Word
from piezod.units import NS_PER_S, s_to_ns

LONG_GAP_NS: Final = NS_PER_S // 2
"""A longer gap between two updates does not count: what stopped the supervisor may have stopped the
loop too."""


class LoopHealth:
    """Judges by its beat whether the loop runs; call `update` often.

    A late cycle counts like any other one: a device that answers slowly does not stop the loop.

    Args:
        shared: The memory shared with the loop, made for this run.
        now_ns: The present instant.
    """

    def __init__(self, shared: SharedMap, now_ns: int) -> None:
        self._words, period_ns = shared.words, shared.layout.period_ns
        self._fresh_ns = 2 * period_ns
        self._hung_ns = s_to_ns(hung_after_s(period_ns / NS_PER_S))
        self._beat_ns = 0
        self._advanced_ns = self._updated_ns = now_ns

    def update(self, now_ns: int) -> bool:
        """Return whether there were cycles since the last update or in two periods.

        The periods are for slow loops, which do not run a cycle between any two updates.
        """
        gap_ns, self._updated_ns = now_ns - self._updated_ns, now_ns
        # Count as if there had been no gap.
        if gap_ns > LONG_GAP_NS:
            self._advanced_ns += gap_ns
        beat_ns = self._words[Word.LOOP_BEAT_NS]
        if beat_ns == self._beat_ns:
            return self.started and now_ns - self._advanced_ns <= self._fresh_ns
        self._beat_ns, self._advanced_ns = beat_ns, now_ns
        return True

    @property
    def started(self) -> bool:
        """Whether there was a cycle; the first one may take its time."""
        return self._beat_ns > 0

    def hung(self, now_ns: int) -> bool:
        """Return whether a loop that ran has had no cycle for too long."""
        return self.started and now_ns - self._advanced_ns > self._hung_ns

    def age_s(self, now_ns: int) -> float:
        """Return how long ago an update found new cycles, in s."""
        return (now_ns - self._advanced_ns) / NS_PER_S


URGENT: Final = (Stop, Hold, Disarm, Shutdown)
EXPIRES_S: Final = 0.5
EXPIRES_PERIODS: Final = 4
"""A request expires if the loop has not taken it after this time, in s, or this many periods,
whichever is longer."""
_POLL_S: Final = 0.001


class LoopRequests:
    """The supervisor's side of the mailbox.

    Args:
        shared: The memory shared with the loop; this object is the only writer of its mailbox.
    """

    def __init__(self, shared: SharedMap) -> None:
        self._mailbox, self._words = MailboxWriter(shared), shared.words
        periods_ns = EXPIRES_PERIODS * shared.layout.period_ns
        self._expires_ns = max(int(EXPIRES_S * NS_PER_S), periods_ns)

    async def ask(self, request: Request) -> Answer:
        """Execute a request in the loop; return the answer.

        Raises:
            BadValueError: If its waveforms are too large for the loop.
            UnavailableError: If too many requests wait already.
            NoAnswerError: If the loop does not take it in time. Then it is not executed, except an
                emergency stop, which the loop executes as soon as it can.
        """
        expires_ns = time.monotonic_ns() + self._expires_ns
        find: Callable[[int], MailboxAnswer | None]
        if isinstance(request, Estop):
            number, find = self._mailbox.post_estop(), self._mailbox.estop_answer
        else:
            number, find = self.post(request, expires_ns), self._mailbox.answer
        # Twice as long: the loop may take it at the last moment, and answers in the next cycles.
        while time.monotonic_ns() < expires_ns + self._expires_ns:
            found = find(number)
            if found is not None and found.why == EXPIRED:
                break
            if found is not None:
                return Answer(*found)
            await asyncio.sleep(_POLL_S)  # the loop only writes to memory, and wakes no process
        # A loop that still compiles its kernels takes no request.
        if not self._words[Word.LOOP_BEAT_NS]:
            raise NoAnswerError("the loop is starting", "try again in some seconds")
        what = f"the loop did not take the request within {self._expires_ns / NS_PER_S:g} s"
        raise NoAnswerError(what, "look at the log and at `piezod status`, then try again")

    def post(self, request: Request, expires_ns: int) -> int:
        """Post a request without waiting; return its number.

        Raises:
            BadValueError: If its waveforms are too large for the loop.
            UnavailableError: If too many requests wait already, or it is too large.
        """
        try:
            return self._mailbox.post(
                encode(request), expires_ns, urgent=isinstance(request, URGENT)
            )
        except WaveformCostError as error:
            raise BadValueError(error.what, error.remedy) from error
        except MailboxFullError as error:
            raise UnavailableError(str(error)) from error


class FollowingReader:
    """Reads the ring of the present loop, also after an exchange.

    Args:
        present: Returns the memory that is shared with the present loop.
    """

    def __init__(self, present: Callable[[], SharedMap]) -> None:
        self._present, self._shared = present, present()
        self._ring = RingReader(self._shared)

    def read(self, limit: int) -> tuple[Records, int]:
        """Return the records since the last call, and the number of lost ones."""
        # An exchange makes a new ring; its records count from zero.
        if self._shared is not (present := self._present()):
            self._shared, self._ring = present, RingReader(present)
        return self._ring.read(limit)


class LoopConnection:
    """The readers and writers of the memory that is shared with one loop.

    Args:
        config: The configuration of the loop.
        shared: The memory, made before the loop starts, so that no event is lost.
    """

    def __init__(self, config: DaemonConfig, shared: SharedMap) -> None:
        self.config, self.shared = config, shared
        self.axes = config.shown_axes
        users = tuple(config.user_axes)
        self.places = {name: self.axes.index(name) for name in (*users, *config.axes)}
        """Place of each axis in a record, user axes first: people move those."""
        self.health = LoopHealth(shared, time.monotonic_ns())
        self.requests = LoopRequests(shared)
        self.events = EventReader(shared)
        self.learned = LearnedReader(shared)
        self.file_models = {name: _model(axis.model) for name, axis in config.axes.items()}
        """Model of each axis in the configuration; None without one."""
        self.models = dict(self.file_models)
        """Model that each axis uses now; None without one."""
        self._ring = RecordReader(shared)
        self._streams = StreamWriter(shared)

    @property
    def state(self) -> State:
        """State of the newest cycle; BOOT before the first."""
        return STATES[self.shared.words[Word.LOOP_STATE]]

    def beat(self, now_ns: int) -> None:
        """Renew the beat, by which the loop sees that the supervisor is alive."""
        self.shared.words[Word.SUPERVISOR_BEAT_NS] = now_ns

    def report(self, faults: Collection[Fault]) -> None:
        """Report the faults of `SUPERVISOR_FAULTS` that are there, to the loop, from now on."""
        places = enumerate(SUPERVISOR_FAULTS)
        self.shared.words[Word.SUPERVISOR_FAULTS] = sum(
            1 << place for place, fault in places if fault in faults
        )

    def latest(self) -> Record | None:
        """Return the newest record; None before the first."""
        return self._ring.latest()

    def newest(self, count: int) -> Sequence[Record]:
        """Return the newest records, at most this number, oldest first."""
        return self._ring.last(count)

    @property
    def devices_opened(self) -> bool:
        """Whether the loop has opened the devices."""
        return bool(self.shared.words[Word.DEVICES_OPEN])

    def ended_at_safe_voltage(self) -> bool:
        """Return whether a loop that has ended left every axis at its safe voltage.

        A loop that never opened the devices, or never wrote, left them as they were: True, unless
        it replaced a loop that faults had stopped.
        """
        ending = self._ring.last(
            2
        )  # the last record is of STOPPING, the one before of the state before
        if not ending:
            return not self.succession().stopped
        if ending[-1]["shadow"]:
            return True
        # In BLIND the present voltage is unknown: the record has only the last written one.
        blind = any(STATES[record["state"]] is State.BLIND for record in ending)
        reporting = self._reporting()
        return not blind and all(
            _is_at_safe_voltage(
                axis,
                [record["axes"][i] for record in reversed(ending)],
                reads_back=axis.amplifier.device in reporting,
            )
            for i, axis in enumerate(self.config.axes.values())
        )

    def _reporting(self) -> set[str]:
        """Return the names of the devices that report the voltage in force."""
        devices = (self.shared.report() or {}).get("devices", ())
        return {each["name"] for each in devices if each["capabilities"]["read_back"]}

    def succession(self) -> Succession:
        """Return what a loop takes over that replaces this one; call it while this one runs."""
        record = self.latest()
        if record is None:
            return succession_of(self.shared) or Succession()
        return Succession(masks(record)[1], self.state is not State.SAFE)

    def stream_setpoint(self, setpoints_um: Mapping[str, float]) -> None:
        """Set setpoints for the next cycle, in µm by axis.

        Raises:
            BadValueError: If a setpoint is out of range; none is set then.
            NotNowError: If the stage follows no stream.
        """
        if self.state is not State.RUN:
            what = (
                f"the stage is in {self.state}{self._because()}, setpoints are followed in RUN only"
            )
            raise NotNowError(what, "begin the stream again")
        for name, position_um in setpoints_um.items():
            low_um, high_um = self.range_um(name)
            if not low_um <= position_um <= high_um:
                unit = self.config.unit(name)
                what = f"axis {name}: out of range (got {position_um:.12g} {unit})"
                raise BadValueError(what, f"allowed range {low_um:g} to {high_um:g} {unit}")
        # Only when all are valid: the axes of one setpoint move together.
        now_ns = time.monotonic_ns()
        for name, position_um in setpoints_um.items():
            self._streams.set(self.axes.index(name), position_um, now_ns)

    def range_um(self, axis: str) -> tuple[float, float]:
        """Return the lowest and the highest position that may be commanded, in µm.

        Before the loop has told them, they are those of the configuration, if it has any.
        """
        learned = self.learned.read(self.axes.index(axis))
        if user := self.config.user_axes.get(axis):
            return user.range
        if learned is None:
            return self.config.axes[axis].command_range_um or (-inf, inf)
        return learned.low_um, learned.high_um

    def _because(self) -> str:
        """Return the faults that stop the stage, for people; empty if there are none."""
        record = self.latest()
        bits = 0 if record is None else masks(record)[1]
        stopping = [
            rule.id
            for i, rule in enumerate(FAULTS)
            if bits >> i & 1 and rule.reaction >= Reaction.HOLD
        ]
        return f" because of {', '.join(stopping)}" if stopping else ""


def _is_at_safe_voltage(
    axis: StageAxisConfig, last: Sequence[Mapping[str, Any]], *, reads_back: bool
) -> bool:
    """Return whether write and read-back of an axis are at the safe voltage at the end.

    One read-back may be missing. Without any, the last write has to be enough, if the amplifier
    reports no voltage.

    Args:
        axis: The axis.
        last: Its last records, the newest first.
        reads_back: Whether its amplifier reports the voltage in force.
    """
    tolerance_v = read_back_tolerance_v(axis.limits.drive_min_v, axis.limits.drive_max_v)
    told_v = [last[0]["drive_v"]]
    read_back_v = next((v for each in last if isfinite(v := each["read_back_v"])), nan)
    if reads_back or isfinite(read_back_v):
        told_v.append(read_back_v)
    return all(abs(drive_v - axis.safe_v) <= tolerance_v for drive_v in told_v)  # NaN is not


def _model(path: Any) -> ModelFile | None:
    return None if path is None else load_model(path)
