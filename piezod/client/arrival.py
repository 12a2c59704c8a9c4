"""Whether a movement has reached its target, from telemetry."""

from dataclasses import dataclass

from piezod.client.results import Result, Status
from piezod.client.telemetry import Telemetry
from piezod.config.states import State
from piezod.errors import NotReachedError, RefusedError


@dataclass(frozen=True, kw_only=True)
class Arrival(Result):
    """A movement that has reached its target.

    Attributes:
        axis: Name of the axis.
        motion: Number of the movement.
        position_um: Measured position, in µm.
    """

    axis: str
    motion: int
    position_um: float


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


def arrival(interval: Telemetry, motion: int, axis: str | None) -> Arrival | None:
    """Return the arrival of a movement, or None while the movement continues.

    Args:
        interval: The newest interval of telemetry.
        motion: Number of the movement.
        axis: Name of its axis; None for the only axis.

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
    position_um = now.position_um.last
    if now.on_target and position_um is not None:
        document = {"axis": name, "motion": motion, "position_um": position_um}
        return Arrival(document=document, axis=name, motion=motion, position_um=position_um)
    if interval.state != State.RUN:
        because = f" because of {', '.join(interval.faults)}" if interval.faults else ""
        what = (
            f"axis {name}: the stage went to {interval.state}{because} before it reached the target"
        )
        raise NotReachedError(what, "`piezod faults` shows more", "state")
    return None


def too_late(interval: Telemetry, axis: str | None, timeout_s: float) -> NotReachedError:
    """Return the error of a movement that takes too long.

    Args:
        interval: The newest interval of telemetry.
        axis: Name of the axis; None for the only axis.
        timeout_s: The time-out that has passed, in s.
    """
    name = axis or next(iter(interval.axes))
    what = f"axis {name}: not on target within {timeout_s:g} s"
    error_um = interval.axes[name].error_um.last
    if error_um is not None:
        what += f", the error is {error_um:+.3f} µm"
    remedy = "the stage continues; check the speed, and that the tolerance is above the noise"
    return NotReachedError(what, remedy, "timeout")
