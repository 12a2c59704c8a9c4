"""The commands of the emulated wave generators and of the data recorder."""

from collections.abc import Callable, Sequence
from math import cos, pi
from typing import Final

from piezod_drivers.serial_line.gcs.emulator import GcsRefusal, number_in
from piezod_drivers.serial_line.pi_gcs2.emulation import data_recorder
from piezod_drivers.serial_line.pi_gcs2.emulation.arguments import lines, pairs, span, whole
from piezod_drivers.serial_line.pi_gcs2.emulation.arrays import array_reply
from piezod_drivers.serial_line.pi_gcs2.emulation.wave_generators import (
    MOST_POINTS,
    SERVO_NS,
    WaveGenerators,
)

N_TABLES: Final = 8
_MOST_WORDS: Final = 32
_NUMBER: Final = "{:.6f}"
_NO_MEMORY, _MOVES, _INDEX, _TYPE, _COUNT, _RANGE = 67, 73, 400, 402, 404, 405
_UNKNOWN_PARAMETER, _WORDS, _MISSING, _WRONG = 54, 24, 26, 17
_RECORD_TABLES: Final = 0x16000300
_PARAMETERS: Final = {
    0x0E000200: f"{SERVO_NS * 1e-9:.8g}",  # time of a servo cycle, in s
    0x13000004: str(MOST_POINTS),
    0x16000200: str(data_recorder.MOST_POINTS),
}


