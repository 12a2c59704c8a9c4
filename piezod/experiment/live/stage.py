"""A running stage, step by step: to rest, armed, along a waveform, recorded; and left safe."""

import re
from collections.abc import Callable, Collection, Mapping
from contextlib import closing, suppress
from math import inf
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from piezod.client import StageClient
from piezod.client.calls import Waveforms
from piezod.client.telemetry import Telemetry as Interval
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms import Setpoint
from piezod.errors import ClientError, DataError, NotReachedError, NotRunningError
from piezod.experiment.live.setup import LiveSetup
from piezod.records.telemetry_reader import RecordedTelemetry, read_telemetry

RATE_HZ: Final = 20.0
"""How often the stage is looked at."""
RENEW_S: Final = 10.0
"""The lease, which lasts 30 s, is renewed so often."""
ZERO_S: Final = 0.5
"""How long a sensor's zeroing takes at most."""
SHORTEST_S: Final = 0.1
"""A rest that is driven lasts at least so long."""

_WAY_DOWN: Final = frozenset({State.READY, State.RUN, State.IDENT, State.HOLD, State.RAMP})
_UNUSUAL: Final = re.compile(r"[^A-Za-z0-9_-]+")
_LABEL_LETTERS: Final = 32

Advance = Callable[[float], None]
"""Told how many further seconds are over."""


