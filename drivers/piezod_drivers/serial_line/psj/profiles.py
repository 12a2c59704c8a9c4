"""How the models of piezosystem jena's amplifiers differ."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal, NamedTuple, TypeAlias

from piezod.devices.status import DeviceFlag

Profile: TypeAlias = Literal["ddrive", "30dv", "nv40", "nv40-1", "nv200"]
Reads: TypeAlias = Literal["nothing", "position", "voltage"]


class Bits(NamedTuple):
    """What some bits of a status word mean.

    Attributes:
        mask: The bits.
        present: Whether it is meant by one of them that is set, or by none.
        flag: What is told of it.
    """

    mask: int
    present: bool
    flag: DeviceFlag


class PsjModel(NamedTuple):
    """A model, as seen from the wire.

    Attributes:
        title: Its name for people.
        greetings: How the answer to an empty command begins; that of another model is refused.
        baud: Bits per second unless set otherwise.
        read: The command that reads a channel.
        reads: What that tells in open loop, as far as the public sources say.
        set: The command that sets a voltage, in V in open loop.
        ending: What ends a command.
        frames: Whether every answer ends with XON; else it is a line.
        channels: How many there may be.
        numbered: Whether commands name the channel.
        acknowledges: Whether a setpoint is answered.
        tells_setpoint: Whether the command that sets, without a value, tells the setpoint.
        refresh_s: How old what is read may be, in s.
        status: The command that tells the status, "" for none.
        status_bits: What it means.
        status_per_channel: Whether it is asked channel by channel.
        serial: The command that tells a serial number, or what actuator is there; "" for none.
        limits: The commands that tell the lowest and the highest voltage, if there are any.
    """

    title: str
    greetings: tuple[str, ...]
    baud: int
    read: str
    reads: Reads
    set: str = "set"
    ending: bytes = b"\r"
    frames: bool = True
    channels: int = 1
    numbered: bool = False
    acknowledges: bool = True
    tells_setpoint: bool = False
    refresh_s: float = 0.0
    status: str = ""
    status_bits: tuple[Bits, ...] = ()
    status_per_channel: bool = True
    serial: str = ""
    limits: tuple[str, str] | None = None


_D_DRIVE_BITS: Final = (
    Bits(1 << 0, False, DeviceFlag.SHORT_OR_OPEN),  # no actuator is plugged in
    Bits(1 << 6, False, DeviceFlag.LOCAL_MODE),  # the high voltage is not enabled
    Bits(1 << 7, True, DeviceFlag.LOCAL_MODE),  # somebody has closed the device's own loop
    Bits(0b111 << 9, True, DeviceFlag.LOCAL_MODE),  # its generator runs
)
_NV40_BITS: Final = (
    Bits(0x0003, True, DeviceFlag.SHORT_OR_OPEN),  # not plugged in; shorted
    Bits(0x0010, True, DeviceFlag.DEVICE_FAILURE),  # its memory
    Bits(0x3000, True, DeviceFlag.OVERLOAD),  # under-load, overload
    Bits(0x4000, True, DeviceFlag.OTHER_DEVICE),  # another actuator than it is set up for
    Bits(0x8000, True, DeviceFlag.OVER_TEMPERATURE),
)
_NV200_BITS: Final = (
    Bits(1 << 0, False, DeviceFlag.SHORT_OR_OPEN),
    Bits(1 << 3, True, DeviceFlag.LOCAL_MODE),  # somebody has closed the device's own loop
    Bits(1 << 10, True, DeviceFlag.OVER_TEMPERATURE),
    Bits(1 << 11, True, DeviceFlag.SHORT_OR_OPEN),  # actuator error
    Bits(0b11 << 12, True, DeviceFlag.DEVICE_FAILURE),  # hardware, I2C
)

_D_DRIVE: Final = PsjModel(
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

MODELS: Final[Mapping[Profile, PsjModel]] = MappingProxyType(
    {
        "ddrive": _D_DRIVE,
        "30dv": _D_DRIVE._replace(
            title="30DV50/300", greetings=("AP V",), channels=1, numbered=False
        ),
        "nv40": PsjModel(
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
        ),
        "nv40-1": PsjModel(
            title="NV40/1 CL",
            greetings=("NV40",),
            baud=9600,
            read="rd",
            reads="voltage",
            set="wr",
            frames=False,
            acknowledges=False,
        ),
        "nv200": PsjModel(
            title="NV200/D",
            greetings=("NV200",),
            baud=115_200,
            read="meas",
            reads="position",
            tells_setpoint=True,
            status="stat",
            status_bits=_NV200_BITS,
            serial="acserno",
            limits=("avmin", "avmax"),
        ),
    }
)


def channel_names(model: PsjModel) -> tuple[str, ...]:
    """Return the names of a model's channels: ch0, ch1, …, numbered as its commands number them."""
    return tuple(f"ch{number}" for number in range(model.channels))
