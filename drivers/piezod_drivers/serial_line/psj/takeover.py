"""How control is taken of an amplifier of piezosystem jena without a jump of its voltage."""

from collections.abc import Sequence
from typing import Protocol

from piezod.devices.bus.conversation import LengthOf
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.models import Model


class Asks(Protocol):
    """What of a `PsjDialogue` is needed here; every method raises `LineFault` where it fails."""

    def ask(self, request: bytes, length_of: LengthOf | None = None) -> str:
        """Return the text of an answer."""
        ...

    def ask_values(
        self, name: str, channel: int | None, count: int, length_of: LengthOf | None = None
    ) -> list[str]:
        """Return as many values as the answer must tell."""
        ...

    def tell(self, request: bytes) -> None:
        """Send what is not answered."""
        ...


def take_over(model: Model, outputs: Sequence[int], device: Asks) -> None:
    """Put the outputs under remote control, in open loop.

    Where the device's own loop is closed, or its setpoint comes from elsewhere, nothing is changed:
    its voltage would jump. An NV40/3 that reads positions keeps the setpoint that it had, which
    nobody can ask for; an NV40/1 cannot be asked for its loop, and is put in open loop.

    Args:
        model: Which model it is.
        outputs: Numbers of the channels.
        device: The device.

    Raises:
        DeviceError: If control cannot be taken without a jump; it says what is to be done.
        LineFault: If an exchange fails.
    """
    for channel in outputs:
        match model.title:
            case "d-Drive" | "30DV50/300":
                _d_drive(channel, device)
            case "NV200/D":
                _nv200(device)
            case "NV40/3":
                _nv40(model, channel, device)
            case "NV40/1 CL":
                _nv40_1(model, device)


def _d_drive(channel: int, device: Asks) -> None:
    status = codec.word(device.ask_values("stat", channel, 1)[0], 10)
    _refuse_if(bool(status & 1 << 7), f"channel {channel} is in closed loop", f"cl,{channel},0")
    modulated = device.ask_values("modon", channel, 1, codec.ended_by_cr)[0] != "0"
    _refuse_if(modulated, f"channel {channel} adds its modulation input", f"modon,{channel},0")


def _nv200(device: Asks) -> None:
    _refuse_if(device.ask_values("cl", None, 1)[0] != "0", "it is in closed loop", "cl,0")
    source = device.ask_values("modsrc", None, 1)[0]
    _refuse_if(source != "0", f"its setpoint comes from source {source}", "modsrc,0")


def _nv40(model: Model, channel: int, device: Asks) -> None:
    if model.reads == "position":
        closed = device.ask_values("cloop", channel, 1)[0] != "0"
        _refuse_if(closed, f"channel {channel} is in closed loop", f"cloop,{channel},0")
        device.ask(codec.command(model, "setk", channel, 1))
        return
    drive_v = codec.number(device.ask_values(model.read, channel, 1)[0])
    device.ask(codec.command(model, "setk", channel, 1))
    device.ask(codec.command(model, model.set, channel, drive_v))


def _nv40_1(model: Model, device: Asks) -> None:
    drive_v = codec.number(device.ask_values(model.read, None, 1)[0])
    for name, values in (("i1", ()), ("ol", ()), (model.set, (drive_v,))):
        device.tell(codec.command(model, name, None, *values))


def _refuse_if(hindered: bool, what: str, remedy: str) -> None:
    if hindered:
        how = f"bring its voltage to rest and send {remedy}, or use its front panel"
        raise DeviceError(f"control is not taken, {what} and its voltage may jump: {how}")
