"""The models of piezosystem jena's amplifiers, as data."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeAlias

from piezod.devices.status import DeviceFlag

ProfileName: TypeAlias = Literal["ddrive", "30dv", "nv40", "nv40-1", "nv200"]
ReadingUse: TypeAlias = Literal["nothing", "position", "voltage"]


class StatusBits(NamedTuple):
    """A fault in a status word."""

    mask: int  #: Bits of the fault.
    present: bool  #: Whether the fault is present if one of these bits is set, or if none is.
    flag: DeviceFlag  #: The fault.


class PsjProfile(NamedTuple):
    """A model, as it appears on the line."""

    title: str  #: Name of the model for people.
    #: Possible beginnings of the reply to an empty command; another model is refused.
    greetings: tuple[str, ...]
    baud: int  #: Default bit rate, in bit/s.
    read: str  #: Command that reads a channel.
    reads: ReadingUse  #: Meaning of this reading in open loop, according to the public sources.
    set: str = "set"  #: Command that sets a voltage, in V in open loop.
    ending: bytes = b"\r"  #: End of a command.
    frames: bool = True  #: Whether each reply ends with XON; else it is a line.
    channels: int = 1  #: Highest number of channels.
    numbered: bool = False  #: Whether commands name the channel.
    acknowledges: bool = True  #: Whether a setpoint has a reply.
    #: Whether the command `set` without a value returns the setpoint.
    reports_setpoint: bool = False
    refresh_s: float = 0.0  #: Highest age of a reading, in s.
    status: str = ""  #: Command that reads the status, "" for none.
    status_bits: tuple[StatusBits, ...] = ()  #: Meaning of the status.
    status_per_channel: bool = True  #: Whether the status is read channel by channel.
    serial: str = ""  #: Command that reads a serial number or the actuator's identity; "" for none.
    #: Commands that read the lowest and the highest voltage, if there are any.
    limits: tuple[str, str] | None = None
    limits_per_channel: bool = True  #: Whether these commands name the channel.
    #: Command that reads whether the port sets the voltage of a channel; "" for none.
    source: str = ""
    plays: bool = False  #: Whether the model has a waveform generator and a data recorder.


_D_DRIVE_BITS: Final = (
    StatusBits(1 << 0, False, DeviceFlag.SHORT_OR_OPEN),  # no actuator is plugged in
    StatusBits(1 << 6, False, DeviceFlag.LOCAL_MODE),  # the high voltage is not enabled
    StatusBits(1 << 7, True, DeviceFlag.LOCAL_MODE),  # the device's own loop was closed
    StatusBits(0b111 << 9, True, DeviceFlag.LOCAL_MODE),  # its generator runs
)
_NV40_BITS: Final = (
    StatusBits(0x0003, True, DeviceFlag.SHORT_OR_OPEN),  # not plugged in; shorted
    StatusBits(0x0010, True, DeviceFlag.DEVICE_FAILURE),  # memory failure
    StatusBits(0x3000, True, DeviceFlag.OVERLOAD),  # under-load, overload
    StatusBits(0x4000, True, DeviceFlag.OTHER_DEVICE),  # not the actuator it is configured for
    StatusBits(0x8000, True, DeviceFlag.OVER_TEMPERATURE),
)
_NV200_BITS: Final = (
    StatusBits(1 << 0, False, DeviceFlag.SHORT_OR_OPEN),
    StatusBits(1 << 3, True, DeviceFlag.LOCAL_MODE),  # the device's own loop was closed
    StatusBits(1 << 10, True, DeviceFlag.OVER_TEMPERATURE),
    StatusBits(1 << 11, True, DeviceFlag.SHORT_OR_OPEN),  # actuator error
    StatusBits(0b11 << 12, True, DeviceFlag.DEVICE_FAILURE),  # hardware, I2C
)

_D_DRIVE: Final = PsjProfile(
    title="d-Drive",
    greetings=("DSM V",),
    baud=115_200,
    read="mess",
    reads="nothing",
    ending=b"\r\n",
    channels=6,
    numbered=True,
    refresh_s=0.5,
    status="stat",
    status_bits=_D_DRIVE_BITS,
    serial="acdescr",
)

PROFILES: Final[Mapping[ProfileName, PsjProfile]] = MappingProxyType(
    {
        "ddrive": _D_DRIVE,
        "30dv": _D_DRIVE._replace(
            title="30DV50/300", greetings=("AP V",), channels=1, numbered=False
        ),
        "nv40": PsjProfile(
            title="NV40/3",
            greetings=("NV403CLE>", "NV403>"),
            baud=19_200,
            read="rk",
            reads="position",
            channels=3,
            numbered=True,
            status="ERROR",
            status_bits=_NV40_BITS,
            status_per_channel=False,
            serial="ver",
            limits=("dspvmin", "dspvmax"),
            limits_per_channel=False,
            source="stat",
        ),
        "nv40-1": PsjProfile(
            title="NV40/1 CL",
            greetings=("NV40",),
            baud=9600,
            read="rd",
            reads="voltage",
            set="wr",
            frames=False,
            acknowledges=False,
        ),
        "nv200": PsjProfile(
            title="NV200/D",
            greetings=("NV200",),
            baud=115_200,
            read="meas",
            reads="position",
            reports_setpoint=True,
            status="stat",
            status_bits=_NV200_BITS,
            serial="acserno",
            limits=("avmin", "avmax"),
            plays=True,
        ),
    }
)


def channel_names(model: PsjProfile) -> tuple[str, ...]:
    """Return the names of a model's channels: ch0, ch1, …, numbered as in its commands."""
    return tuple(f"ch{number}" for number in range(model.channels))
