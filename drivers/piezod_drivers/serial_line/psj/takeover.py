"""How control is taken of an amplifier of piezosystem jena without a jump of its voltage."""

from collections.abc import Sequence

from piezod.devices.bus.line import LineFault
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjModel
from piezod_drivers.serial_line.psj.session import PsjSession


def take_over(model: PsjModel, outputs: Sequence[int], talk: PsjSession, *, remote: bool) -> None:
    """Make sure that the outputs are under remote control, in open loop; nothing is changed.

    Where the device's own loop is closed, or its setpoint comes from elsewhere, its voltage would
    jump. An NV40 does not tell who sets its voltage, nor which setpoint waits for the moment in
    which the port does: somebody has to say that this moment has passed.

    Args:
        model: Which model it is.
        outputs: Numbers of the channels.
        talk: To the device.
        remote: Whether an NV40 is under remote control, as somebody says.

    Raises:
        DeviceError: If control cannot be taken without a jump; it says what is to be done.
        LineFault: If an exchange fails.
    """
    for channel in outputs:
        match model.title:
            case "d-Drive" | "30DV50/300":
                _d_drive(channel, talk)
            case "NV200/D":
                _nv200(talk)
            case "NV40/3":
                _nv40(channel, talk, remote=remote)
            case "NV40/1 CL":
                what = "nobody has said that it is under remote control and in open loop"
                _refuse_if(not remote, what, "i1 and ol, then set `remote: true`")


def _d_drive(channel: int, talk: PsjSession) -> None:
    status = codec.word(talk.value("stat", channel), 10)
    _refuse_if(bool(status & 1 << 7), f"channel {channel} is in closed loop", f"cl,{channel},0")
    modulated = talk.values("modon", channel, 1, codec.ended_by_cr)[0] != "0"
    _refuse_if(modulated, f"channel {channel} adds its modulation input", f"modon,{channel},0")


def _nv200(talk: PsjSession) -> None:
    _refuse_if(talk.value("cl") != "0", "it is in closed loop", "cl,0")
    source = talk.value("modsrc")
    _refuse_if(source != "0", f"its setpoint comes from source {source}", "modsrc,0")


def _nv40(channel: int, talk: PsjSession, *, remote: bool) -> None:
    closed = _nv40_is_closed(channel, talk)
    _refuse_if(closed, f"channel {channel} is in closed loop", f"cloop,{channel},0")
    what = f"nobody has said that channel {channel} is under remote control"
    _refuse_if(not remote, what, f"setk,{channel},1, then set `remote: true`")


def _nv40_is_closed(channel: int, talk: PsjSession) -> bool:
    """Tell whether the device's own loop is closed; one without CLE has none, nor the command.

    What its reading is used for here does not say which of them it is. Any other refusal tells
    nothing of a loop.
    """
    try:
        return talk.value("cloop", channel) != "0"
    except LineFault as fault:
        if not str(fault).endswith(codec.UNKNOWN_NV40):
            raise
        return False


def _refuse_if(hindered: bool, what: str, remedy: str) -> None:
    if hindered:
        how = f"bring its voltage to rest and send {remedy}, or use its front panel"
        raise DeviceError(f"control is not taken, {what} and its voltage may jump: {how}")
