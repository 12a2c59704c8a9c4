"""An axis as a motor record: targets in, positions and the end of a movement out."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite

from piezod.client.arrival import SAME_UM, has_arrived
from piezod.client.facts import AxisFacts
from piezod.config.states import State
from piezod.ioc.readings import DOWN, FAULTY, OK, REFUSED, UNKNOWN, Alarm
from piezod.ioc.records import Motor
from piezod.ioc.values import alarm_of_state
from piezod.messages.answers import Answer
from piezod.messages.telemetry import AxisTelemetry


class AxisMotor:
    """The fields of one motor record.

    A movement goes on, for its clients, from the write until the axis is on target, or until the
    stage is no longer in RUN. If it ends before its target, for whatever reason, VAL becomes RBV
    before DMOV rises. It has an alarm then, until the next write that is accepted, unless this
    record was stopped. Resuming and arming begin no movement. Writes come in threads of EPICS, with
    the record locked; everything else locks it.

    Args:
        record: The record.
        has_sensor: Whether the axis has a sensor.
    """

    def __init__(self, record: Motor, *, has_sensor: bool) -> None:
        self._record, self._has_sensor = record, has_sensor
        self._facts: AxisFacts | None = None
        self._outcome: Alarm = OK
        self._asked = 0
        """Number of writes and stops whose answer is awaited; the fields stay until then."""
        self._motion = 0
        """Number of the movement that a write has begun and that goes on; 0 if none does."""
        self._over = self._resting = -1
        """Numbers of the movement that has ended last, and of the last that was no movement."""
        self._stop: tuple[int, Alarm] | None = None
        """The newest movement when a stop was accepted, and the outcome of that movement."""
        self._state, self._newest = "", 0
        """State and number of the movement in the newest interval."""
        self._target_um: float | None = None

    def limit(self, facts: AxisFacts) -> None:
        """Take the limits of the configuration in force."""
        self._facts = facts if facts.has_range else None
        if self._facts is not None:
            low_um, high_um = facts.range_um
            fastest, speed = facts.speed_um_per_s, self._record.get("VELO")
            speed = speed if 0.0 < speed <= fastest else fastest
            self._record.set(
                HLM=high_um,
                LLM=low_um,
                VMAX=fastest,
                VELO=speed,
                ACCL=_acceleration_s(facts, speed),
                RDBD=facts.tolerance_um,
            )

    def why_not(self, position_um: float) -> str:
        """Return why the axis cannot move to a position; empty if it can."""
        if self._facts is None:
            return "the limits are not known: the daemon does not answer, or has no range"
        return self._facts.why_not(position_um)

    def take_speed(self, speed_um_per_s: float) -> str:
        """Take the speed of the next movements; return why it is not allowed, empty if it is."""
        if self._facts is None:
            return "the highest speed is not known: the daemon does not answer"
        why = self._facts.why_not_speed(speed_um_per_s)
        if not why:
            self._record.set(ACCL=_acceleration_s(self._facts, speed_um_per_s))
        return why

    @property
    def speed_um_per_s(self) -> float:
        """Speed of the next movement, in µm/s."""
        return self._record.get("VELO")

    def tweaked_um(self, direction: float) -> float:
        """Return the target of a tweak, in µm; the direction is 1 or -1."""
        return self._record.get("VAL") + direction * self._record.get("TWV")

    def begin(self, position_um: float) -> None:
        """Show that a movement has begun: its write was accepted."""
        self._asked += 1
        self._outcome = OK
        self._record.set(OK, VAL=position_um, DMOV=0, MOVN=1, LVIO=0)

    def accepted(self, position_um: float, answer: Answer) -> None:
        """Take the answer of the daemon to a write."""
        with self._record.locked():
            self._asked -= 1
            self._motion, self._target_um, self._stop = answer.motion, position_um, None

    def rejected(self) -> None:
        """Take a refusal of the daemon: the record gets back the target that it had."""
        with self._record.locked():
            self._asked -= 1
            if self._target_um is not None:
                self._record.set(VAL=self._target_um)
            self._end(REFUSED)

    def dropped(self) -> None:
        """Take that a stop came before the movement; it ends when the stage is stopped."""
        with self._record.locked():
            self._asked -= 1

    def refused(self) -> None:
        """Show that a write was refused because of the limits."""
        if self._facts is not None:  # else the daemon does not answer, which is worse
            self._outcome = REFUSED
            self._record.set(REFUSED, LVIO=1)

    @contextmanager
    def stopping(self, *, asked: bool) -> Iterator[None]:
        """Return a context manager in which the stage is stopped; it raises if it is not.

        Args:
            asked: Whether a client of this record has asked for it, and not of another axis.
        """
        with self._record.locked():
            self._asked += 1
        stopped = False
        try:
            yield
            stopped = True
        finally:
            with self._record.locked():
                self._asked -= 1
                if stopped:
                    newest = max(self._newest, self._motion)
                    self._stop = newest, OK if asked else FAULTY

    def down(self) -> None:
        """Show that the daemon does not answer; a movement has ended for its clients."""
        with self._record.locked():
            self._facts, self._target_um, self._stop = None, None, None
            self._over = self._resting = -1
            self._state, self._newest = "", 0
            self._end(OK)

    def feed(self, state: str, axis: AxisTelemetry) -> None:
        """Take the newest interval of telemetry."""
        position_um = axis.position_um.last if self._has_sensor else axis.command_um.last
        values = {} if position_um is None else {"RBV": position_um}
        with self._record.locked():
            if not self._asked and axis.motion >= self._motion:
                values |= self._progress(state, axis, position_um)
            self._state, self._newest = state, axis.motion
            failed = self._outcome is FAULTY
            self._record.set(self._alarm(state, position_um), failed=failed, **values)

    def _progress(
        self, state: str, axis: AxisTelemetry, position_um: float | None
    ) -> dict[str, float]:
        """Return the fields of the movement, which a client of another kind may have started."""
        rests = self._rests(state, axis)
        if rests:
            self._resting = axis.motion
        if rests or has_arrived(state, axis, has_sensor=self._has_sensor):
            self._over = axis.motion
        moving = state == State.RUN and self._over != axis.motion
        aborted = not (moving or self._record.get("DMOV")) and (rests or self._over != axis.motion)
        if aborted and self._stop is not None:
            self._outcome = self._stop[1]
        elif aborted and self._motion:
            self._outcome = FAULTY
        if not moving:
            self._motion = 0
        if self._stop is not None and (rests or state != State.RUN):
            self._stop = None
        values: dict[str, float] = {"DMOV": not moving, "MOVN": moving}
        target_um = None
        if aborted or rests or self._target_um is None:
            target_um = position_um
        elif state == State.RUN and axis.motion != self._resting:
            target_um = axis.target_um
        if target_um is not None:
            self._target_um = values["VAL"] = target_um
            values["TDIR"] = target_um > (axis.position_um.last or 0.0)
        return values

    def _rests(self, state: str, axis: AxisTelemetry) -> bool:
        """Return whether the stage has gone to RUN, and this axis stays at its position."""
        target_um, command_um = axis.target_um, axis.command_um.last
        if state != State.RUN or axis.motion in {self._motion, self._over}:
            return False
        if target_um is None or command_um is None or abs(target_um - command_um) > SAME_UM:
            return False
        # It may be held and resumed between two intervals.
        stopped = self._stop is not None and axis.motion > self._stop[0]
        return stopped or self._state not in {State.RUN, ""}

    def _alarm(self, state: str, position_um: float | None) -> Alarm:
        """Return the most serious alarm: position, state, or outcome of the last movement."""
        unknown = UNKNOWN if position_um is None and self._has_sensor else OK
        alarms = (unknown, alarm_of_state(state), self._outcome)
        return max(alarms, key=lambda alarm: alarm.severity)

    def _end(self, outcome: Alarm) -> None:
        self._motion = 0
        self._outcome = outcome
        alarm = DOWN if self._facts is None else outcome
        self._record.set(alarm, failed=alarm is not OK, DMOV=1, MOVN=0)


def _acceleration_s(facts: AxisFacts, speed_um_per_s: float) -> float:
    """Return the time from standstill to the highest speed in a movement over the whole range.

    A movement has its highest speed at half of its time. So clients that add ACCL, or twice that,
    to the way divided by VELO get no less than a movement takes.

    Args:
        facts: Limits of the axis.
        speed_um_per_s: The highest speed, in µm/s.
    """
    longest_s = facts.longest_move_s * facts.speed_um_per_s / speed_um_per_s
    return longest_s / 2.0 if isfinite(longest_s) else 0.0
