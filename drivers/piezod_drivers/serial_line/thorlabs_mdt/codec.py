"""Words of the MDT amplifiers, and their replies. Pure; what the loop needs may be called in it."""

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Identity
from piezod.devices.status import DeviceFlag

_NUMBER: Final = rb"[+-]?[0-9]{1,6}(?:\.[0-9]{0,6})?"
_VALUES: Final = rb"\[ {0,8}(" + _NUMBER + rb"(?: {0,8}, {0,8}" + _NUMBER + rb"){0,2}) {0,8}\]"
_ANY_VALUES: Final = re.compile(_VALUES)
_ANY_NUMBER: Final = re.compile(_NUMBER)
_MODEL: Final = re.compile(r"MDT[0-9]{3}[AB]?", re.IGNORECASE)
_FIRMWARE: Final = re.compile(r"Firmware Version:\s{0,8}(\S{1,32})", re.IGNORECASE)
_SERIAL: Final = re.compile(r"Serial\s{0,8}(?:#|Number)?\s{0,8}:?\s{0,8}(\S{1,32})", re.IGNORECASE)
_END: Final = re.compile(rb"[!>]")
_LONGEST: Final = 512
"""No reply of which something is needed in the loop is longer, in bytes."""


class Words(NamedTuple):
    """How commands are written; a place for the axis, X, Y or Z, and for the voltage.

    Attributes:
        identity: Asks who it is.
        echo_off: Makes it not repeat what it hears.
        limit: Asks for the switch at the back: 75, 100 or 150 V.
        lowest: Asks for the lowest voltage of an axis.
        highest: Asks for the highest.
        get: Asks for the voltage of an axis.
        put: Sets it.
    """

    identity: str
    echo_off: str
    limit: str
    lowest: str
    highest: str
    get: str
    put: str


LONG: Final = Words(
    "ID?", "ECHO=0", "VLIMIT?", "{}MIN?", "{}MAX?", "{}VOLTAGE?", "{}VOLTAGE={:.3f}"
)
"""Of the B models."""
SHORT: Final = Words("I", "E0", "%", "{}L?", "{}H?", "{}R?", "{}V{:.3f}")
"""Of the A models, and of the B models in compatibility mode."""
GET_ALL: Final = "XYZVOLTAGE?"
PUT_ALL: Final = "XYZVOLTAGE={:.3f},{:.3f},{:.3f}"
"""Of B models with three axes, from their second firmware on."""


def line_of(command: str) -> bytes:
    """Return the bytes of a command."""
    return f"{command}\r".encode()


class Replies:
    """Finds replies that end with a prompt.

    Args:
        prompt: What ends the reply to a setting: `>` or `*`.
        tail: What comes behind the bracket of a value; it was seen when the device was opened.
    """

    def __init__(self, prompt: bytes, tail: bytes) -> None:
        end = re.escape(prompt)
        self._taken = re.compile(rb"([^!" + end + rb"]*)([!" + end + rb"])")
        refused = rb"[!" + (end if prompt == b">" else b"") + rb"]"
        self._values = re.compile(
            rb"[^\[!>]*(?:" + _VALUES + re.escape(tail) + rb"|" + refused + rb")"
        )

    def taken_length(self, data: bytes) -> int:
        """Find the reply to a setting, as `Conversation.ask` wants it; call it in the loop."""
        match = self._taken.match(data)
        if match is None:
            return -len(data) if len(data) > _LONGEST else 0
        return -match.end() if b"[" in match.group(1) else match.end()

    def values_length(self, data: bytes) -> int:
        """Find the reply to a query of voltages, likewise; call it in the loop."""
        match = self._values.match(data)
        if match is not None:
            told = match.group(1) is not None or _is_refusal(match.group())
            return match.end() if told else -match.end()
        return -len(data) if len(data) > _LONGEST else _garbage(data)

    def is_taken(self, frame: bytes, request: bytes) -> bool:
        """Tell whether a frame answers a setting: a prompt, behind the request or a refusal."""
        return _is_refusal(frame) or not frame[:-1].replace(request, b"").strip(b"\0\r\n ")

    def tells(self, frame: bytes, n_values: int) -> bool:
        """Tell whether a frame answers a query: so many voltages, or a refusal."""
        match = _ANY_VALUES.search(frame)
        return match is None or match.group(1).count(b",") == n_values - 1

    def check(self, frame: bytes) -> None:
        """Look whether a setting was taken; may be called in the loop.

        Raises:
            LineFault: `WRONG_REQUEST` with the device's words if it was not.
        """
        if _is_refusal(frame):
            raise _refused(frame)

    def values(self, frame: bytes, n_values: int) -> list[float]:
        """Return the voltages in a reply, in V; may be called in the loop.

        Raises:
            LineFault: `WRONG_REQUEST` with the device's words, `GARBAGE` if they are not so many.
        """
        match = _ANY_VALUES.search(frame)
        if match is None:
            raise _refused(frame)
        values = [float(text) for text in match.group(1).split(b",")]
        if len(values) != n_values:
            raise LineFault(DeviceFlag.GARBAGE, f"not {n_values} voltages: {frame[:80]!r}")
        return values


def prompt_in(told: bytes) -> bytes:
    """Return the prompt in the reply to an empty command; nothing where it is none."""
    if b">" in told:
        return b">"
    return b"*" if b"*" in told or b"!" in told else b""


def tail_in(told: bytes) -> bytes | None:
    """Return what comes behind the bracket in a whole reply, None where there is no value."""
    match = _ANY_VALUES.search(told)
    return told[match.end() :][:8] if match else None


def number_in(told: bytes, asked: bytes) -> float | None:
    """Return the first number in a whole reply, which may begin with an echo of what was asked."""
    match = _ANY_NUMBER.search(told.replace(asked, b""))
    return float(match.group()) if match and not _is_refusal(told) else None


def identity_in(told: bytes) -> Identity | None:
    """Return who a reply says that the device is, None where it does not say.

    The A models tell less: what is missing is called unknown.
    """
    text = told.decode("ascii", "replace")
    model = _MODEL.search(text)
    if model is None:
        return None
    firmware, serial = _FIRMWARE.search(text), _SERIAL.search(text)
    return Identity(
        "Thorlabs",
        model.group().upper(),
        serial.group(1) if serial else "unknown",
        firmware.group(1) if firmware else "unknown",
    )


def axes_of(model: str) -> Sequence[str]:
    """Return the axes of a model: an MDT694 has one, an MDT693 three."""
    return ("x",) if "694" in model else ("x", "y", "z")


def _garbage(data: bytes) -> int:
    """Drop what has ended without a value: a part of a reply, or noise."""
    end = _END.search(data)
    return -end.end() if end else 0


def _is_refusal(frame: bytes) -> bool:
    text = frame.upper()
    return b"CMD_" in text or b"ERROR" in text or b"!" in text


def _refused(frame: bytes) -> LineFault:
    words = frame.decode("ascii", "replace").strip("\r\n >*")
    return LineFault(DeviceFlag.WRONG_REQUEST, f"the amplifier refuses: {words[:80]}")
