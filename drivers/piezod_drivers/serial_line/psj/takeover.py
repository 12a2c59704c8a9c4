"""Checks whether control of an amplifier can be taken without a jump of its voltage."""

from collections.abc import Callable, Sequence

from piezod.devices.bus.line import LineFault
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjProfile
from piezod_drivers.serial_line.psj.session import PsjSession


def take_over(
    profile: PsjProfile, outputs: Sequence[int], session: PsjSession, *, remote: bool
) -> bool:
    """Check that the outputs are under remote control, in open loop; nothing is changed.

    If the device's own loop is closed, or its setpoint has another source, its voltage would jump.
    An NV40 does not report which setpoint takes effect when the port becomes the source of its
    voltage, and some do not report the source either: then the configuration has to confirm that
    the port is the source already.

    Args:
        profile: The model.
        outputs: Numbers of the channels.
        session: The exchanges with the device.
        remote: Whether the configuration confirms that an NV40 is under remote control.

    Returns:
        Whether the device reports which source sets the voltage of a channel.

    Raises:
        DeviceError: If control cannot be taken without a jump; the text has the remedy.
        LineFault: If an exchange fails.
    """
    reports_source = False
    for channel in outputs:
        match profile.title:
            case "d-Drive" | "30DV50/300":
                _d_drive(channel, session)
            case "NV200/D":
                _nv200(session)
            case "NV40/3":
                reports_source = _nv40(channel, session, remote=remote)
            case "NV40/1 CL":
                what = "its remote control and open loop are not confirmed"
                _require_not(not remote, what, "i1 and ol, then set `remote: true`")
    return reports_source


def _d_drive(channel: int, session: PsjSession) -> None:
    status = codec.word(session.value("stat", channel), 10)
    _require_not(bool(status & 1 << 7), f"channel {channel} is in closed loop", f"cl,{channel},0")
    # The reply to `modon` ends with CR only.
    modulated = session.values("modon", channel, 1, codec.ended_by_cr)[0] != "0"
    _require_not(modulated, f"channel {channel} adds its modulation input", f"modon,{channel},0")


def _nv200(session: PsjSession) -> None:
    # In closed loop the setpoint is a position, and `set` would drive another quantity.
    _require_not(session.value("cl") != "0", "it is in closed loop", "cl,0")
    source = session.value("modsrc")
    _require_not(source != "0", f"its setpoint comes from source {source}", "modsrc,0")


def _nv40(channel: int, session: PsjSession, *, remote: bool) -> bool:
    """Check one channel; return whether the device reports the source of its voltage."""
    # A device without CLE has no loop, and does not know the command. The configured use of its
    # reading does not reveal whether it has CLE.
    closed = _if_known(lambda: session.value("cloop", channel) != "0")
    _require_not(bool(closed), f"channel {channel} is in closed loop", f"cloop,{channel},0")
    reported = _if_known(lambda: session.is_remote(channel))
    if reported is None:
        what = f"the remote control of channel {channel} is not confirmed"
        _require_not(not remote, what, f"setk,{channel},1, then set `remote: true`")
    else:
        _require_not(
            not reported, f"channel {channel} is not under remote control", f"setk,{channel},1"
        )
    return reported is not None


def _if_known(query: Callable[[], bool]) -> bool | None:
    """Return the result of a query of an NV40/3, None if the device does not know the command.

    Any other refusal says nothing about the result.
    """
    try:
        return query()
    except LineFault as fault:
        if not str(fault).endswith(codec.UNKNOWN_COMMAND_NV40):
            raise
        return None


def _require_not(condition: bool, what: str, remedy: str) -> None:
    if condition:
        how = f"bring its voltage to rest and send {remedy}, or use its front panel"
        raise DeviceError(f"control is not taken: {what}, and its voltage may jump; {how}")
