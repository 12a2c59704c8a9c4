"""The stage that tables are played on, as the procedures see it."""

from typing import NamedTuple, Protocol

from piezod.devices.interface import Identity
from piezod.devices.played_axis import AxisPlayRecord, AxisTable


class AtRest(NamedTuple):
    """An axis at rest."""

    t_s: float  #: Present time of the stage, in s.
    drive_v: float  #: Voltage at which a table begins, in V.


class PlayedStage(Protocol):
    """An axis that plays tables; a virtual or a running one."""

    def rest(self) -> AtRest:
        """Bring the axis to rest.

        Raises:
            PiezodError: If that failed.
        """
        ...

    def play(self, table: AxisTable) -> AxisPlayRecord:
        """Play a table and return its record, relative to the zero of the sensor.

        The guard of tables checks the table before it is loaded. Afterwards the last value of the
        table is in force, or the value at which the play was stopped.

        Raises:
            DataError: If the guard refuses the table.
            DeviceError: If the device refuses it, fails, or its record could not be read.
        """
        ...


class IdentifiedStage(PlayedStage, Protocol):
    """An axis of a device that says which one it is."""

    @property
    def identity(self) -> Identity:
        """Identity of the device, known after the first play."""
        ...


__all__ = ["AtRest", "AxisPlayRecord", "AxisTable", "IdentifiedStage", "Identity", "PlayedStage"]
