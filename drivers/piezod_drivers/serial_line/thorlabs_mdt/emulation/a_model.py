"""The emulated MDT693A, as captures of one with firmware 3.01 show it."""

from typing import Final

from piezod.devices.emulation.bench import SharedRig
from piezod.devices.emulation.emulator import Emulator
from piezod_drivers.serial_line.thorlabs_mdt.emulation.values import RefusalError, volts

_MOST_BYTES: Final = 20
"""The byte with this number in a line makes the amplifier drop the line."""
_TOO_LONG: Final = b"Invalid Command!"
_REFUSED, _DONE = b"!", b"*"
_LIMIT_CODE: Final = 2  # 150 V


class MdtAEmulator(Emulator):
    """Implements `Emulator`: an MDT693A, which knows the short commands only.

    It echoes each byte at once and in lower case, and a NUL follows about every second prompt. Only
    CR ends a command; an LF belongs to the next one.

    Args:
        serial: Serial number, which this model does not report.
    """

    def __init__(self, bench: SharedRig, serial: str) -> None:  # noqa: ARG002 - as of all emulators
        self._bench = bench
        self._axes = "XYZ"[: bench.n_axes]
        # After power-up the echo is on.
        self.echo = True
        self._line = b""
        self._nul_is_due = False

    def receive(self, data: bytes) -> list[bytes]:
        """Process bytes of the host; return the replies with the echo before them."""
        replies, out = [], b""
        for byte in data:
            char = bytes((byte,))
            out += char.lower() if self.echo else b""
            if len(self._line) + 1 >= _MOST_BYTES:
                self._line = b""
                out += _TOO_LONG
            elif char == b"\r":
                line, self._line = self._line, b""
                replies.append(out + self._answer(line))
                out = b""
            elif self._line or char != b"\n":
                self._line += char
        return [*replies, out] if out else replies

    def _answer(self, line: bytes) -> bytes:
        try:
            reply = self._execute(line.decode("ascii", "replace").upper())
        except RefusalError:
            reply = _REFUSED
        if reply not in {_REFUSED, _DONE}:
            return reply
        self._nul_is_due = not self._nul_is_due
        return reply + b"\0" if self._nul_is_due else reply

    def _execute(self, text: str) -> bytes:
        # The first letter is enough for these two: `ID?` and `INFO?` are answered like `I`.
        if text.startswith("I"):
            return _identity()
        if text.startswith("D"):
            return b"*Piezo Device: [MDT693A]\r"
        if text == "E":
            self.echo = not self.echo
            return b"*[Echo %s]\r" % (b"On" if self.echo else b"Off")
        if text == "%":
            return b"*[ %d]\r" % _LIMIT_CODE
        return self._execute_for_axis(text)

    def _execute_for_axis(self, text: str) -> bytes:
        name, command = text[:1], text[1:]
        axes = range(len(self._axes)) if name == "A" else [self._axes.find(name)]
        if not name or -1 in axes:
            raise RefusalError
        if command.startswith("V"):
            value_v = volts(command[1:], "")
            if not all(self._bench.drive(axis, value_v) for axis in axes):
                raise RefusalError
            return _DONE
        queries = {"R?": self._bench.drive_v(axes[0]), "L?": 0.0, "H?": 150.0}
        if command not in queries:
            raise RefusalError
        return b"*[%6.1f]\r" % queries[command]


def _identity() -> bytes:
    lines = (
        "*     \r\r\rModel MDT693A Piezo Control Module",
        "Firmware Version: 3.01",
        "Voltage Range: 0V to 150V",
        "Thorlabs, Inc. Newton, NJ 07860",
        "www.thorlabs.com\r\r",
    )
    return "\r".join(lines).encode()
