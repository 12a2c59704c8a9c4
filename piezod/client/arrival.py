"""Whether a movement has reached its target, from telemetry."""

import time
from dataclasses import dataclass
from typing import Final

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.errors import NotReachedError, RefusedError
from piezod.messages.answers import Answer, AxisStatus, Status
from piezod.messages.documents import Message
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry

SETTLE_S: Final = 30.0
"""Longest time on the way to a target beyond what the daemon says that the movement takes, in s."""
SAME_UM: Final = 1e-6
"""A command that is closer than this to its target has arrived, in µm."""
_NO_CAUSE: Final = frozenset({Fault.D10, Fault.P6, Fault.P7, Fault.P11, Fault.P15})
"""Faults that change no state."""
_REMEDIES: Final[dict[str, str]] = {
    Mode.UNCOMPENSATED: "mode uncompensated leaves the hysteresis of the stage in: choose another "
    "mode, as in `piezod mode feedforward`",
    Mode.FEEDFORWARD: "the model errs by that much, or there is none, or the stage has drifted: "
    "choose mode trimmed or adaptive, or identify again",
    Mode.ADAPTIVE: "the learned model errs by that much: choose mode trimmed, or move more before",
    Mode.CLOSED: "the feedback has reached its authority, or the drive its limit: identify again, "
    "and see `piezod status`",
    Mode.TRIMMED: "the trim has not got there yet, or has reached its authority, or the drive its "
    "limit: allow more time, and see `piezod status`",
}
"""What to do about a steady error, by mode."""
_UNKNOWN_MEMORY: Final = (
    "the hysteresis memory is unknown (D10): `piezod stop`, `piezod arm` and `piezod condition` "
    "make it known"
)


@dataclass(frozen=True, kw_only=True)
class Arrival(Message):
    """A movement that has reached its target."""

    axis: str  #: Name of the axis.
    motion: int  #: Number of the movement.
    position_um: float  #: Measured position, in µm.


def has_arrived(state: str, axis: AxisStatus | AxisTelemetry, *, has_sensor: bool) -> bool:
    """Return whether an axis has arrived: without a sensor, its command has."""
    if has_sensor:
        return axis.on_target
    target_um, command_um = axis.target_um, _last(axis.command_um)
    if state != State.RUN or target_um is None or command_um is None:
        return False
    return abs(target_um - command_um) <= SAME_UM


def _last(value: float | Range | None) -> float | None:
    return value.last if isinstance(value, Range) else value


def refuse_without_sensor(status: Status, axis: str | None) -> None:
    """Refuse to wait for a position that nothing measures.

    Args:
        status: The status of the stage.
        axis: Name of the axis; None for the only axis.

    Raises:
        RefusedError: If the axis has no sensor.
    """
    name = axis or next(iter(status.axes), "")
    if name in status.axes and not status.axes[name].has_sensor:
        what = f"axis {name} has no sensor to see that it is on target"
        raise RefusedError(what, "move without waiting for the position", "no_sensor")


def arrival(
    interval: Telemetry, motion: int, axis: str | None, *, has_sensor: bool = True
) -> Arrival | None:
    """Return the arrival of a movement, or None while the movement continues.

    Args:
        interval: The newest interval of telemetry.
        motion: Number of the movement.
        axis: Name of its axis; None for the only axis.
        has_sensor: Whether the axis has a sensor; otherwise its position is its command.

    Raises:
        NotReachedError: If the movement has ended before its target.
    """
    name = axis or next(iter(interval.axes))
    now = interval.axes[name]
    if now.motion < motion:
        return None  # an interval before the movement began
    if now.motion > motion:
        what = f"axis {name}: another movement has replaced this one"
        raise NotReachedError(what, code="superseded")
    position_um = now.position_um.last if has_sensor else now.command_um.last
    if position_um is not None and has_arrived(interval.state, now, has_sensor=has_sensor):
        return Arrival(axis=name, motion=motion, position_um=position_um)
    if interval.state != State.RUN:
        because = because_of(interval)
        what = (
            f"axis {name}: the stage went to {interval.state}{because} before it reached the target"
        )
        raise NotReachedError(what, "`piezod faults` shows more", "state")
    return None


class Arriving:
    """Decides from telemetry when the movement of an axis is done, for everybody who waits for it.

    Args:
        answer: The answer that has started it.
        axis: Name of its axis; None for the only axis.
        timeout_s: Longest time to wait, in s; infinite for no limit, None for the time that the
            movement takes, and `SETTLE_S`.
        has_sensor: Whether the axis has a sensor.
    """

    def __init__(
        self,
        answer: Answer,
        axis: str | None,
        timeout_s: float | None = None,
        *,
        has_sensor: bool = True,
    ) -> None:
        self._motion, self._axis, self._has_sensor = answer.motion, axis, has_sensor
        self._longest_s = answer.duration_s + SETTLE_S if timeout_s is None else timeout_s
        self._start_s = time.monotonic()

    def feed(self, interval: Telemetry) -> Arrival | None:
        """Take the next interval; return the arrival, or None while the movement continues.

        Raises:
            NotReachedError: If the movement has ended before its target, or takes too long.
        """
        arrived = arrival(interval, self._motion, self._axis, has_sensor=self._has_sensor)
        if arrived is None and time.monotonic() - self._start_s > self._longest_s:
            raise too_late(interval, self._axis, self._longest_s)
        return arrived


def because_of(interval: Telemetry) -> str:
    """Return the faults because of which a stage may have left its state, in words; or nothing.

    An unknown hysteresis memory follows from a stop; neither it nor the faults of disk, log and
    configuration file change a state.
    """
    faults = [fault for fault in interval.faults if fault not in _NO_CAUSE]
    return f" because of {', '.join(faults)}" if faults else ""


def too_late(interval: Telemetry, axis: str | None, timeout_s: float) -> NotReachedError:
    """Return the error of a movement that takes too long.

    Args:
        interval: The newest interval of telemetry.
        axis: Name of the axis; None for the only axis.
        timeout_s: The time-out that has passed, in s.
    """
    name = axis or next(iter(interval.axes))
    what = f"axis {name}: not on target within {timeout_s:g} s"
    now = interval.axes[name]
    if now.error_um.last is not None:
        what += f", the error is {now.error_um.last:+.3f} µm"
    cause = _likely_cause(now, memory_unknown=Fault.D10 in interval.faults)
    return NotReachedError(what, f"the stage continues; {cause}", "timeout")


def _likely_cause(now: AxisTelemetry, *, memory_unknown: bool) -> str:
    """Return why a position is not reached, the likeliest cause first, and what to do."""
    command_um, target_um = now.command_um.last, now.target_um
    if command_um is None or target_um is None or now.error_um.min is None:
        return "check the speed, and that the tolerance is above the noise"
    if abs(command_um - target_um) > SAME_UM:
        return f"the command is at {command_um:.3f} µm, still on its way: allow more time, or speed"
    low_um, high_um = now.error_um.min, now.error_um.max or 0.0
    # An error that keeps its sign is no noise.
    if low_um * high_um > 0.0:
        if memory_unknown and now.mode != Mode.UNCOMPENSATED:
            return _UNKNOWN_MEMORY
        return _REMEDIES.get(now.mode, "the model errs by that much: identify again")
    return (
        f"the error varies between {low_um:+.3f} and {high_um:+.3f} µm: the tolerance is not above "
        "the noise"
    )
