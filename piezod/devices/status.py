"""Status that a device reports about its own health, besides samples and acknowledgements."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Final, Protocol, TypeAlias, runtime_checkable


class DeviceFlag(StrEnum):
    """A problem that a device reports for a channel."""

    OVERLOAD = "overload"
    """The amplifier limits its current and gives less than requested."""
    OVER_TEMPERATURE = "over-temperature"
    """The amplifier is too hot."""
    LOCAL_MODE = "local mode"
    """The amplifier does not follow writes: another control source is active, or it is disabled."""
    WATCHDOG_TRIPPED = "watchdog tripped"
    """The amplifier has waited too long for the host and has gone to its own safe state."""
    SHORT_OR_OPEN = "short or open"
    """The actuator is shorted or not connected."""
    RESTARTED = "restarted"
    """The amplifier was switched off and on again; never reported for a sensor."""
    LOW_LIGHT = "low light"
    """The sensor has too little light: its value is not reliable."""
    SATURATED = "saturated"
    """The sensor is at the end of its converter's range."""
    OTHER_DEVICE = "other device"
    """The device that was opened is not the one that was opened first."""
    PARTIAL_WRITE = "partial write"
    """Only a part of a request was sent."""
    DISCONNECTED = "disconnected"
    """The connection is lost: every call fails until the device is opened again."""
    OTHER_PATH = "other path"
    """The device was opened again under another path."""
    GARBAGE = "garbage"
    """Received bytes are not a frame."""
    BAD_CHECKSUM = "bad checksum"
    """A received frame has a wrong checksum."""
    LATE_REPLY = "late reply"
    """No reply came in time, or the reply of an earlier request came."""
    OUT_OF_ORDER = "out of order"
    """A frame came twice, or in the wrong order."""
    SLOW_REPLY = "slow reply"
    """A reply took most of its time-out."""
    BUS_OFF = "bus off"
    """The CAN controller has left the bus."""
    NOT_SENT = "not sent"
    """A frame could not be sent: the transmit queue is full."""
    WRONG_REQUEST = "wrong request"
    """The device reports an unknown register or command: the configuration is wrong."""
    DEVICE_FAILURE = "device failure"
    """The device reports an internal failure."""
    BUSY = "busy"
    """The device, or a gateway in front of it, reports that it is busy or unreachable."""
    BUS_OVERLOADED = "bus overloaded"
    """More frames arrive than can be read in time."""
    FOREIGN_FRAME = "foreign frame"
    """Another node sends with our identifier, or answers in place of the device."""
    HALF_OPEN = "half open"
    """The connection exists, but the peer acknowledges nothing."""
    PORT_SHARED = "port shared"
    """Another program uses the port."""
    STUCK = "stuck"
    """The thread that does the device's I/O does not answer."""


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
"""Flags of a single exchange; every other flag lasts until the device reports its end."""

MOVED: Final = frozenset({DeviceFlag.LOCAL_MODE, DeviceFlag.RESTARTED, DeviceFlag.WATCHDOG_TRIPPED})
"""Flags of an output that something else than a write has changed, or may change."""

Flags: TypeAlias = frozenset[DeviceFlag]
"""All problems of a channel at an instant."""

NO_FLAGS: Final[Flags] = frozenset()
"""No problem."""
SATURATED: Final[Flags] = frozenset({DeviceFlag.SATURATED})
"""An input at the end of its range."""


@runtime_checkable
class TellsStatus(Protocol):
    """A device that reports its status; a device without status lacks this method."""

    def status(self, now_ns: int) -> Sequence[Flags]:
        """Return the flags of each channel: the inputs, then the outputs. Real-time safe.

        The order is that of `Capabilities.inputs` and `Capabilities.outputs`; a channel that is
        both appears twice. A flag of an exchange is reported once, by the next call; a lasting flag
        is reported while it lasts.

        Call it after the `read` or `write` of the same instant. A device that must be polled for
        its status returns the last known status.

        Raises:
            DeviceError: If the device is not open.
        """
        ...
