"""An axis as a motor record: targets in, positions and the end of a movement out."""

from math import isfinite, nan

from piezod.client.arrival import SAME_UM
from piezod.client.limits import AxisLimits
from piezod.config.states import State
from piezod.ioc.readings import DOWN, FAULTY, OK, REFUSED, UNKNOWN, Alarm
from piezod.ioc.records import Motor
from piezod.ioc.values import alarm_of_state
from piezod.messages.answers import Answer
from piezod.messages.telemetry import AxisTelemetry


class AxisMotor:
    """The fields of one motor record.

    A movement goes on, for its clients, from the write until the axis is on target, or until the
    stage is no longer in RUN. The record has an alarm if it ended before its target, until the next
    write that is accepted. Writes come in threads of EPICS, with the record locked; everything else
    locks it.

    Args:
        record: The record.
        has_sensor: Whether the axis has a sensor.

    Attributes:
        state: State of the stage in the newest interval.
    """

    def __init__(self, record: Motor, *, has_sensor: bool) -> None:
        self._record, self._has_sensor = record, has_sensor
        self._limits: AxisLimits | None = None
        self.state = ""
        self._outcome: Alarm = OK
        self._asked = 0
        """Number of writes whose answer is awaited."""
        self._motion = 0
        """Number of the movement that goes on; 0 if none does."""
        self._arrived = -1
        """Number of the movement that has arrived last; noise does not begin it again."""
        self._target_um: float | None = None

    def limit(self, limits: AxisLimits | None, tolerance_um: float) -> None:
        """Take the limits of the configuration in force.

        Args:
            limits: Limits; None if the axis has none.
            tolerance_um: Tolerance of `on_target`, in µm.
        """
        self._limits = limits
        if limits is not None:
            speed = self._record.get("VELO")
            fastest = limits.speed_um_per_s
            self._record.set(
                HLM=limits.high_um,
                LLM=limits.low_um,
                VMAX=fastest,
                VELO=speed if 0.0 < speed <= fastest else fastest,
                RDBD=tolerance_um,
            )

    def why_not(self, position_um: float) -> str:
        """Return why the axis cannot move to a position; empty if it can."""
        if self._limits is None:
            return "the limits are not known: the daemon does not answer, or has no range"
        low_um, high_um, _ = self._limits
        if not isfinite(position_um) or not low_um <= position_um <= high_um:
            return f"{position_um:g} um, allowed range {low_um:g} to {high_um:g} um"
        return ""

    def why_not_speed(self, speed_um_per_s: float) -> str:
        """Return why a speed is not allowed; empty if it is."""
        fastest = self._limits.speed_um_per_s if self._limits else nan
        if 0.0 < speed_um_per_s <= fastest:
            return ""
        return f"speed {speed_um_per_s:g} um/s, allowed: above 0, at most {fastest:g}"

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
            self._motion, self._target_um = answer.motion, position_um

    def rejected(self) -> None:
        """Take a refusal of the daemon: the record gets back the target that it had."""
        with self._record.locked():
            self._asked -= 1
            self._end(REFUSED)
            if self._target_um is not None:
                self._record.set(VAL=self._target_um)

    def refused(self) -> None:
        """Show that a write was refused because of the limits."""
        if self._limits is not None:  # else the daemon does not answer, which is worse
            self._outcome = REFUSED
            self._record.set(REFUSED, LVIO=1)

    def stopped(self) -> None:
        """Take a stop that a client of this record has requested."""
        with self._record.locked():
            self._end(OK)

    def down(self) -> None:
        """Show that the daemon does not answer; a movement has ended for its clients."""
        with self._record.locked():
            self._limits, self._target_um, self._arrived = None, None, -1
            self._end(OK)

    def feed(self, state: str, axis: AxisTelemetry) -> None:
        """Take the newest interval of telemetry.

        Args:
            state: State of the stage.
            axis: The axis in it.
        """
        self.state = state
        position_um = axis.position_um.last if self._has_sensor else axis.command_um.last
        values = {} if position_um is None else {"RBV": position_um}
        with self._record.locked():
            if not self._asked and axis.motion >= self._motion:
                if self._target_um is None and position_um is not None:
                    self._target_um = values["VAL"] = position_um
                values |= self._progress(state, axis)
            failed = self._outcome is FAULTY
            self._record.set(self._alarm(state, position_um), failed=failed, **values)

    def _progress(self, state: str, axis: AxisTelemetry) -> dict[str, float]:
        """Return the fields of the movement, which a client of another kind may have started."""
        if self._has_arrived(axis):
            self._arrived = axis.motion
        arrived = self._arrived == axis.motion
        moving = state == State.RUN and not arrived
        if self._motion and not moving and not arrived:
            self._outcome = FAULTY
        if not moving:
            self._motion = 0
        values: dict[str, float] = {"DMOV": not moving, "MOVN": moving}
        if axis.target_um is not None and state == State.RUN:
            self._target_um = values["VAL"] = axis.target_um
            values["TDIR"] = axis.target_um > (axis.position_um.last or 0.0)
        return values

    def _has_arrived(self, axis: AxisTelemetry) -> bool:
        if self._has_sensor:
            return axis.on_target
        target_um, command_um = axis.target_um, axis.command_um.last
        if target_um is None or command_um is None:
            return False
        return abs(target_um - command_um) <= SAME_UM

    def _alarm(self, state: str, position_um: float | None) -> Alarm:
        """Return the most serious alarm: position, state, or outcome of the last movement."""
        unknown = UNKNOWN if position_um is None and self._has_sensor else OK
        alarms = (unknown, alarm_of_state(state), self._outcome)
        return max(alarms, key=lambda alarm: alarm.severity)

    def _end(self, outcome: Alarm) -> None:
        self._motion = 0
        self._outcome = outcome
        alarm = DOWN if self._limits is None else outcome
        self._record.set(alarm, failed=alarm is not OK, DMOV=1, MOVN=0)
