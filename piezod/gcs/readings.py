"""The axes of the stage with the identifiers of GCS; shared by all connections."""

from typing import Final, NamedTuple

from piezod.client.arrival import has_arrived
from piezod.client.facts import AxisFacts
from piezod.client.mirror import StageMirror
from piezod.config.states import State
from piezod.gcs.errors import Code, GcsRefusal
from piezod.messages.answers import AxisStatus

STATUS_AGE_S: Final = 0.04
"""Age from which a status is asked again, in s: half of the daemon's limit of 50 requests per s."""
_FACTS_AGE_S: Final = 1.0
UP: Final = (State.SAFE, State.READY, State.RUN, State.HOLD)
"""States in which the controller reports that it is ready for commands."""


class AxisNow(NamedTuple):
    """An axis in the newest status; what it does not know raises GcsRefusal."""

    name: str  #: Name in the configuration.
    state: str  #: State of the stage.
    status: AxisStatus  #: Status of the axis.
    facts: AxisFacts  #: What the configuration says about it.
    mode: str  #: The mode in which an axis counts as servo-controlled.

    @property
    def measured_um(self) -> float:
        """Measured position, in µm; of an axis without a sensor the command, the best estimate."""
        has_sensor = self.status.has_sensor
        position_um = self.status.position_um if has_sensor else self.status.command_um
        if position_um is None:
            why = "the sensor has no valid sample" if has_sensor else "the axis has no sensor"
            raise GcsRefusal(Code.INVALID_SENSOR_SIGNAL, why)
        return position_um

    @property
    def target_um(self) -> float:
        """Target, in µm: without one the command, else the measured position."""
        status = self.status
        target_um = status.command_um if status.target_um is None else status.target_um
        # A disarmed stage has no command, and a client without a reply to `MOV?` would wait for it.
        return self.measured_um if target_um is None else target_um

    @property
    def drive_v(self) -> float:
        """Drive voltage, in V."""
        if self.status.drive_v is None:
            raise GcsRefusal(Code.NO_CONNECTION, "the voltage in force is unknown")
        return self.status.drive_v

    @property
    def arrived(self) -> bool:
        """Whether the axis has arrived."""
        return has_arrived(self.state, self.status, has_sensor=self.status.has_sensor)

    @property
    def servo_on(self) -> bool:
        """Whether the axis follows its command in the mode of this server."""
        return self.state == State.RUN and self.status.mode == self.mode

    @property
    def moving(self) -> bool:
        """Whether a movement goes on, until the axis has arrived."""
        return self.state == State.RUN and not self.arrived

    @property
    def limits(self) -> AxisFacts:
        """Its limits; refused if the configuration has no range of commands."""
        if not self.facts.has_range:
            raise GcsRefusal(Code.NOT_ALLOWED, f"axis {self.name} has no command_range_um")
        return self.facts


class Readings:
    """The newest status and limits.

    The axes have the identifiers 1, 2, … in the order of the configuration.

    Args:
        mirror: The stage.
        mode: The mode in which an axis counts as servo-controlled.
    """

    def __init__(self, mirror: StageMirror, mode: str) -> None:
        self.mirror, self._mode = mirror, mode

    async def state(self) -> str:
        """Return the state; at most `STATUS_AGE_S` old, and newer than the last command.

        Raises:
            ClientError: If the daemon does not answer.
        """
        return (await self.mirror.status(STATUS_AGE_S)).state

    async def axes(self) -> dict[str, AxisNow]:
        """Return each axis by its identifier, of the same age; limits are at most 1 s old.

        Raises:
            ClientError: If the daemon does not answer.
        """
        status = await self.mirror.status(STATUS_AGE_S)
        facts = await self.mirror.facts(_FACTS_AGE_S)
        return {
            str(i): AxisNow(name, status.state, axis, facts[name], self._mode)
            for i, (name, axis) in enumerate(status.axes.items(), 1)
        }