class WaveCommands:
    """Carries out the commands of wave generators and data recorder."""

    def __init__(self, waves: WaveGenerators) -> None:
        self._waves, self._generators = waves, waves.generators
        self.handlers: dict[str, Callable[[str], bytes]] = {
            "WAV": self._set_wave,
            "WAV?": self._wave_lengths,
            "WCL": self._clear,
            "GWD?": self._wave_values,
            "WSL": self._set("table", range(N_TABLES + 1), idle=True),
            "WSL?": self._get(lambda i: self._generators[i].table),
            "WGC": self._set("cycles", range(1 << 31)),
            "WGC?": self._get(lambda i: self._generators[i].cycles),
            "WGO": self._go,
            "WGO?": self._get(lambda i: self._generators[i].mode),
            "WGN?": self._get(lambda i: self._generators[i].done),
            "WGI?": self._get(lambda i: self._generators[i].point),
            "WOS": self._set_offset,
            "WOS?": self._get(lambda i: self._generators[i].offset),
            "WTR": self._set_rate,
            "WTR?": lambda _: f"0={waves.rate} 0\n".encode(),
            "TWG?": lambda _: f"{len(self._generators)}\n".encode(),
            "WMS?": lambda _: lines((i + 1, MOST_POINTS) for i in range(N_TABLES)),
            "TNR?": lambda _: f"{waves.recorder.n_tables}\n".encode(),
            "DRC": self._set_record,
            "RTR": self._set_record_rate,
            "RTR?": lambda _: f"{waves.recorder.rate}\n".encode(),
            "DRL?": self._record_lengths,
            "DRR?": self._recorded,
            "CTO": waves.triggers.configure,
            "TWC": waves.triggers.clear,
            "TWS": waves.triggers.set_points,
            "SPA?": self._parameter,
            "SPA": self._set_parameter,
        }

    def running(self) -> bytes:
        """Return the mask of the running generators, in hexadecimal digits."""
        return f"{self._waves.running():x}\n".encode()

    def _go(self, text: str) -> bytes:
        modes = {self._index(i): mode for i, mode in pairs(text, whole)}
        self._waves.go(modes)
        return b""

    def _set_wave(self, text: str) -> bytes:
        words = text.split()
        if len(words) > _MOST_WORDS:
            raise GcsRefusal(_WORDS)
        if len(words) < 6:
            raise GcsRefusal(_MISSING)
        table, append, kind = self._table(words[0]), words[1].upper(), words[2].upper()
        if append not in {"X", "&"}:
            raise GcsRefusal(_WRONG)
        before = [] if append == "X" else self._waves.tables.get(table, [])
        if kind == "PNT":
            values = _points(words[3:], len(before) + 1)
        elif kind == "SIN_P":
            values = _sine(words[3:])
        else:
            raise GcsRefusal(_TYPE)
        self._require_idle(table)
        others = sum(len(each) for i, each in self._waves.tables.items() if i != table)
        if others + len(before) + len(values) > MOST_POINTS:
            raise GcsRefusal(_NO_MEMORY)
        self._waves.tables[table] = before + values
        return b""

    def _clear(self, text: str) -> bytes:
        tables = [self._table(word) for word in text.split()]
        for table in tables:
            self._require_idle(table)
        for table in tables:
            self._waves.tables.pop(table, None)
        return b""

    def _wave_lengths(self, text: str) -> bytes:
        words = text.split() or [str(i + 1) for i in range(N_TABLES)]
        tables = [self._table(word) for word in words[::2] if word]
        return lines((f"{i} 1", len(self._waves.tables.get(i, []))) for i in tables)

    def _wave_values(self, text: str) -> bytes:
        first, n_points, words = span(text)
        columns = []
        for table in map(self._table, words):
            values = self._waves.tables.get(table, [])[first - 1 : first - 1 + n_points]
            if len(values) < n_points:
                raise GcsRefusal(_RANGE)
            columns.append((f"Wave Table {table}", values))
        return array_reply(columns, SERVO_NS * 1e-9 * self._waves.rate, _NUMBER)

    def _set_offset(self, text: str) -> bytes:
        for i, value in pairs(text, number_in):
            self._generators[self._index(i)].offset = value
        return b""

    def _set_rate(self, text: str) -> bytes:
        words = text.split()
        if len(words) != 3:
            raise GcsRefusal(_WORDS)
        generator, rate, interpolation = (whole(word) for word in words)
        # Generator 0 stands for all; they share one rate.
        if generator or rate < 1 or interpolation not in {0, 1}:
            raise GcsRefusal(_WRONG)
        self._waves.rate = rate
        return b""

    def _set_record(self, text: str) -> bytes:
        words = text.split()
        if not words or len(words) % 3:
            raise GcsRefusal(_WORDS)
        numbers = [whole(word) for word in words]
        recorder = self._waves.recorder
        for table, _, option in zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True):
            if not 1 <= table <= recorder.n_tables or option not in recorder.options():
                raise GcsRefusal(_WRONG)
        for table, source, option in zip(numbers[::3], numbers[1::3], numbers[2::3], strict=True):
            recorder.sources[table - 1] = source, option
        return b""

    def _set_record_rate(self, text: str) -> bytes:
        rate = whole(text)
        if rate < 1:
            raise GcsRefusal(_WRONG)
        self._waves.recorder.rate = rate
        return b""

    def _record_lengths(self, text: str) -> bytes:
        recorder = self._waves.recorder
        tables = text.split() or [str(i + 1) for i in range(recorder.n_tables)]
        return lines((table, recorder.length()) for table in tables)

    def _recorded(self, text: str) -> bytes:
        first, n_points, words = span(text)
        recorder = self._waves.recorder
        if first - 1 + n_points > recorder.length():
            raise GcsRefusal(_WRONG)
        tables = [self._record_table(word) for word in words]
        columns = [recorder.column(table, first, n_points) for table in tables]
        return array_reply(columns, SERVO_NS * 1e-9 * recorder.rate, _NUMBER)

    def _parameter(self, text: str) -> bytes:
        item, _, parameter = text.partition(" ")
        try:
            number = int(parameter, 0)
        except ValueError:
            raise GcsRefusal(_WRONG) from None
        if item != "1" or number not in _PARAMETERS:
            raise GcsRefusal(_UNKNOWN_PARAMETER)
        return f"{item} 0x{number:X}={_PARAMETERS[number]}\n".encode()

    def _set_parameter(self, text: str) -> bytes:
        words = text.split()
        if len(words) != 3:
            raise GcsRefusal(_WORDS)
        if words[0] != "1" or whole(words[1]) != _RECORD_TABLES:
            raise GcsRefusal(_UNKNOWN_PARAMETER)
        if not 1 <= whole(words[2]) <= data_recorder.N_TABLES:
            raise GcsRefusal(_WRONG)
        self._waves.recorder.set_tables(whole(words[2]))
        return b""

    def _set(self, name: str, allowed: range, *, idle: bool = False) -> Callable[[str], bytes]:
        def handle(text: str) -> bytes:
            wanted = [(self._index(i), value) for i, value in pairs(text, whole)]
            for i, value in wanted:
                if value not in allowed:
                    raise GcsRefusal(_WRONG)
                if idle and self._generators[i].running:
                    raise GcsRefusal(_MOVES)
            for i, value in wanted:
                setattr(self._generators[i], name, value)
            return b""

        return handle

    def _get(self, value_of: Callable[[int], float]) -> Callable[[str], bytes]:
        def handle(text: str) -> bytes:
            ids = text.split() or [str(i + 1) for i in range(len(self._generators))]
            return lines((i, value_of(self._index(i))) for i in ids)

        return handle

    def _index(self, text: str) -> int:
        number = whole(text)
        if not 1 <= number <= len(self._generators):
            raise GcsRefusal(_INDEX)
        return number - 1

    def _table(self, text: str) -> int:
        number = whole(text)
        if not 1 <= number <= N_TABLES:
            raise GcsRefusal(_INDEX)
        return number

    def _record_table(self, text: str) -> int:
        number = whole(text)
        if not 1 <= number <= self._waves.recorder.n_tables:
            raise GcsRefusal(_WRONG)
        return number

    def _require_idle(self, table: int) -> None:
        if any(each.running and each.table == table for each in self._generators):
            raise GcsRefusal(_MOVES)


def _points(words: Sequence[str], next_point: int) -> list[float]:
    """Return the values of a curve that is given point by point."""
    first, n_points = whole(words[0]), whole(words[1])
    values = [number_in(word) for word in words[2:]]
    if n_points != len(values):
        raise GcsRefusal(_COUNT)
    # The index counts from 1 in the whole table, also for an appended segment.
    if first != next_point:
        raise GcsRefusal(_RANGE)
    return values


def _sine(words: Sequence[str]) -> list[float]:
    """Return a period of a cosine that begins and ends at its offset."""
    if len(words) != 6:
        raise GcsRefusal(_COUNT)
    n_points, amplitude, offset, length, start, center = (number_in(word) for word in words)
    if not 0 < center < length == n_points <= MOST_POINTS or start:
        raise GcsRefusal(_RANGE)
    values = []
    for k in range(int(n_points)):
        part = k / center / 2 if k < center else 0.5 + (k - center) / (length - center) / 2
        values.append(offset + amplitude * (1 - cos(2 * pi * part)) / 2)
    return values
