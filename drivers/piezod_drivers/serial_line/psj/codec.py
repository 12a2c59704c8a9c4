"""Commands to amplifiers of piezosystem jena, and their replies. Pure.

The sources are the vendor's public `psj-lib` and `nv200`; not confirmed on hardware. A command is a
name and its values, separated by commas, and ends with CR or CR LF. A reply is XOFF, text, CR LF,
XON: XOFF and XON frame it and are no flow control. Some replies of a d-Drive end with CR only.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.serial_line.psj.profiles import PsjProfile, StatusBits

LONGEST: Final = 256
"""Bytes without an end beyond this length are garbage."""
LONGEST_RECORD: Final = 65_000
"""The same for the reply with a whole record: 6144 values of at most 10 characters."""

_XON, _XOFF = b"\x11", b"\x13"
_NUMBER: Final = re.compile(r"[-+]?\d{1,9}(?:\.\d{0,9})?(?:[eE][-+]?\d{1,2})?", re.ASCII)
_SERIAL: Final = re.compile(rb"serno, {0,9}([!-~]{1,40})")
_WORD: Final = re.compile(r"(?:0[xX])?[0-9A-Fa-f]{1,8}")

_ERROR_TEXTS: Final[Mapping[str, DeviceFlag]] = {  # errors of a d-Drive, parts of a text
    "command not found": DeviceFlag.WRONG_REQUEST,
    "command mismatch": DeviceFlag.WRONG_REQUEST,
    "not present": DeviceFlag.WRONG_REQUEST,
    "unit not available": DeviceFlag.SHORT_OR_OPEN,
}
_ERRORS_NV40: Final[Mapping[str, DeviceFlag]] = {
    "11": DeviceFlag.WRONG_REQUEST,  # unknown command
    "15": DeviceFlag.WRONG_REQUEST,  # no such channel
    "16": DeviceFlag.WRONG_REQUEST,  # no such channel
    "17": DeviceFlag.WRONG_REQUEST,  # a value is missing
    "18": DeviceFlag.WRONG_REQUEST,  # out of range
    "25": DeviceFlag.SHORT_OR_OPEN,  # no actuator
}
UNKNOWN_COMMAND_NV40: Final = "ErrorCode,11"
"""Reply of an NV40/3 to an unknown command."""
SOURCE_REPLY_NV40: Final = "STATUS"
"""First word of the reply of an NV40/3 to `stat`."""
_REMOTE_NV40: Final = 0x80
_ERRORS_NV200: Final[Mapping[str, DeviceFlag]] = {
    "2": DeviceFlag.WRONG_REQUEST,  # unknown command
    "3": DeviceFlag.WRONG_REQUEST,  # a value is missing
    "4": DeviceFlag.WRONG_REQUEST,  # out of range
    "5": DeviceFlag.WRONG_REQUEST,  # too many values
    "6": DeviceFlag.LOCAL_MODE,  # locked, or read-only
    "7": DeviceFlag.OVERLOAD,  # under-load
    "8": DeviceFlag.OVERLOAD,
    "9": DeviceFlag.WRONG_REQUEST,  # too low
    "10": DeviceFlag.WRONG_REQUEST,  # too high
}


def command(profile: PsjProfile, name: str, channel: int | None = None, *values: float) -> bytes:
    """Return a command; voltages have three decimals, whole numbers none.

    Args:
        profile: The model.
        name: Name of the command; "" requests the greeting.
        channel: Number of the channel; left out of the command if None or if the model has one
            channel.
        *values: Values of the command.
    """
    words = [name]
    if channel is not None and profile.numbered:
        words.append(str(channel))
    words += [str(value) if isinstance(value, int) else f"{value:.3f}" for value in values]
    return ",".join(words).encode("ascii") + profile.ending


def framed(got: bytes) -> int:
    """Return the length of a reply that ends with XON, as a `LengthOf`.

    Bytes before its XOFF are garbage.
    """
    end, begin = got.find(_XON), got.find(_XOFF)
    # An XOFF before any XON begins the reply; an XON before it ends an earlier one.
    if begin > 0 and (end < 0 or begin < end):
        return -begin
    return _up_to(end, got)


def framed_record(got: bytes) -> int:
    """Return the length of a reply with a whole record, as `framed` does."""
    begin = got.find(_XOFF)
    if begin:
        return -(begin if begin > 0 else len(got))
    end = got.find(_XON)
    return -len(got) if end < 0 and len(got) > LONGEST_RECORD else end + 1


def line(got: bytes) -> int:
    """Return the length of a reply that ends with LF and perhaps XON, as a `LengthOf`."""
    end = got.find(b"\n")
    return _up_to(end + got.startswith(_XON, end + 1), got) if end >= 0 else _up_to(end, got)


def ended_by_cr(got: bytes) -> int:
    """Return the length of a reply that ends with CR and perhaps LF and XON, as a `LengthOf`."""
    end = got.find(b"\r")
    if end >= 0:
        end += got.startswith(b"\n", end + 1)
        end += got.startswith(_XON, end + 1)
    return _up_to(end, got)


def prompt(got: bytes) -> int:
    """Return the length of a reply that ends with ">" and perhaps CR LF, as a `LengthOf`."""
    end = got.find(b">")
    if end >= 0:
        end += len(got[end + 1 : end + 3]) - len(got[end + 1 : end + 3].lstrip(b"\r\n"))
    return _up_to(end, got)


def versions(got: bytes) -> int:
    """Return the length of the version lines of an NV40/3, as a `LengthOf`.

    The last line is its serial number.
    """
    begin = got.find(b"ErrorCode")
    if begin < 0:
        begin = got.find(b"serno,")
    return _up_to(got.find(_XON, begin) if begin >= 0 else -1, got)


def serial_of(frame: bytes) -> str:
    """Return the serial number in a frame of `versions`, "" if there is none."""
    found = _SERIAL.search(frame)
    return "" if found is None else found[1].decode("ascii")


def text_of(frame: bytes) -> str:
    """Return the text of a reply, "" for a bare acknowledgement.

    Raises:
        LineFault: `GARBAGE` if it is not text, else the error that it reports.
    """
    # The part behind the last XOFF: bytes of a reply that was cut off may precede it.
    _, _, body = frame.rpartition(_XOFF)
    body = body.strip(b"\x00\x01\r\n\x11 ")
    if not all(0x20 <= byte < 0x7F for byte in body):
        raise LineFault(DeviceFlag.GARBAGE, f"expected text, got {body[:40]!r}")
    text = body.decode("ascii")
    if (flag := _refusal(text)) is not None:
        raise LineFault(flag, f"the device reports: {text}")
    return text


def is_reply_to(name: str, channel: int | None, frame: bytes) -> bool:
    """Return whether a frame can be the reply to a query: its values, or an error."""
    try:
        return _names(text_of(frame), name, channel) is not None
    except LineFault as fault:
        return fault.flag is not DeviceFlag.GARBAGE


def is_acknowledgement_of(name: str, frame: bytes) -> bool:
    """Return whether a frame can acknowledge a setting: empty, its name, or an error."""
    try:
        text = text_of(frame)
    except LineFault as fault:
        return fault.flag is not DeviceFlag.GARBAGE
    return not text or text.partition(",")[0].strip() == name


def fields(text: str, name: str, channel: int | None, count: int) -> list[str]:
    """Return the values in a reply.

    Args:
        text: The reply.
        name: Command that it must name.
        channel: Number of the channel that it must name; None for none.
        count: Required number of values.

    Raises:
        LineFault: `OUT_OF_ORDER` if it answers another command, `GARBAGE` if the number of values
            is wrong.
    """
    values = values_of(text, name, channel)
    if len(values) != count:
        raise LineFault(DeviceFlag.GARBAGE, f"expected {count} values, got {text[:40]!r}")
    return values


def values_of(text: str, name: str, channel: int | None) -> list[str]:
    """Return all values in a reply, as `fields` does for a required number of them.

    Raises:
        LineFault: `OUT_OF_ORDER` if it answers another command.
    """
    values = _names(text, name, channel)
    if values is None:
        what = f"the reply to {name} was {text[:40]!r}"
        raise LineFault(DeviceFlag.OUT_OF_ORDER, what)
    return values


def number(text: str) -> float:
    """Return the number in a text.

    Raises:
        LineFault: `GARBAGE` if it is not a number.
    """
    if _NUMBER.fullmatch(text) is None:
        raise LineFault(DeviceFlag.GARBAGE, f"expected a number, got {text[:40]!r}")
    return float(text)


def word(text: str, base: int) -> int:
    """Return the status word in a text, decimal or hexadecimal.

    Raises:
        LineFault: `GARBAGE` if it is not a number.
    """
    try:
        if _WORD.fullmatch(text) is not None:
            return int(text, base)
    except ValueError:  # hexadecimal digits in a decimal number
        pass
    raise LineFault(DeviceFlag.GARBAGE, f"expected a status word, got {text[:40]!r}")


def is_remote(status: int) -> bool:
    """Return whether the port sets the voltage, by the status word of an NV40/3 channel."""
    return bool(status & _REMOTE_NV40)


def flags_of(status: int, bits: Sequence[StatusBits]) -> Flags:
    """Return the faults in a status word."""
    found = frozenset(bit.flag for bit in bits if bool(status & bit.mask) == bit.present)
    return found or NO_FLAGS


def _names(text: str, name: str, channel: int | None) -> list[str] | None:
    """Return the values behind command and channel in a reply, None if it names others."""
    words = [word.strip() for word in text.split(",")]
    wanted = [name] if channel is None else [name, str(channel)]
    return words[len(wanted) :] if words[: len(wanted)] == wanted else None


def _up_to(end: int, got: bytes) -> int:
    """Return the length up to an index, -1 for none; a reply that is too long is garbage."""
    if end >= LONGEST or (end < 0 and len(got) > LONGEST):
        return -(end + 1 or len(got))
    return end + 1


def _refusal(text: str) -> DeviceFlag | None:
    """Return the meaning of an error, None if the reply is no error."""
    name, _, code = text.partition(",")
    if name == "ErrorCode":
        return _ERRORS_NV40.get(code.strip(), DeviceFlag.DEVICE_FAILURE)
    if name == "error":
        return _ERRORS_NV200.get(code.strip(), DeviceFlag.DEVICE_FAILURE)
    lower = text.lower()
    return next((flag for needle, flag in _ERROR_TEXTS.items() if needle in lower), None)