class LiveStage:
    """A stage that somebody's daemon owns, for as long as a `with` block lasts.

    At the end of the block, whatever its cause, the stage is told to stop: it goes to its safe
    voltage and is disarmed. A recording that goes on is ended, and the lease is given back.

    Every method raises ClientError, or one of its kinds, where the daemon refuses or is gone, and
    NotReachedError where the stage goes another way than it was told to.

    Args:
        client: A connection to the daemon.
        setup: What the stage is like.
        advance: Told how time goes on.
    """

    def __init__(self, client: StageClient, setup: LiveSetup, advance: Advance) -> None:
        self._client, self._setup, self._advance = client, setup, advance
        self._touched = self._recording = False
        self._renewed_s = -inf
        self.faults: set[str] = set()
        """Ids of the faults that were told since this was cleared last."""

    def __enter__(self) -> Self:
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
        if not self._touched:
            return
        failure = None
        try:
            self._client.stop()
        except ClientError as not_stopped:
            failure = not_stopped
        with suppress(ClientError):
            if self._recording:
                self._client.stop_recording()
        with suppress(ClientError):
            self._client.release_lease()
        if failure is not None and not isinstance(failure, NotRunningError):
            what = f"the stage could not be stopped: {failure}"
            if isinstance(error, Exception):
                what = f"{error}; {what}"
            raise ClientError(what, "`piezod stop`, or the emergency stop") from error

    # ------------------------------------------------------------------ steps

    def park(self) -> None:
        """Stop, and wait until the stage is disarmed."""
        self._client.renew_lease()  # before it stops what somebody else may be doing
        self._touched = True
        self._client.stop()
        self._wait(lambda told: told.state == State.SAFE, _WAY_DOWN)

    def rest(self, settle_s: float) -> None:
        """Have a parked stage rest, and call the displacement there zero.

        Where the safe voltage is not that of rest, the stage is armed and driven there.

        Args:
            settle_s: How long to wait, in s.
        """
        if self._setup.safe_at_rest:
            self._pass(settle_s, State.SAFE)
        else:
            self.arm()
            rest_v = {
                name: Setpoint(kind="setpoint", level=axis.config.limits.rest_v)
                for name, axis in self._setup.axes.items()
            }
            self.drive(rest_v, max(settle_s, SHORTEST_S))
        self._client.zero()
        self._pass(ZERO_S, *(State.SAFE, State.READY))

    def arm(self) -> None:
        """Arm a stage that rests, and wait for the end of the conditioning where there is one."""
        self._client.arm()
        self._wait(lambda told: told.state == State.READY, {State.IDENT})

    def drive(self, drive_v: Waveforms, duration_s: float) -> None:
        """Drive voltages from rest and back to it; the stage is armed.

        Args:
            drive_v: Axis: drive over time, in V.
            duration_s: How long, in s.
        """
        self._client.identify(drive_v, duration_s)
        self._wait(lambda told: told.state == State.READY, {State.IDENT})

    def select(self, mode: Mode, axes: Collection[str]) -> None:
        """Choose the mode of axes, disarmed or not; armed, this starts RUN."""
        for axis in axes:
            self._client.mode(mode, axis=axis)

    def staying_um(self) -> Mapping[str, float]:
        """Return the command that each axis follows in RUN before a movement, in µm."""
        told = self._wait(lambda _told: True, {State.RUN})
        return {name: axis.command_um.last or 0.0 for name, axis in told.axes.items()}

    def follow(
        self, command_um: Waveforms, duration_s: float, mode: Mode, longest_s: float
    ) -> None:
        """Follow waveforms to their end.

        Args:
            command_um: Axis: position over time, in µm.
            duration_s: How long the waveforms are followed, in s.
            mode: The mode in which all of these axes are.
            longest_s: How long it takes with the way to their start, in s.
        """
        motion = self._client.wave(command_um, duration_s).motion
        first, begun_s = next(iter(command_um)), inf

        def ended(told: Interval) -> bool:
            nonlocal begun_s
            if told.axes[first].motion > motion:
                what = f"axis {first}: another movement has taken the place of this one"
                raise NotReachedError(what, "nobody else may move the stage now", "superseded")
            for name in command_um:
                if told.state == State.RUN and told.axes[name].mode != mode:
                    what = f"axis {name}: the mode has become {told.axes[name].mode}"
                    raise NotReachedError(what + _because_of(told), code="mode")
            if told.axes[first].motion == motion:
                begun_s = min(begun_s, told.t_s)
            return told.state == State.RUN and told.t_s - begun_s >= longest_s

        self._wait(ended, {State.RUN})

    def start_recording(self, label: str) -> None:
        """Record every cycle from now on.

        Args:
            label: Becomes part of the recording's name, as far as its letters may.
        """
        self._client.start_recording(_UNUSUAL.sub("-", label).strip("-_")[:_LABEL_LETTERS] or None)
        self._recording = True

    def end_recording(self, file: Path) -> RecordedTelemetry:
        """End the recording, and return it.

        Args:
            file: Where to copy it to.

        Raises:
            DataError: If it ended by itself.
        """
        ended = self._client.stop_recording()
        self._recording = False
        if ended.why:
            raise DataError(f"the recording has ended by itself: {ended.why}")
        self._client.fetch_recording(ended.name, file)
        return read_telemetry(file)

    # ------------------------------------------------------------------ waiting

    def _pass(self, duration_s: float, *states: State) -> None:
        begun_s = inf

        def over(told: Interval) -> bool:
            nonlocal begun_s
            begun_s = min(begun_s, told.t_s)
            return told.state in states and told.t_s - begun_s >= duration_s

        self._wait(over, states)

    def _wait(self, done: Callable[[Interval], bool], through: Collection[State]) -> Interval:
        """Return the first interval that will do; the states on the way to it are given."""
        before_s = inf
        with closing(self._client.telemetry(RATE_HZ)) as intervals:
            for told in intervals:
                self.faults.update(told.faults)
                self._advance(max(told.t_s - before_s, 0.0))
                before_s = told.t_s
                if done(told):
                    return told
                if told.state not in through:
                    what = f"the stage is in {told.state}{_because_of(told)}"
                    raise NotReachedError(what, "`piezod faults` tells more", "state")
                if told.t_s - self._renewed_s >= RENEW_S:
                    self._client.renew_lease()
                    self._renewed_s = told.t_s
        raise NotRunningError("the telemetry has ended", "is the daemon still running?")


def _because_of(told: Interval) -> str:
    return f" because of {', '.join(told.faults)}" if told.faults else ""
