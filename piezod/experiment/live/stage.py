"""A running stage, step by step: at rest, armed, along a waveform, recorded; and left safe.

It opens, judges and guards nothing, because the daemon does; the end of its session is the daemon's
ramp, which comes even if this process is killed.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from math import inf
from types import TracebackType
from typing import Any, Final, Self, TypeVar

from piezod.client import StageClient
from piezod.client.arrival import because_of
from piezod.client.calls import Waveforms
from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.shapes import Setpoint
from piezod.errors import (
    ClientError,
    DataError,
    NotReachedError,
    NotRunningError,
    RefusedError,
)
from piezod.experiment.lateness import until_punctual
from piezod.experiment.live.loop_lateness import LoopLateness
from piezod.experiment.live.recorder import StageRecorder
from piezod.experiment.live.setup import LiveSetup
from piezod.experiment.scan.loop_lines import PartLines
from piezod.messages.documents import Document
from piezod.messages.telemetry import Telemetry as Interval

RATE_HZ: Final = 20.0
"""Rate of the telemetry, in Hz."""
SCAN_RATE_HZ: Final = 4.0
"""Rate at which a scan is asked for new sweeps, in Hz."""
NO_SWEEP: Final = 1_000_000
"""A sweep that no scan has: only the state of the scan is asked."""
ZERO_S: Final = 0.5
"""Longest duration of the zeroing of a sensor, in s."""
SHORTEST_S: Final = 0.1
"""Shortest duration of a rest that is driven, in s."""

_NOT_OF_THE_DATA: Final = frozenset({Fault.L1, Fault.P11, Fault.P15})
"""Faults that are no remark about the data: late samples are counted elsewhere."""
_STATES_TO_SAFE: Final = frozenset({State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP})
PATIENCE_S: Final = 15.0
"""Longest wait, in s, for punctual cycles before a repetition; L2 needs 5 s of them to end."""

T = TypeVar("T")
Advance = Callable[[float], None]
"""Called with the number of further seconds that have passed."""


class LiveStage:
    """A stage that a daemon owns, for the time of a `with` block.

    At the end of the block, for any reason, the stage is requested to stop: it goes to its safe
    voltage and is disarmed. A running recording is ended, and the lease is released. If this
    process is killed, the daemon does all of that, because the session ends.

    Every method raises ClientError, or a subclass, if the daemon refuses or has ended, and
    NotReachedError if the stage leaves the expected states.
    """

    def __init__(self, client: StageClient, setup: LiveSetup, advance: Advance) -> None:
        self._client, self._setup, self._advance = client, setup, advance
        self._session = ExitStack()
        self.recorder = StageRecorder(client)
        """Records the cycles of the stage."""
        self.faults: set[str] = set()
        """Ids of the faults that were present since the last `clear`."""
        self.notes: list[str] = []
        """What was repeated, a sentence each."""
        self._loop = LoopLateness()

    def __enter__(self) -> Self:
        self._session.enter_context(self._client.session())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop the stage.

        Raises:
            ClientError: If it cannot be stopped and its daemon still runs.
        """
        failure = None
        try:
            self._client.stop()
        except ClientError as not_stopped:
            failure = not_stopped
        self.recorder.drop()
        with suppress(ClientError):
            self._session.close()
        if failure is not None and not isinstance(failure, NotRunningError):
            what = f"the stage could not be stopped: {failure}"
            if isinstance(error, Exception):
                what = f"{error}; {what}"
            raise ClientError(what, "`piezod stop`, or the emergency stop") from error

    def fault_notes(self, begin: str = "Faults") -> tuple[str, ...]:
        """Return a sentence about `faults`, if there are any; it begins with this text."""
        if not self.faults:
            return ()
        return (f"{begin} were present: {', '.join(sorted(self.faults))}. See `piezod faults`.",)

    # ------------------------------------------------------------------ steps

    def until_punctual(self, measure: Callable[[], T], prepare: Callable[[], None]) -> T:
        """Return the result of a measurement, which is repeated if the loop was late.

        Args:
            measure: The measurement.
            prepare: Brings the stage from any state to the one in which `measure` begins.

        Raises:
            LatenessError: If the loop was late each time.
        """

        def again(reason: str) -> None:
            self.notes.append(f"Repeated: {reason}.")
            self._await_punctual()
            self.faults.clear()
            prepare()

        self._loop.take()
        return until_punctual(measure, self._loop.take, again, RefusedError, DataError)

    def disarm(self) -> None:
        """Stop, and wait until the stage is disarmed."""
        self._client.stop()
        self._wait(lambda interval: interval.state == State.SAFE, _STATES_TO_SAFE)

    def rest(self, settle_s: float) -> None:
        """Let a disarmed stage rest, and zero its sensors.

        If the safe voltage is not the rest voltage, the stage is armed and driven there.
        """
        if self._setup.safe_at_rest:
            self._wait_in(settle_s, State.SAFE)
        else:
            self.arm()
            rest_v = {
                name: Setpoint(kind="setpoint", level=axis.config.limits.rest_v)
                for name, axis in self._setup.axes.items()
            }
            self.drive(rest_v, max(settle_s, SHORTEST_S))
        self._client.zero()
        self._wait_in(ZERO_S, *(State.SAFE, State.READY))

    def arm(self) -> None:
        """Arm a stage at rest, and wait for the end of a conditioning."""
        self._client.arm()
        self._wait(lambda interval: interval.state == State.READY, {State.IDENT})

    def arm_at_rest(self, settle_s: float) -> None:
        """Disarm, rest as `rest` does, and arm."""
        self.disarm()
        self.rest(settle_s)
        self.arm()

    def drive(self, drive_v: Waveforms, duration_s: float) -> None:
        """Drive voltages from rest and back to rest; the stage is armed."""
        self._client.identify(drive_v, duration_s)
        self._wait(lambda interval: interval.state == State.READY, {State.IDENT})

    def pause(self, duration_s: float) -> float:
        """Hold the voltage of an armed stage for a duration in s; return the time, in s."""
        return self._wait_in(duration_s, State.READY)

    def play(
        self,
        axis: str,
        period_v: Sequence[float],
        lead_in_v: Sequence[float],
        interval_s: float,
        cycles: int,
    ) -> Document:
        """Play a table on an armed stage; return its record.

        Args:
            axis: Name of the axis.
            period_v: Voltages of one period, in V.
            lead_in_v: Voltages before the first period, in V.
            interval_s: Time between two voltages, in s.
            cycles: Number of periods.

        Raises:
            DataError: If the play failed; the text has the reason of the device.
        """
        self._client.play(
            period_v, lead_in_v=lead_in_v, interval_s=interval_s, cycles=cycles, axis=axis
        )
        self._wait(lambda interval: interval.state == State.READY, {State.IDENT})
        played = self._client.played()
        if played["failed"]:
            raise DataError(f"axis {axis}: the play failed: {played['failed']}")
        return played

    def scan(self, **request: Any) -> Iterator[Document]:
        """Play a scan on an armed stage; yield its samples as they come, some sweeps each.

        Args:
            request: Arguments of `StageClient.scan`.

        Raises:
            DataError: If the scan failed; the text has the reason of the device.
        """
        before = self._scan_number()
        self._client.scan(**request)
        yield from self._samples(before)
        self._wait(lambda interval: interval.state == State.READY, {State.IDENT})

    def _samples(self, before: int) -> Iterator[Document]:
        """Yield the documents of a scan until it has ended; `before` is the number of the last."""
        first = 0
        with closing(self._client.telemetry(SCAN_RATE_HZ)) as intervals:
            for interval in intervals:
                self._advance(1.0 / SCAN_RATE_HZ)
                if self._scan_number() == before:
                    if interval.state not in {State.IDENT, State.READY}:
                        raise left_states(interval)
                    continue
                ended = False
                while not ended:
                    document = self._client.scanned(first)
                    got = len(next(iter(document["samples"].values()))) // document["points"]
                    yield document
                    first += got
                    if document["failed"] and first == document["done"]:
                        raise DataError(f"the scan failed: {document['failed']}")
                    ended = document["ended"] and first == document["done"]
                    if not got:
                        break
                if ended:
                    return
                if interval.state != State.IDENT:
                    raise left_states(interval)

    def _scan_number(self) -> int:
        """Return the number of the last scan; 0 if there is none."""
        try:
            return int(self._client.scanned(NO_SWEEP)["number"])
        except ClientError:
            return 0

    def select(self, mode: Mode, axes: Collection[str]) -> None:
        """Select the mode of axes, disarmed or armed; in an armed stage this starts RUN."""
        for axis in axes:
            self._client.mode(mode, axis=axis)

    def follow(
        self,
        command_um: Waveforms,
        duration_s: float,
        mode: Mode,
        lines: PartLines = PartLines(),  # noqa: B008 - it cannot change
    ) -> None:
        """Follow waveforms to their end.

        Args:
            command_um: Position over time for each axis, in µm.
            duration_s: Duration of the waveforms, in s.
            mode: Mode of all of these axes.
            lines: What lines do meanwhile.
        """
        pulses, edges = ([each.model_dump() for each in lines.pulses], lines.edges)
        waits = None if edges is None else edges.model_dump()
        answer = self._client.wave(command_um, duration_s, pulses=pulses, edges=waits)
        motion, takes_s = answer.motion, answer.duration_s
        first, start_s = next(iter(command_um)), inf

        def ended(interval: Interval) -> bool:
            nonlocal start_s
            if interval.axes[first].motion > motion:
                what = f"axis {first}: another movement has taken the place of this one"
                raise NotReachedError(what, "no other client may move the stage now", "superseded")
            for name in command_um:
                if interval.state == State.RUN and interval.axes[name].mode != mode:
                    what = f"axis {name}: the mode has become {interval.axes[name].mode}"
                    raise NotReachedError(what + because_of(interval), code="mode")
            if interval.axes[first].motion == motion:
                start_s = min(start_s, interval.t_s)
                if edges is not None and interval.axes[first].remaining_s:
                    return False  # edges decide how long it takes
            return interval.state == State.RUN and interval.t_s - start_s >= takes_s

        self._wait(ended, {State.RUN})

    # ------------------------------------------------------------------ waiting

    def _await_punctual(self) -> None:
        """Drop the recording, and wait for some time until the cycles are punctual again."""
        self.recorder.drop()
        start_s = inf

        def over(interval: Interval) -> bool:
            nonlocal start_s
            start_s = min(start_s, interval.t_s)
            return Fault.L2 not in interval.faults or interval.t_s - start_s >= PATIENCE_S

        self._wait(over, frozenset(State))

    def _wait_in(self, duration_s: float, *states: State) -> float:
        start_s = inf

        def passed(interval: Interval) -> bool:
            nonlocal start_s
            start_s = min(start_s, interval.t_s)
            return interval.state in states and interval.t_s - start_s >= duration_s

        return self._wait(passed, states).t_s

    def _wait(self, done: Callable[[Interval], bool], through: Collection[State]) -> Interval:
        """Return the first interval that is `done`; the states before it must be in `through`."""
        before_s = inf
        with closing(self._client.telemetry(RATE_HZ)) as intervals:
            for interval in intervals:
                self.faults.update(set(interval.faults) - _NOT_OF_THE_DATA)
                self._loop.add(interval)
                self._advance(max(interval.t_s - before_s, 0.0))
                before_s = interval.t_s
                if done(interval):
                    return interval
                if interval.state not in through:
                    raise left_states(interval)
        raise NotRunningError("the telemetry has ended", "is the daemon still running?")


def left_states(interval: Interval) -> NotReachedError:
    """Return the error of a stage that is in an unexpected state."""
    what = f"the stage is in {interval.state}{because_of(interval)}"
    return NotReachedError(what, "see `piezod faults`", "state")
