"""Commands of the MDT amplifiers and their replies. Pure."""

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import UNKNOWN, Identity
from piezod.devices.status import DeviceFlag

_NUMBER: Final = rb"[+-]?[0-9]{1,6}(?:\.[0-9]{0,6})?"
_VALUES: Final = rb"\[ {0,8}(" + _NUMBER + rb"(?: {0,8}, {0,8}" + _NUMBER + rb"){0,2}) {0,8}\]"
_ANY_VALUES: Final = re.compile(_VALUES)
_ANY_NUMBER: Final = re.compile(_NUMBER)
_MODEL: Final = re.compile(r"MDT[0-9]{3}[AB]?", re.IGNORECASE)
# A value may be empty: it ends with its line.
_FIRMWARE: Final = re.compile(r"Firmware Version: {0,8}(\S{1,32})", re.IGNORECASE)
_SERIAL: Final = re.compile(r"Serial {0,8}(?:#|Number)? {0,8}: {0,8}(\S{1,32})", re.IGNORECASE)
_END: Final = re.compile(rb"[!>]")
_LONGEST: Final = 512
"""Length of the longest reply in the loop, in bytes."""
_LIMITS_V: Final = {0.0: 75.0, 1.0: 100.0, 2.0: 150.0}
"""The voltage limits by their codes; some devices report the limit itself."""


class MdtCommands(NamedTuple):
    """The commands, with placeholders for the axis (X, Y or Z) and the voltage."""

    identity: str  #: Query of the identity.
    echo_off: str  #: Switches off an echo that is on.
    limit: str  #: Query of the switch at the back: 75, 100 or 150 V.
    lowest: str  #: Query of the lowest voltage of an axis.
    highest: str  #: Query of the highest voltage of an axis.
    get: str  #: Query of the voltage of an axis.
    put: str  #: Sets the voltage of an axis.


LONG_COMMANDS: Final = MdtCommands(
    "ID?", "ECHO=0", "VLIMIT?", "{}MIN?", "{}MAX?", "{}VOLTAGE?", "{}VOLTAGE={:.3f}"
)
"""Commands of the B models."""
SHORT_COMMANDS: Final = MdtCommands("I", "E", "%", "{}L?", "{}H?", "{}R?", "{}V{:.3f}")
"""Commands of the A models, and of the B models in compatibility mode."""
GET_ALL: Final = "XYZVOLTAGE?"
PUT_ALL: Final = "XYZVOLTAGE={:.3f},{:.3f},{:.3f}"
"""Commands of B models with three axes, from their second firmware on."""


def line_of(command: str) -> bytes:
    """Return the bytes of a command."""
    return f"{command}\r".encode()


class Replies:
    """Finds and reads replies that end with a prompt.

    Args:
        prompt: End of the reply to a setting: `>` or `*`.
        tail: Bytes behind the bracket of a value, as found when the device was opened.
    """

    def __init__(self, prompt: bytes, tail: bytes) -> None:
        end = re.escape(prompt)
        # A setting ends with the prompt, or with "!" if it is refused; text before it is an echo or
        # an error.
        self._acknowledgement = re.compile(rb"([^!" + end + rb"]*)([!" + end + rb"])")
        # In compatibility mode `*` may precede a value, so only `!` ends a refusal there.
        refused = rb"[!" + (end if prompt == b">" else b"") + rb"]"
        self._values = re.compile(
            rb"[^\[!>]*(?:" + _VALUES + re.escape(tail) + rb"|" + refused + rb")"
        )

    def acknowledgement_length(self, data: bytes) -> int:
        """Return the length of the reply to a setting, as a `LengthOf`. Real-time safe."""
        match = self._acknowledgement.match(data)
        if match is None:
            return -len(data) if len(data) > _LONGEST else 0
        # A bracket belongs to the reply of a query, which cannot acknowledge a setting.
        return -match.end() if b"[" in match.group(1) else match.end()

    def values_length(self, data: bytes) -> int:
        """Return the length of the reply to a query of voltages. Real-time safe."""
        match = self._values.match(data)
        if match is not None:
            is_reply = match.group(1) is not None or _is_refusal(match.group())
            return match.end() if is_reply else -match.end()
        return -len(data) if len(data) > _LONGEST else _garbage(data)

    def is_acknowledgement(self, frame: bytes, request: bytes) -> bool:
        """Return whether a frame answers a setting: a prompt, perhaps an echo, or a refusal."""
        return _is_refusal(frame) or not _without_echo(frame[:-1], request).strip(b"\r\n ")

    def has_values(self, frame: bytes, n_values: int) -> bool:
        """Return whether a frame answers a query: this number of voltages, or a refusal."""
        match = _ANY_VALUES.search(frame)
        return match is None or match.group(1).count(b",") == n_values - 1

    def check(self, frame: bytes) -> None:
        """Check that a setting was accepted. Real-time safe.

        Raises:
            LineFault: `WRONG_REQUEST` with the device's text if it was refused.
        """
        if _is_refusal(frame):
            raise _refused(frame)

    def values(self, frame: bytes, n_values: int) -> list[float]:
        """Return the voltages in a reply, in V. Real-time safe.

        Raises:
            LineFault: `WRONG_REQUEST` with the device's text, `GARBAGE` if their number is wrong.
        """
        match = _ANY_VALUES.search(frame)
        if match is None:
            raise _refused(frame)
        values = [float(text) for text in match.group(1).split(b",")]
        if len(values) != n_values:
            raise LineFault(DeviceFlag.GARBAGE, f"expected {n_values} voltages: {frame[:80]!r}")
        return values


