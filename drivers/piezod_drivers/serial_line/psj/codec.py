"""What goes over the wire to and from amplifiers of piezosystem jena; no state, no time.

After the vendor's public `psj-lib` and `nv200`; not confirmed on hardware. A command is a name and
its values between commas, ended by CR or CR LF. An answer is XOFF, text, CR LF, XON: the two are
marks of the frame, not flow control. Some answers of a d-Drive end with CR and nothing more.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.status import NO_FLAGS, DeviceFlag, Flags
from piezod_drivers.serial_line.psj.profiles import Bits, PsjModel

LONGEST: Final = 256
"""More bytes than this without an end are no answer."""

_XON, _XOFF = b"\x11", b"\x13"
_NUMBER: Final = re.compile(r"[-+]?\d{1,9}(?:\.\d{0,9})?(?:[eE][-+]?\d{1,2})?", re.ASCII)
_SERIAL: Final = re.compile(rb"serno, {0,9}([!-~]{1,40})")
_WORD: Final = re.compile(r"(?:0[xX])?[0-9A-Fa-f]{1,8}")

_ERROR_TEXTS: Final[Mapping[str, DeviceFlag]] = {  # of a d-Drive
    "command not found": DeviceFlag.WRONG_REQUEST,
    "command mismatch": DeviceFlag.WRONG_REQUEST,
    "not present": DeviceFlag.WRONG_REQUEST,
    "unit not available": DeviceFlag.SHORT_OR_OPEN,
}
_ERRORS_NV40: Final[Mapping[str, DeviceFlag]] = {
    "11": DeviceFlag.WRONG_REQUEST,  # unknown command
    "15": DeviceFlag.WRONG_REQUEST,  # no such channel
    "16": DeviceFlag.WRONG_REQUEST,  # likewise
    "17": DeviceFlag.WRONG_REQUEST,  # a value is missing
    "18": DeviceFlag.WRONG_REQUEST,  # out of range
    "25": DeviceFlag.SHORT_OR_OPEN,  # no actuator
}
UNKNOWN_NV40: Final = "ErrorCode,11"
"""What an NV40/3 says to a command that it does not know."""
_ERRORS_NV200: Final[Mapping[str, DeviceFlag]] = {
    "2": DeviceFlag.WRONG_REQUEST,  # unknown command
    "3": DeviceFlag.WRONG_REQUEST,  # a value is missing
    "4": DeviceFlag.WRONG_REQUEST,  # out of range
    "5": DeviceFlag.WRONG_REQUEST,  # too many values
    "6": DeviceFlag.LOCAL_MODE,  # locked, or can only be read
    "7": DeviceFlag.OVERLOAD,  # under-load
    "8": DeviceFlag.OVERLOAD,
    "9": DeviceFlag.WRONG_REQUEST,  # too low
    "10": DeviceFlag.WRONG_REQUEST,  # too high
}


def command(model: PsjModel, name: str, channel: int | None = None, *values: float) -> bytes:
    """Make a command; voltages have three decimals, whole numbers none.

    Args:
        model: For which model.
        name: Of the command; "" asks who is there.
        channel: Number of the channel; None, or where the model has but one: none is named.
        *values: What follows.
    """
    words = [name]
    if channel is not None and model.numbered:
        words.append(str(channel))
    words += [str(value) if isinstance(value, int) else f"{value:.3f}" for value in values]
    return ",".join(words).encode("ascii") + model.ending


def framed(got: bytes) -> int:
    """Find an answer that ends with XON; what comes before its XOFF is garbage; a `LengthOf`."""
    end, begin = got.find(_XON), got.find(_XOFF)
    if begin > 0 and (end < 0 or begin < end):
        return -begin
    return _up_to(end, got)


def line(got: bytes) -> int:
    """Find an answer that ends with LF, and with it an XON that has come; a `LengthOf`."""
    end = got.find(b"\n")
    return _up_to(end + got.startswith(_XON, end + 1), got) if end >= 0 else _up_to(end, got)


def ended_by_cr(got: bytes) -> int:
    """Find an answer that ends with CR, and with it what of CR LF XON has come; a `LengthOf`."""
    end = got.find(b"\r")
    if end >= 0:
        end += got.startswith(b"\n", end + 1)
        end += got.startswith(_XON, end + 1)
    return _up_to(end, got)


def prompt(got: bytes) -> int:
    """Find an answer that ends with ">", and with it what of CR LF has come; a `LengthOf`."""
    end = got.find(b">")
    if end >= 0:
        end += len(got[end + 1 : end + 3]) - len(got[end + 1 : end + 3].lstrip(b"\r\n"))
    return _up_to(end, got)


def versions(got: bytes) -> int:
    """Find the lines that an NV40/3 tells of itself, the last its serial number; a `LengthOf`."""
    begin = got.find(b"ErrorCode")
    if begin < 0:
        begin = got.find(b"serno,")
    return _up_to(got.find(_XON, begin) if begin >= 0 else -1, got)


def serial_of(frame: bytes) -> str:
    """Return the serial number that `versions` has found, "" for none."""
    found = _SERIAL.search(frame)
    return "" if found is None else found[1].decode("ascii")


def text_of(frame: bytes) -> str:
    """Return the text of an answer, "" where it only acknowledges.

    Raises:
        LineFault: `GARBAGE` if it is no text, else what an error means that it tells.
    """
    _, _, body = frame.rpartition(_XOFF)
    body = body.strip(b"\x00\x01\r\n\x11 ")
    if not all(0x20 <= byte < 0x7F for byte in body):
        raise LineFault(DeviceFlag.GARBAGE, f"no text came, but {body[:40]!r}")
    text = body.decode("ascii")
    if (flag := _refusal(text)) is not None:
        raise LineFault(flag, f"the device says: {text}")
    return text


def tells(name: str, channel: int | None, frame: bytes) -> bool:
    """Tell whether a frame can be the answer to a question: its values, or an error."""
    try:
        return _names(text_of(frame), name, channel) is not None
    except LineFault as fault:
        return fault.flag is not DeviceFlag.GARBAGE


def acknowledges(name: str, frame: bytes) -> bool:
    """Tell whether a frame can be the answer to a setting: nothing, its own name, or an error."""
    try:
        text = text_of(frame)
    except LineFault as fault:
        return fault.flag is not DeviceFlag.GARBAGE
    return not text or text.partition(",")[0].strip() == name


def fields(text: str, name: str, channel: int | None, count: int) -> list[str]:
    """Return the values that an answer tells.

    Args:
        text: The answer.
        name: The command that it must answer.
        channel: Number of the channel that it must name; None for none.
        count: How many values it must tell.

    Raises:
        LineFault: `OUT_OF_ORDER` if it answers another command, `GARBAGE` if it tells too few
            values or too many.
    """
    values = _names(text, name, channel)
    if values is None:
        what = f"{name} was answered by {text[:40]!r}"
        raise LineFault(DeviceFlag.OUT_OF_ORDER, what)
    if len(values) != count:
        raise LineFault(DeviceFlag.GARBAGE, f"{count} values were expected, {text[:40]!r} came")
    return values


def number(text: str) -> float:
    """Read a number.

    Raises:
        LineFault: `GARBAGE` if it is none.
    """
    if _NUMBER.fullmatch(text) is None:
        raise LineFault(DeviceFlag.GARBAGE, f"no number came, but {text[:40]!r}")
    return float(text)


def word(text: str, base: int) -> int:
    """Read a status word, decimal or hexadecimal.

    Raises:
        LineFault: `GARBAGE` if it is none.
    """
    try:
        if _WORD.fullmatch(text) is not None:
            return int(text, base)
    except ValueError:  # hexadecimal where decimal was expected
        pass
    raise LineFault(DeviceFlag.GARBAGE, f"no status word came, but {text[:40]!r}")


def flags_of(status: int, bits: Sequence[Bits]) -> Flags:
    """Return what a status word says is the matter."""
    found = frozenset(bit.flag for bit in bits if bool(status & bit.mask) == bit.present)
    return found or NO_FLAGS


def _names(text: str, name: str, channel: int | None) -> list[str] | None:
    """Return what follows command and channel in an answer, None where it names others."""
    words = [word.strip() for word in text.split(",")]
    wanted = [name] if channel is None else [name, str(channel)]
    return words[len(wanted) :] if words[: len(wanted)] == wanted else None


def _up_to(end: int, got: bytes) -> int:
    """Return the length up to an index, -1 for none; all is garbage where it is too long."""
    if end >= LONGEST or (end < 0 and len(got) > LONGEST):
        return -(end + 1 or len(got))
    return end + 1


def _refusal(text: str) -> DeviceFlag | None:
    """Return what an error means, None for an answer that is none."""
    name, _, code = text.partition(",")
    if name == "ErrorCode":
        return _ERRORS_NV40.get(code.strip(), DeviceFlag.DEVICE_FAILURE)
    if name == "error":
        return _ERRORS_NV200.get(code.strip(), DeviceFlag.DEVICE_FAILURE)
    lower = text.lower()
    return next((flag for needle, flag in _ERROR_TEXTS.items() if needle in lower), None)
