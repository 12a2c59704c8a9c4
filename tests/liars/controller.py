"""Speaks for the amplifier in GCS 2, with a wave generator that plays tables by its own clock.

It has one axis, one table, and what the driver `pi_gcs2` asks for. After the last point, and after
a stop, the output keeps its voltage.
"""

import re
from collections.abc import Callable, Sequence
from typing import Final

from tests.liars.amplifier import Amplifier

SERVO_S: Final = 5e-5
RECORDS: Final = 4000
"""Points of both tables of the recorder together."""
_PARAMETERS: Final = {
    "0x0E000200": f"{SERVO_S:g}",
    "0x13000004": "262144",
    "0x16000200": f"{RECORDS}",
}
_FIXED: Final = {
    "*IDN?": "(c) LIAR, A1, SN7, 1.0",
    "SAI?": "1",
    "SVO?": "1=0",
    "ONL?": "1=1",
    "WGO?": "1=0",
    "TNR?": "2",
}
_SETTINGS: Final = frozenset({"SVO", "ONL", "WSL", "WOS", "RTR", "DRC", "SPA"})
"""Settings that change nothing here."""
_UNKNOWN, _RANGE, _BUSY = 2, 17, 53
_PIECES: Final = re.compile(rb"([\n\x09])")


class Controller:
    """A controller of one axis."""

    def __init__(self, amplifier: Amplifier) -> None:
        self._amplifier = amplifier
        self._line, self._error = b"", 0
        self._table, self._record = list[float](), list[tuple[float, float]]()
        self._cycles = self._rate = 1
        self._point, self._points, self._start_s = 0, 0, 0.0
        self._commands: dict[str, Callable[[list[str], float], str]] = {
            "POS?": lambda _words, now_s: f"1={self._amplifier.sense_um(now_s):.6f}",
            "VOL?": lambda _words, now_s: f"1={self._amplifier.read_back_v(now_s):.6f}",
            "ERR?": self._take_error,
            "SPA?": lambda words, _now_s: f"{' '.join(words)}={_PARAMETERS[words[1]]}",
            "SVA": self._write,
            "WCL": self._clear,
            "WAV": self._append,
            "WGC": self._count,
            "WTR": self._slow,
            "WGO": self._go,
            "GWD?": lambda words, _now_s: _rows([(v,) for v in self._table], words),
            "WGN?": lambda _words, _now_s: f"1={self._point // max(len(self._table), 1)}",
            "WGI?": lambda _words, _now_s: f"1={self._point}",
            "DRL?": lambda _words, _now_s: f"1={len(self._record)}",
            "DRR?": lambda words, _now_s: _rows(self._record, words),
        }

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes, and return the replies."""
        self.advance(now_s)
        replies = b""
        for piece in _PIECES.split(data):
            if piece == b"\n":
                replies += self._execute(self._line.decode("latin-1").split(), now_s)
                self._line = b""
            elif piece == b"\t":  # asks which generators are running
                replies += f"{int(self._plays):x}\n".encode()
            else:
                self._line += piece
        return replies

    def advance(self, now_s: float) -> None:
        """Play the points that are due."""
        while self._plays:
            due_s = self._start_s + self._point * self._rate * SERVO_S
            if due_s > now_s:
                break
            self._amplifier.advance(due_s)
            # The recorder stores the sensor of just before a point, and what is measured after it.
            position_um = self._amplifier.position_um()
            drive_v = self._table[self._point % len(self._table)]
            self._amplifier.play(drive_v, due_s, starts=self._point == 0)
            if len(self._record) < RECORDS // 2:
                self._record.append((position_um, self._amplifier.shown_v(due_s)))
            self._point += 1
            if not self._plays:
                self._amplifier.note(due_s, "end")
        self._amplifier.advance(now_s)

    @property
    def _plays(self) -> bool:
        return self._point < self._points

    def _execute(self, words: list[str], now_s: float) -> bytes:
        name, *arguments = words or [""]
        if name in _FIXED:
            if name == "*IDN?":
                self._amplifier.note(now_s, "opened")
            return f"{_FIXED[name]}\n".encode()
        if name in self._commands:
            reply = self._commands[name](arguments, now_s)
            return f"{reply}\n".encode() if reply else b""
        if name not in _SETTINGS:
            self._error = _UNKNOWN
        return b""

    def _take_error(self, _words: list[str], _now_s: float) -> str:
        error, self._error = self._error, 0
        return f"{error}"

    def _write(self, words: list[str], now_s: float) -> str:
        if self._plays or not self._amplifier.write(float(words[1]), now_s):
            self._error = _BUSY if self._plays or self._amplifier.refuses else _RANGE
        return ""

    def _clear(self, _words: list[str], now_s: float) -> str:
        self._table.clear()
        self._amplifier.note(now_s, "load")
        return ""

    def _append(self, words: list[str], _now_s: float) -> str:
        self._table += map(float, words[5:])
        return ""

    def _count(self, words: list[str], _now_s: float) -> str:
        self._cycles = int(words[1])
        return ""

    def _slow(self, words: list[str], _now_s: float) -> str:
        self._rate = int(words[1])
        return ""

    def _go(self, words: list[str], now_s: float) -> str:
        if self._amplifier.refuses:
            self._error = _BUSY
        elif words[1] == "0":
            self._points = 0
        else:
            self._record.clear()
            self._point, self._points = 0, self._cycles * len(self._table)
            self._start_s = now_s
            self.advance(now_s)
        return ""


def _rows(rows: Sequence[Sequence[float]], words: list[str]) -> str:
    """Return the rows that a query asks for, behind a header; all but the last end with a space."""
    first, count = int(words[0]) - 1, int(words[1])
    lines = [" ".join(f"{value:.6f}" for value in row) for row in rows[first : first + count]]
    return " \n".join(("# TYPE = 1", "# END_HEADER", *lines))
