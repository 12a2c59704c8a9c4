"""Speaks for the amplifier in lines that the driver `ascii` is configured for."""

import re
from typing import Final

from tests.liars.amplifier import Amplifier

_WRITE: Final = re.compile(r"W (-?\d{1,4}\.\d{1,6})")


class Lines:
    """Answers each line with a line."""

    def __init__(self, amplifier: Amplifier) -> None:
        self._amplifier, self._rest = amplifier, b""

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes, and return the replies."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        return b"".join(
            self._answer(line.decode("latin-1"), now_s).encode() + b"\n" for line in lines
        )

    def advance(self, now_s: float) -> None:
        """Do what is due."""
        self._amplifier.advance(now_s)

    def _answer(self, command: str, now_s: float) -> str:
        self._amplifier.advance(now_s)
        if command == "ID?":
            self._amplifier.note(now_s, "opened")
            return "LIAR A1 SN7"
        if command == "P?":
            return f"P {self._amplifier.sense_um(now_s):.4f}"
        if command == "V?":
            return f"V {self._amplifier.read_back_v(now_s):.3f}"
        asked = _WRITE.fullmatch(command)
        if asked is None:
            return "ERR"
        if self._amplifier.write(float(asked[1]), now_s):
            return "OK"
        return "BUSY" if self._amplifier.refuses else "ERR"
