"""What a device tells of its own health, beside its samples and its acknowledgements."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final, Protocol, TypeAlias, runtime_checkable


class DeviceFlag(StrEnum):
    """Something that a device says is the matter with a channel."""

    OVERLOAD = "overload"
    OVER_TEMPERATURE = "over-temperature"
    LOCAL_MODE = "local mode"
    WATCHDOG_TRIPPED = "watchdog tripped"
    SHORT_OR_OPEN = "short or open"
    RESTARTED = "restarted"
    LOW_LIGHT = "low light"
    SATURATED = "saturated"


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
