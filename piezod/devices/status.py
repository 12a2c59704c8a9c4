"""What a device tells of its own health, beside its samples and its acknowledgements."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final, Protocol, TypeAlias, runtime_checkable


class DeviceFlag(StrEnum):
    """Something that a device says is the matter with a channel."""

    OVERLOAD = "overload"
    """The amplifier gives less than it should, its current being limited."""
    OVER_TEMPERATURE = "over-temperature"
    """The amplifier is too hot."""
    LOCAL_MODE = "local mode"
    """The amplifier does not obey: somebody else does, or it is disabled."""
    WATCHDOG_TRIPPED = "watchdog tripped"
    """The amplifier has waited too long for the host, and went to its own safe state."""
    SHORT_OR_OPEN = "short or open"
    """The actuator is shorted, or is not there."""
    RESTARTED = "restarted"
    """The amplifier was switched off and on again; never said of a sensor."""
    LOW_LIGHT = "low light"
    """The sensor has not enough light: what it shows is not to be trusted."""
    SATURATED = "saturated"
    """The sensor is at the end of its converter's range."""


Flags: TypeAlias = frozenset[DeviceFlag]
"""All that is the matter with a channel at an instant."""

NO_FLAGS: Final[Flags] = frozenset()
"""Nothing is."""


@runtime_checkable
class TellsStatus(Protocol):
    """A device that tells its status; one that does not simply has no such method."""

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what is the matter with each axis, in the order of `Capabilities.axes`.

        May be called in the loop, after the `read` or `write` of the same instant; a device that
        has to ask for its status answers with what it knew last.

        Raises:
            DeviceError: If the device is not open.
        """
        ...
