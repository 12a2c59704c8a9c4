"""The stage with the identifiers of GCS; shared by all connections."""

from typing import Final

from piezod.client.arrival import has_arrived
from piezod.client.facts import AxisFacts
from piezod.client.mirror import StageMirror
from piezod.client.results import AxisStatus, Status
from piezod.config.states import State
from piezod.gcs.errors import Code, GcsRefusal

STATUS_AGE_S: Final = 0.04
"""Age from which a status is asked again, in s: half of the daemon's limit of 50 requests per s."""
_LIMITS_AGE_S: Final = 1.0
UP: Final = (State.SAFE, State.READY, State.RUN, State.HOLD)
"""States in which the controller reports that it is ready for commands."""


class Readings:
    """The newest status and limits. Each method raises ClientError if the daemon does not answer.

    The axes have the identifiers 1, 2, … in the order of the configuration.

    Args:
        mirror: The stage.
        mode: The mode in which an axis counts as servo-controlled.
    """

    def __init__(self, mirror: StageMirror, mode: str) -> None:
        self.mirror, self._mode = mirror, mode

    async def status(self) -> Status:
        """Return the status; at most `STATUS_AGE_S` old, and newer than the last command."""
        return await self.mirror.status(STATUS_AGE_S)

    async def axes(self) -> dict[str, AxisStatus]:
        """Return the status of each axis by its identifier."""
        status = await self.status()
        return {str(i): axis for i, axis in enumerate(status.axes.values(), 1)}

    async def name_of(self, axis: str) -> str:
        """Return the name of an axis in the configuration."""
        return list((await self.status()).axes)[int(axis) - 1]

    async def limits(self, axis: str) -> AxisFacts:
        """Return the limits of an axis; at most 1 s old.

        Raises:
            GcsRefusal: If the configuration has no range of commands.
        """
        name = await self.name_of(axis)
        facts = (await self.mirror.facts(_LIMITS_AGE_S))[name]
        if not facts.has_range:
            raise GcsRefusal(Code.NOT_ALLOWED, f"axis {name} has no command_range_um")
        return facts

    def servo_on(self, state: str, axis: AxisStatus) -> bool:
        """Return whether an axis follows its command in the mode of this server."""
        return state == State.RUN and axis.mode == self._mode

    def moving(self, state: str, axis: AxisStatus) -> bool:
        """Return whether a movement goes on, until the axis has arrived."""
        return state == State.RUN and not has_arrived(state, axis, has_sensor=axis.has_sensor)
