"""Who an amplifier of piezosystem jena is, and what it says that it can do."""

from contextlib import suppress

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Identity
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.serial_line.psj import codec
from piezod_drivers.serial_line.psj.profiles import PsjModel
from piezod_drivers.serial_line.psj.session import PsjSession

UNKNOWN = "unknown"
_NO_COMMAND = "~"
"""Makes what is left of a setpoint that did not go out as a whole a command that nobody knows."""


def identity_of(talk: PsjSession, model: PsjModel, where: str) -> Identity:
    """Ask who is there, after something that ends half a command without obeying it.

    Args:
        talk: To the device.
        model: Which one it should be.
        where: The port, for errors.

    Raises:
        DeviceError: If another model answers.
        LineFault: If nobody does.
    """
    length_of = None if model.frames else codec.prompt
    talk.ask_once(_NO_COMMAND, None, length_of)
    frame = talk.ask_once("", None, length_of)
    if not frame:
        raise LineFault(DeviceFlag.LATE_REPLY, f"nobody answers at {where}")
    greeting = codec.text_of(frame)
    if not greeting.startswith(model.greetings):
        wanted = " or ".join(f"{known}…" for known in model.greetings)
        what = f"{greeting[:40]!r} answered, a {model.title} says {wanted}"
        raise DeviceError(f"{where}: {what}; set `profile` to the device's")
    name, _, version = greeting.rstrip(">").partition(" ")
    return Identity("piezosystem jena", name, serial_of(talk, model), version or UNKNOWN)


def serial_of(talk: PsjSession, model: PsjModel) -> str:
    """Ask for what tells a device from another of its kind; "unknown" where it tells nothing.

    Raises:
        LineFault: If the line is gone.
    """
    if not model.serial:
        return UNKNOWN
    if model.serial == "ver":
        frame = talk.ask_once(model.serial, None, codec.versions)
        return codec.serial_of(frame) or UNKNOWN
    frame = talk.ask_once(model.serial, 0)
    with suppress(LineFault):
        text = codec.text_of(frame)
        channel = 0 if model.numbered else None
        return f"actuator {codec.fields(text, model.serial, channel, 1)[0]}"
    return UNKNOWN


def limits_of(
    talk: PsjSession, model: PsjModel, channel: int, range_v: tuple[float, float]
) -> tuple[float, float]:
    """Return the voltages that a channel can be set to, in V: as configured, and as it says.

    Raises:
        DeviceError: If that leaves none.
        LineFault: If it does not say.
    """
    low, high = range_v
    if model.limits is not None:
        told = [codec.number(talk.value(name, channel)) for name in model.limits]
        low, high = max(low, told[0]), min(high, told[1])
    if not low < high:
        raise DeviceError(f"no voltage of range_v is within what channel {channel} says it can do")
    return low, high
