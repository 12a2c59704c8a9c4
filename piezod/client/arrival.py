"""Whether a movement has come to its target, told by telemetry."""

from dataclasses import dataclass

from piezod.client.results import Result
from piezod.client.telemetry import Telemetry
from piezod.config.states import State
from piezod.errors import NotReachedError


@dataclass(frozen=True, kw_only=True)
class Arrival(Result):
    """A movement that has reached its target.

    Attributes:
        axis: Name of the axis.
        motion: Number of the movement.
        position_um: Where the stage is, µm.
    """

    axis: str
    motion: int
    position_um: float


def arrival(told: Telemetry, motion: int, axis: str | None) -> Arrival | None:
    """Return the arrival that telemetry tells, None as long as the movement goes on.

    Args:
        told: The newest interval.
        motion: Number of the movement.
        axis: Name of its axis; None for the only one.

    Raises:
        NotReachedError: If the movement has ended otherwise.
    """
    name = axis or next(iter(told.axes))
    now = told.axes[name]
    if now.motion < motion:
        return None  # an interval before the movement began
    if now.motion > motion:
        what = f"axis {name}: another movement has taken the place of this one"
        raise NotReachedError(what, code="superseded")
    position_um = now.position_um.last
    if now.on_target and position_um is not None:
        document = {"axis": name, "motion": motion, "position_um": position_um}
        return Arrival(document=document, axis=name, motion=motion, position_um=position_um)
    if told.state != State.RUN:
        because = f" because of {', '.join(told.faults)}" if told.faults else ""
        what = f"axis {name}: the stage went to {told.state}{because} before it was there"
        raise NotReachedError(what, "`piezod faults` tells more", "state")
    return None


def too_late(told: Telemetry, axis: str | None, timeout_s: float) -> NotReachedError:
    """Return the error of a movement that takes too long.

    Args:
        told: The newest interval.
        axis: Name of the axis; None for the only one.
        timeout_s: How long it has been waited for, s.
    """
    name = axis or next(iter(told.axes))
    what = f"axis {name}: not on target within {timeout_s:g} s"
    error_um = told.axes[name].error_um.last
    if error_um is not None:
        what += f", the error is {error_um:+.3f} µm"
    remedy = "the stage goes on; is the speed low, or the tolerance below the noise?"
    return NotReachedError(what, remedy, "timeout")
