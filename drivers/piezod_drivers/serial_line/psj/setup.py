"""Identity and voltage limits of an amplifier of piezosystem jena."""

from contextlib import suppress

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import UNKNOWN, Identity
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjProfile
from piezod_drivers.serial_line.psj.session import PsjSession

_NO_COMMAND = "~"
"""Together with this, half a setpoint that was sent before becomes an unknown command."""


def identity_of(session: PsjSession, profile: PsjProfile, where: str) -> Identity:
    """Identify the device, after making half a command that was sent before harmless.

    Args:
        session: The exchanges with the device.
        profile: The configured model.
        where: The port, for error messages.

    Raises:
        DeviceError: If another model replies.
        LineFault: If the device does not reply.
    """
    length_of = None if profile.frames else codec.prompt
    # Half a setpoint and a new command together must not become another setpoint.
    with session.conversation.opening():
        session.ask_slowly(_NO_COMMAND, None, length_of)
    # The reply to an empty command is the greeting, with model and version.
    frame = session.ask_slowly("", None, length_of)
    if not frame:
        raise LineFault(DeviceFlag.LATE_REPLY, f"no reply at {where}")
    greeting = codec.text_of(frame)
    if not greeting.startswith(profile.greetings):
        wanted = " or ".join(f"{known}…" for known in profile.greetings)
        what = f"the device replied {greeting[:40]!r}, expected {wanted} of a {profile.title}"
        raise DeviceError(f"{where}: {what}; set `profile` to the right model")
    name, _, version = greeting.rstrip(">").partition(" ")
    return Identity("piezosystem jena", name, serial_of(session, profile), version or UNKNOWN)


def serial_of(session: PsjSession, profile: PsjProfile) -> str:
    """Read an identifier that distinguishes devices of the model; "unknown" if there is none.

    Raises:
        LineFault: If the line is lost.
    """
    if not profile.serial:
        return UNKNOWN
    # An NV40/3 reports its serial number among its versions.
    if profile.serial == "ver":
        frame = session.ask_slowly(profile.serial, None, codec.versions)
        return codec.serial_of(frame) or UNKNOWN
    frame = session.ask_slowly(profile.serial, 0)
    # The identity of the actuator is optional: some devices refuse the command.
    with suppress(LineFault):
        text = codec.text_of(frame)
        channel = 0 if profile.numbered else None
        return f"actuator {codec.fields(text, profile.serial, channel, 1)[0]}"
    return UNKNOWN


def limits_of(
    session: PsjSession, profile: PsjProfile, channel: int, range_v: tuple[float, float]
) -> tuple[float, float]:
    """Return the range of a channel, in V: the configured range within the device's limits.

    Raises:
        DeviceError: If no voltage is left.
        LineFault: If the device does not report its limits.
    """
    low, high = range_v
    if profile.limits is not None:
        named = channel if profile.limits_per_channel else None
        device_limits = [codec.number(session.value(name, named)) for name in profile.limits]
        low, high = max(low, device_limits[0]), min(high, device_limits[1])
    if not low < high:
        raise DeviceError(f"range_v and the limits of channel {channel} have no voltage in common")
    return low, high