def prompt_in(reply: bytes) -> bytes:
    """Return the prompt in the reply to an empty command; b"" if there is none."""
    # Only B models outside of compatibility mode send `>`.
    if b">" in reply:
        return b">"
    # In compatibility mode an unknown command is answered by `!`.
    return b"*" if b"*" in reply or b"!" in reply else b""


def tail_in(reply: bytes) -> bytes | None:
    """Return the bytes behind the bracket in a complete reply, None if it has no value."""
    match = _ANY_VALUES.search(reply)
    return reply[match.end() :][:8] if match else None


def number_in(reply: bytes, asked: bytes) -> float | None:
    """Return the first number in a complete reply, which may begin with an echo of `asked`."""
    match = _ANY_NUMBER.search(_without_echo(reply, asked))
    return float(match.group()) if match and not _is_refusal(reply) else None


def limit_of(number: float) -> float:
    """Return the voltage limit that a device reports, in V."""
    return _LIMITS_V.get(number, number)


def is_a_model(model: str) -> bool:
    """Return whether a model is an MDT693A or MDT694A."""
    return model.endswith("A")


def has_echo(reply: bytes, request: bytes) -> bool:
    """Return whether a reply begins with the echo of its request. Real-time safe."""
    # The A models echo in lower case.
    return reply[: len(request)].lower() == request.lower()


def identity_in(reply: bytes) -> Identity | None:
    """Return the identity in a reply, None if there is none.

    The A models report less: missing parts are "unknown".
    """
    text = reply.decode("ascii", "replace")
    model = _MODEL.search(text)
    if model is None:
        return None
    firmware, serial = _FIRMWARE.search(text), _SERIAL.search(text)
    return Identity(
        "Thorlabs",
        model.group().upper(),
        serial.group(1) if serial else UNKNOWN,
        firmware.group(1) if firmware else UNKNOWN,
    )


def axes_of(model: str) -> Sequence[str]:
    """Return the axes of a model: one of an MDT694, three of an MDT693."""
    return ("x",) if "694" in model else ("x", "y", "z")


def _garbage(data: bytes) -> int:
    """Return the negative length of a reply that ends without a value: a part of one, or noise."""
    end = _END.search(data)
    return -end.end() if end else 0


def _without_echo(reply: bytes, request: bytes) -> bytes:
    return reply[len(request) :] if has_echo(reply, request) else reply


def _is_refusal(frame: bytes) -> bool:
    text = frame.upper()
    return b"CMD_" in text or b"ERROR" in text or b"!" in text


def _refused(frame: bytes) -> LineFault:
    text = frame.decode("ascii", "replace").strip("\r\n >*")
    return LineFault(DeviceFlag.WRONG_REQUEST, f"the amplifier refuses: {text[:80]}")
