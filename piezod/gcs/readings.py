"""Status and limits of the stage, shared by all connections."""

import asyncio
import time
from typing import Final

from piezod.client.arrival import has_arrived
from piezod.client.daemon_link import DaemonLink
from piezod.client.limits import AxisLimits, limits_in
from piezod.config.states import State
from piezod.gcs.errors import Code, GcsRefusal
from piezod.messages.answers import AxisStatus, Status

STATUS_AGE_S: Final = 0.04
"""Age from which a status is asked again, in s: half of the daemon's limit of 50 requests per s."""
_LIMITS_AGE_S: Final = 1.0
UP: Final = (State.SAFE, State.READY, State.RUN, State.HOLD)
"""States in which the controller reports that it is ready for commands."""


class Readings:
    """The newest status and limits.

    The axes have the identifiers 1, 2, … in the order of the configuration.

    Args:
        link: Connection to the daemon.
        mode: The mode in which an axis counts as servo-controlled.

    Attributes:
        newest_state: State in the newest status; empty if a command has changed it since.
    """

    def __init__(self, link: DaemonLink, mode: str) -> None:
        self._link, self._mode = link, mode
        self._asking = asyncio.Lock()
        self._status: Status | None = None
        self._status_s = self._limits_s = 0.0
        self._limits: dict[str, AxisLimits] = {}
        self.newest_state = ""

    def expire(self) -> None:
        """Do not use the present status again: a command has changed it."""
        self._status, self.newest_state = None, ""

    async def status(self) -> Status:
        """Return the status; at most `STATUS_AGE_S` old, and newer than the last command.

        Raises:
            ClientError: If the daemon does not answer.
        """
        async with self._asking:
            status = self._status
            if status is None or time.monotonic() - self._status_s > STATUS_AGE_S:
                self._status_s, self._status = time.monotonic(), None
                status = await self._link.status()
                self._status, self.newest_state = status, status.state
            return status

    async def axes(self) -> dict[str, AxisStatus]:
        """Return the status of each axis by its identifier.

        Raises:
            ClientError: If the daemon does not answer.
        """
        status = await self.status()
        return {str(i): axis for i, axis in enumerate(status.axes.values(), 1)}

    async def name_of(self, axis: str) -> str:
        """Return the name of an axis in the configuration.

        Raises:
            ClientError: If the daemon does not answer.
        """
        return list((await self.status()).axes)[int(axis) - 1]

    async def limits(self, axis: str) -> AxisLimits:
        """Return the limits of an axis; at most 1 s old.

        Raises:
            ClientError: If the daemon does not answer.
            GcsRefusal: If the configuration has no range of commands.
        """
        name = await self.name_of(axis)
        async with self._asking:
            if name not in self._limits or time.monotonic() - self._limits_s > _LIMITS_AGE_S:
                self._limits_s = time.monotonic()
                self._limits = limits_in(await self._link.config())
        if name not in self._limits:
            raise GcsRefusal(Code.NOT_ALLOWED, f"axis {name} has no command_range_um")
        return self._limits[name]

    def servo_on(self, state: str, axis: AxisStatus) -> bool:
        """Return whether an axis follows its command in the mode of this server."""
        return state == State.RUN and axis.mode == self._mode

    def moving(self, state: str, axis: AxisStatus) -> bool:
        """Return whether a movement goes on, until the axis has arrived."""
        return state == State.RUN and not has_arrived(state, axis)
