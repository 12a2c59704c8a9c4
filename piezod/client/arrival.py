"""When a movement is done, from telemetry: the one rule of all clients and adapters."""

import time
from collections.abc import Collection
from dataclasses import dataclass
from math import inf, nan
from typing import Final, NamedTuple

from piezod.config.faults import Fault
from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.errors import NotReachedError, RefusedError
from piezod.messages.answers import Answer, AxisStatus, Status
from piezod.messages.documents import Message
from piezod.messages.telemetry import AxisTelemetry, Range, Telemetry

ARRIVAL_MARGIN_S: Final = 30.0
"""Longest time on the way to a target beyond what the daemon says that the movement takes, in s."""
WAVE_MARGIN_S: Final = 1.0
"""Longest time after the end of waveforms for the axes to settle, in s."""
SAME_UM: Final = 1e-6
"""A command that is closer than this to its target has arrived, in µm."""
LATE, ENDED_EARLY, SUPERSEDED, LEASE_HELD = "timeout", "state", "superseded", "lease_held"
"""Codes of the errors of a movement that was not done; the last one is also of the daemon."""
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
    position_um: float  #: Measured position, in µm; NaN if it is unknown where a waveform ends.


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


class StartedMove(NamedTuple):
    """A movement that a stage has accepted."""

    answer: Answer  #: The answer of the stage.
    axes: tuple[str, ...]  #: Names of its axes; empty for the only axis.
    follows_waves: bool = False  #: Whether the axes follow waveforms, and go to no position.


class Arriving:
    """Decides from telemetry when a movement is done, for everybody who waits for it.

    It is done when each axis has been on target. Where a waveform ends that is not demanded: the
    movement is done `WAVE_MARGIN_S` after its end at the latest.

    Args:
        move: The movement.
        timeout_s: Longest time to wait, in s; infinite for no limit, None for the time that the
            movement takes, and `ARRIVAL_MARGIN_S`.
        blind: Axes without a sensor.
    """

    def __init__(
        self, move: StartedMove, timeout_s: float | None = None, *, blind: Collection[str] = ()
    ) -> None:
        self._move, self._blind, self._start_s = move, blind, time.monotonic()
        takes_s = move.answer.duration_s
        self._ends_s = takes_s + WAVE_MARGIN_S if move.follows_waves else inf
        self._longest_s = takes_s + ARRIVAL_MARGIN_S if timeout_s is None else timeout_s
        self._motions: dict[str, int] = {}
        self._arrived: dict[str, Arrival] = {}

    def feed(self, interval: Telemetry) -> tuple[Arrival, ...]:
        """Take the next interval; return where the axes have arrived, empty until all have.

        Raises:
            NotReachedError: If the movement takes too long, or if another movement or another state
                has ended it, also after the arrival.
        """
        axes = self._move.axes or tuple(interval.axes)[:1]
        self._motions.setdefault(axes[0], self._move.answer.motion)
        begun = interval.axes[axes[0]].motion >= self._motions[axes[0]]
        since_s = time.monotonic() - self._start_s
        for axis in axes:
            if begun:
                self._look(interval, axis, ended=since_s > self._ends_s)
            if since_s > self._longest_s and axis not in self._arrived:
                raise too_late(interval, axis, self._longest_s)
        return tuple(self._arrived.values()) if len(self._arrived) == len(axes) else ()

    def _look(self, interval: Telemetry, axis: str, *, ended: bool) -> None:
        now, has_sensor = interval.axes[axis], axis not in self._blind
        # The axes of a movement begin in the same cycle, each with a number of its own.
        if now.motion > self._motions.setdefault(axis, now.motion):
            what = f"axis {axis}: another movement has replaced this one"
            raise NotReachedError(what, code=SUPERSEDED)
        if interval.state != State.RUN:
            when = "after its arrival" if axis in self._arrived else "before it reached the target"
            what = f"axis {axis}: the stage went to {interval.state}{because_of(interval)} {when}"
            raise NotReachedError(what, "`piezod faults` shows more", ENDED_EARLY)
        position_um = now.position_um.last if has_sensor else now.command_um.last
        known = position_um is not None
        if ended or (known and has_arrived(interval.state, now, has_sensor=has_sensor)):
            there_um = nan if position_um is None else position_um
            arrival = Arrival(axis=axis, motion=now.motion, position_um=there_um)
            self._arrived.setdefault(axis, arrival)


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
    return NotReachedError(what, f"the stage continues; {cause}", LATE)


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
