"""Status and limits of the stage, shared by all connections."""

import asyncio
import time
from typing import Final, NamedTuple

from piezod.client.arrival import SAME_UM
from piezod.client.results import AxisStatus, Document, Status
from piezod.config.daemon import StageAxisConfig
from piezod.config.states import State
from piezod.gcs.errors import Code, GcsRefusal
from piezod.gcs.link import DaemonLink

STATUS_AGE_S: Final = 0.04
"""Age from which a status is asked again, in s: half of the daemon's limit of 50 requests per s."""
_LIMITS_AGE_S: Final = 1.0
UP: Final = (State.SAFE, State.READY, State.RUN, State.HOLD)
"""States in which the controller reports that it is ready for commands."""


class AxisLimits(NamedTuple):
    """Limits of an axis.

    Attributes:
        low_um: Lowest position, in µm.
        high_um: Highest position, in µm.
        speed_um_per_s: Largest speed, in µm/s.
    """

    low_um: float
    high_um: float
    speed_um_per_s: float


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
                self._limits = _limits_in(await self._link.config())
        if name not in self._limits:
            raise GcsRefusal(Code.NOT_ALLOWED, f"axis {name} has no command_range_um")
        return self._limits[name]

    def servo_on(self, state: str, axis: AxisStatus) -> bool:
        """Return whether an axis follows its command in the mode of this server."""
        return state == State.RUN and axis.mode == self._mode

    @staticmethod
    def on_target(state: str, axis: AxisStatus) -> bool:
        """Return whether an axis has arrived: without a sensor, its command has."""
        if axis.has_sensor:
            return axis.on_target
        target_um, command_um = axis.target_um, axis.command_um
        if state != State.RUN or target_um is None or command_um is None:
            return False
        return abs(target_um - command_um) <= SAME_UM

    def moving(self, state: str, axis: AxisStatus) -> bool:
        """Return whether a movement goes on, until the axis has arrived."""
        return state == State.RUN and not self.on_target(state, axis)


def _limits_in(config: Document) -> dict[str, AxisLimits]:
    """Return the limits of the axes that have a range of commands, by the names of the axes."""
    default_um_per_s = StageAxisConfig.model_fields["speed_um_per_s"].default
    limits = {}
    for name, axis in config["axes"].items():
        if range_um := axis.get("command_range_um"):
            low_um, high_um = range_um
            fastest_um_per_s = axis.get("speed_um_per_s", default_um_per_s)
            limits[name] = AxisLimits(low_um, high_um, fastest_um_per_s)
    return limits
