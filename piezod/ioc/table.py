"""The records of a stage and of an axis: names, types, units. Everything else derives from it.

The names of records of a stage have capitals, names of axes have none, so that they cannot collide.
"""

from collections.abc import Mapping
from enum import Enum
from math import isfinite
from typing import Any, Final, NamedTuple, Self

from pydantic import BaseModel

from piezod.config.modes import Mode
from piezod.config.states import State
from piezod.config.waveforms.paths import Points
from piezod.config.waveforms.swings import SWINGS
from piezod.ioc.request_limits import longest, range_of
from piezod.messages.answers import AXIS, STAGE
from piezod.messages.requests import Play, Wave
from piezod.messages.shown import UNARCHIVED, ShownField

HISTORY: Final = 64
"""Longest history, in points: a second at 50 Hz, and some for intervals of unequal length."""
LONGEST_RECORD: Final = 100_000
LONGEST_WORD: Final = 39
LONGEST_TEXT: Final = 400
STATES: Final = tuple(str(state) for state in State)
MODES: Final = tuple(str(mode) for mode in Mode)
TABLE: Final = "table"
_FIRST_WAVES: Final = ("sine", "triangle", TABLE)
WAVES: Final = (*_FIRST_WAVES, *(kind for kind in SWINGS if kind not in _FIRST_WAVES))
"""Kinds of waveforms; clients know them by their numbers, so that new ones come last."""
FAULT_GROUPS: Final = {
    "SENSOR": "S",
    "AMPLIFIER": "A",
    "BUS": "B",
    "LOOP": "L",
    "ADAPTATION": "D",
    "PROCESS": "P",
    "ESTOP": "E",
    "SUPERVISOR": "H",
}
"""Name of the record of each group of faults, and the letter that their ids begin with."""


class Kind(Enum):
    """The kind of a record, and its record type in EPICS."""

    NUMBER = "ai"
    COUNT = "longin"
    FLAG = "bi"
    CHOICE = "mbbi"
    WORD = "stringin"
    TEXT = "waveform of CHAR"
    ARRAY = "waveform of DOUBLE"
    COMMAND = "bo"
    SET_NUMBER = "ao"
    SET_COUNT = "longout"
    SET_CHOICE = "mbbo"
    SET_TEXT = "stringout"
    SET_ARRAY = "waveform of DOUBLE, set"

    @property
    def is_set(self) -> bool:
        """Whether clients write it."""
        return self is Kind.COMMAND or self.name.startswith("SET_")


_KINDS: Final = {
    float: Kind.NUMBER,
    int: Kind.COUNT,
    bool: Kind.FLAG,
    str: Kind.WORD,
    tuple: Kind.WORD,
}
"""Kinds of records, by the types of the fields that they show."""
_NO_YES: Final = ("no", "yes")


class Record(NamedTuple):
    """One record."""

    name: str  #: Name, after the prefix of the stage or of the axis.
    kind: Kind  #: Its kind.
    what: str  #: Description for people, at most 40 characters.
    unit: str = ""  #: Unit of the value.
    digits: int = 3  #: Digits after the decimal point that a screen shows.
    choices: tuple[str, ...] = ()  #: Texts of a choice or of a flag.
    length: int = 0  #: Longest array or text.
    low: float = float("-inf")  #: Lowest value that may be written; in an array, of each element.
    high: float = float("inf")  #: Highest value that may be written.
    start: float | str = 0  #: Value when the IOC starts.
    archive: bool = False  #: Whether an archiver should store it.

    @classmethod
    def of_field(cls, field: ShownField) -> Self:
        """Return the record that shows a field of telemetry or status."""
        shown, kind = field.shown, _KINDS[field.kind]
        if field.choices:
            kind = Kind.CHOICE
        return cls(
            shown.record,
            kind,
            shown.what,
            field.unit.ascii,
            field.unit.fine,
            choices=_NO_YES if kind is Kind.FLAG else field.choices,
            archive=not field.has(UNARCHIVED),
        )

    @classmethod
    def setting(cls, of: tuple[type[BaseModel], str], *record: Any, **more: Any) -> Self:
        """Return a record that becomes a field of a request, with the range and length of it.

        Args:
            of: The request, and the name of its field.
            record: Name, kind, description and so on.
            more: Further attributes.
        """
        low, high = range_of(*of)
        made = cls(*record, **more)._replace(low=low, high=high)
        return made._replace(length=longest(*of)) if made.kind is Kind.SET_ARRAY else made

    def why_not(self, value: Any) -> str:
        """Return why a value may not be written to this record; empty if it may."""
        if self.kind is Kind.SET_TEXT:
            return ""
        if self.kind is Kind.SET_ARRAY:
            if len(value) > self.length:
                return f"more than {self.length} elements, at most {self.length} are allowed"
            return next(filter(None, map(self._why_no_number, map(float, value))), "")
        return self._why_no_number(float(value))

    def _why_no_number(self, value: float) -> str:
        low, high = self.low, self.high
        if choices := ("idle", "do") if self.kind is Kind.COMMAND else self.choices:
            low, high = 0, len(choices) - 1
        if isfinite(value) and low <= value <= high:
            return ""
        return f"{value:g}, allowed range {low:g} to {high:g}"

    @property
    def saved(self) -> bool:
        """Whether autosave should store it: a setting that only this IOC knows."""
        return self.kind.is_set and self.kind is not Kind.COMMAND and self.name not in _LIVE


def recorded(fields: Mapping[str, ShownField]) -> list[ShownField]:
    """Return the fields that have a record."""
    return [each for each in fields.values() if each.shown.record]


