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
    OTHER_DEVICE = "other device"
    """What came back is another device than the one that was opened first."""
    PARTIAL_WRITE = "partial write"
    """Only a part of a request went out."""
    DISCONNECTED = "disconnected"
    """The connection is gone: every call fails until the device is opened again."""
    OTHER_PATH = "other path"
    """The device came back under another path."""
    GARBAGE = "garbage"
    """Bytes came that are no frame."""
    BAD_CHECKSUM = "bad checksum"
    """A frame came whose checksum is wrong."""
    LATE_REPLY = "late reply"
    """No reply came in time, or one that belongs to an earlier request."""
    OUT_OF_ORDER = "out of order"
    """A frame came twice, or in the wrong order."""
    SLOW_REPLY = "slow reply"
    """A reply took more than most of the time there is for it."""
    BUS_OFF = "bus off"
    """The CAN controller has left the bus."""
    NOT_SENT = "not sent"
    """A frame could not be sent: the transmit queue is full."""
    WRONG_REQUEST = "wrong request"
    """The device says that it has no such register or command: the configuration is wrong."""
    DEVICE_FAILURE = "device failure"
    """The device says that it has failed."""
    BUSY = "busy"
    """The device, or a gateway before it, says that it is busy or cannot be reached."""
    BUS_OVERLOADED = "bus overloaded"
    """More comes than can be read in time."""
    FOREIGN_FRAME = "foreign frame"
    """Somebody else sends under our name, or answers in the device's place."""
    HALF_OPEN = "half open"
    """The connection stands, and nothing is acknowledged."""
    PORT_SHARED = "port shared"
    """Another program uses the port."""
    STUCK = "stuck"
    """The thread that does the device's input and output does not answer."""


PASSING: Final = frozenset(
    {
        DeviceFlag.PARTIAL_WRITE,
        DeviceFlag.GARBAGE,
        DeviceFlag.BAD_CHECKSUM,
        DeviceFlag.LATE_REPLY,
        DeviceFlag.OUT_OF_ORDER,
        DeviceFlag.SLOW_REPLY,
        DeviceFlag.NOT_SENT,
        DeviceFlag.BUSY,
        DeviceFlag.BUS_OVERLOADED,
        DeviceFlag.RESTARTED,
    }
)
"""What happens in an exchange, and is over with it; all else lasts until it is told to be gone."""

Flags: TypeAlias = frozenset[DeviceFlag]
"""All that is the matter with a channel at an instant."""

NO_FLAGS: Final[Flags] = frozenset()
"""Nothing is."""


@runtime_checkable
class TellsStatus(Protocol):
    """A device that tells its status; one that does not simply has no such method."""

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Tell what is the matter with each channel: the inputs, then the outputs.

        The order is that of `Capabilities.inputs` and `Capabilities.outputs`; a channel that is
        both is told twice. What happened in exchanges since the last call is told once, what lasts
        as long as it does.

        May be called in the loop, after the `read` or `write` of the same instant; a device that
        has to ask for its status answers with what it knew last.

        Raises:
            DeviceError: If the device is not open.
        """
        ...