def wave_record(key: str) -> str:
    """Return the name of the record of a number of a waveform."""
    return "WAVE:FREQ" if key == "frequency_hz" else f"WAVE:{key.partition('_')[0].upper()}"


_WAVE_NUMBERS: Final = dict.fromkeys(each for numbers in SWINGS.values() for each in numbers)
_LIVE: Final = ("MODE", "LEASE")
"""Settings that act at once, which a restart must not repeat."""

STAGE_RECORDS: Final = (
    Record("CONNECTED", Kind.FLAG, "The daemon answers", choices=_NO_YES, archive=True),
    *map(Record.of_field, recorded(STAGE)),
    Record("FAULTS", Kind.WORD, "Faults, present or latched", archive=True),
    Record("FAULT:COUNT", Kind.COUNT, "Number of faults", archive=True),
    Record("FAULT:TEXT", Kind.TEXT, "Worst fault and its remedy", length=LONGEST_TEXT),
    *(
        Record(f"FAULT:{name}", Kind.WORD, f"Faults {letter}1, {letter}2, ...", archive=True)
        for name, letter in FAULT_GROUPS.items()
    ),
    Record("REC:RUNNING", Kind.FLAG, "A recording runs", choices=_NO_YES, archive=True),
    Record("REC:NAME", Kind.TEXT, "Name of the recording that runs", length=LONGEST_TEXT),
    Record("REC:RECORDS", Kind.COUNT, "Recorded cycles"),
    Record("REC:LOST", Kind.COUNT, "Cycles lost by the recording"),
    Record("LEASE:HOLDER", Kind.WORD, "User and client with the lease", archive=True),
    Record("MESSAGE", Kind.TEXT, "Why the last write was refused", length=LONGEST_TEXT),
    Record("ARM", Kind.COMMAND, "Take over the voltage: SAFE to READY"),
    Record("DISARM", Kind.COMMAND, "Ramp to the safe voltage, then SAFE"),
    Record("HOLD", Kind.COMMAND, "Hold the voltage"),
    Record("RESUME", Kind.COMMAND, "Continue after HOLD"),
    Record("STOP", Kind.COMMAND, "Ramp to the safe voltage, then SAFE"),
    Record("ESTOP", Kind.COMMAND, "Emergency stop"),
    Record("RESET", Kind.COMMAND, "Clear faults that are gone"),
    Record("CONDITION", Kind.COMMAND, "Swing over the whole range"),
    Record("LEASE", Kind.SET_CHOICE, "Lease of this IOC", choices=("as needed", "keep")),
    Record("REC:LABEL", Kind.SET_TEXT, "Part of the name of the next recording", start=""),
    Record("REC:START", Kind.COMMAND, "Start recording every cycle"),
    Record("REC:STOP", Kind.COMMAND, "End the recording"),
)
"""Records of a stage, after its prefix."""

AXIS_RECORDS: Final = (
    *map(Record.of_field, recorded(AXIS)),
    Record("MODE", Kind.SET_CHOICE, "Select the mode; READY to RUN", choices=MODES),
    Record("ZERO", Kind.COMMAND, "Displacement at rest becomes zero"),
    Record("HIST:TIME", Kind.ARRAY, "Times before the newest sample", "s", length=HISTORY),
    Record("HIST:POS", Kind.ARRAY, "Position in the last second", "um", 4, length=HISTORY),
    Record("HIST:CMD", Kind.ARRAY, "Command in the last second", "um", 4, length=HISTORY),
    Record("HIST:DRIVE", Kind.ARRAY, "Drive in the last second", "V", 3, length=HISTORY),
    Record("WAVE:KIND", Kind.SET_CHOICE, "Kind of the waveform", choices=WAVES),
    *(
        Record(
            wave_record(key),
            Kind.SET_NUMBER,
            what,
            unit,
            4 if unit == "um" else 3,
            low=low,
            high=high,
            start=start,
        )
        for key, what, unit, low, high, start in _WAVE_NUMBERS
    ),
    Record.setting(
        (Wave, "duration_s"), "WAVE:DURATION", Kind.SET_NUMBER, "Duration", "s", start=1
    ),
    Record.setting(
        (Points, "points"), "WAVE:TABLE", Kind.SET_ARRAY, "Positions of a table", "um", 4
    ),
    Record(
        "WAVE:INTERVAL",
        Kind.SET_NUMBER,
        "Time between two points of the table",
        "s",
        6,
        low=1e-6,
        high=1e3,
        start=0.01,
    ),
    Record("WAVE:START", Kind.COMMAND, "Follow the waveform"),
    Record.setting((Play, "drive_v"), "PLAY:TABLE", Kind.SET_ARRAY, "Voltages of one period", "V"),
    Record.setting(
        (Play, "interval_s"),
        "PLAY:INTERVAL",
        Kind.SET_NUMBER,
        "Time between two voltages",
        "s",
        6,
        start=1e-4,
    ),
    Record.setting((Play, "cycles"), "PLAY:CYCLES", Kind.SET_COUNT, "Number of periods", start=1),
    Record("PLAY:START", Kind.COMMAND, "The device plays the table by its clock"),
    Record("PLAY:READ", Kind.COMMAND, "Read the record of the last play"),
    Record("PLAY:DRIVE", Kind.ARRAY, "Voltages as played", "V", length=longest(Play, "drive_v")),
    Record("PLAY:POS", Kind.ARRAY, "Recorded positions", "um", 4, length=LONGEST_RECORD),
    Record("PLAY:POS:INTERVAL", Kind.NUMBER, "Time between two of them", "s", 6),
)
"""Records of an axis, after the name of its motor record and a colon."""
