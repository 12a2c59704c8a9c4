"""How fields of status and telemetry are shown: words, units and places, for all adapters.

A field that is shown has a `Shown` in its annotation. Page, IOC, `piezod status` and notebooks go
over `AXIS` and `STAGE` of `piezod.messages.answers`: a field appears in them because its
description says so.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Flag, StrEnum, auto
from types import NoneType
from typing import Any, Final, NamedTuple, get_args, get_type_hints

from piezod.messages.documents import Document
from piezod.units import to_ascii


class Unit(NamedTuple):
    """A unit, which the names of fields end in."""

    sign: str = ""  #: Its sign; `ascii` for programs that know no µ.
    digits: int = 0  #: Digits after the decimal point that people read.
    fine: int = 0  #: Digits for programs that show what they are told, such as screens of EPICS.

    @property
    def ascii(self) -> str:
        """Its sign without µ."""
        return to_ascii(self.sign)


_UNITS: Final[Mapping[str, Unit]] = {
    "um": Unit("µm", 3, 4),
    "v": Unit("V", 2, 3),
    "s": Unit("s", 2, 3),
    "us": Unit("µs"),
    "hz": Unit("Hz", 1, 1),
    "pct": Unit("%", 1, 1),
}


def unit_of(name: str, of_axis: str = "µm") -> Unit:
    """Return the unit of a field, from the end of its name; an empty one if it has none.

    Args:
        name: Name of the field.
        of_axis: Unit of the positions of its axis: that of a user axis may be µrad.
    """
    unit = _UNITS.get(name.rpartition("_")[2], Unit())
    return unit._replace(sign=of_axis) if unit.sign == "µm" else unit


class Trait(Flag):
    """What holds for a field besides its words."""

    COLUMN = auto()
    """`piezod status` shows it; of an axis as a column, which tables in notebooks have too."""
    DETAIL = auto()
    """The page shows it among the details."""
    NEEDED = auto()
    """Its record has an alarm while the value is unknown."""
    UNARCHIVED = auto()
    """An archiver need not store its record."""


COLUMN, DETAIL, NEEDED, UNARCHIVED = Trait


@dataclass(frozen=True)
class Shown:
    """The words of a field, and where it is shown."""

    words: str  #: What people call it, as the heading of a column.
    record: str = ""  #: Name of its EPICS record; empty if it has none.
    what: str = ""  #: Description of the record, at most 40 characters.
    marks: Trait | None = None  #: What else holds.
    choices: type[StrEnum] | None = None  #: All values of a word, in an order that stays.


class ShownField(NamedTuple):
    """A field that is shown."""

    name: str  #: Its name in the messages.
    kind: type  #: Type of a known value: float, int, bool, str or tuple.
    shown: Shown  #: Words and places.
    live: bool  #: Whether telemetry has it; otherwise only the status.

    @property
    def unit(self) -> Unit:
        """Its unit, from the end of its name."""
        return unit_of(self.name)

    @property
    def choices(self) -> tuple[str, ...]:
        """All values of a word; empty if it may be any."""
        return tuple(map(str, self.shown.choices or ()))

    def has(self, mark: Trait) -> bool:
        """Return whether a mark holds."""
        return self.shown.marks is not None and mark in self.shown.marks

    @property
    def heading(self) -> str:
        """The words, with the unit."""
        return f"{self.shown.words}/{self.unit.sign}" if self.unit.sign else self.shown.words

    def text(self, value: Any) -> str:
        """Return a value for people, without its unit; a dash if it is unknown."""
        if value is None:
            return "–"
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, tuple):
            return ", ".join(value) or "none"
        return f"{value:.{self.unit.digits}f}" if isinstance(value, float) else str(value)

    @property
    def document(self) -> Document:
        """The description as JSON, for the page."""
        return {
            "words": self.shown.words,
            "what": self.shown.what,
            "unit": self.unit.sign,
            "digits": self.unit.digits,
            "detail": self.has(DETAIL),
        }


def shown_fields(telemetry: type, status: type) -> Mapping[str, ShownField]:
    """Return the fields that are shown, by name: those of telemetry, then others of the status.

    Args:
        telemetry: Class of the message with the live values; it describes what both have.
        status: Class of the status.
    """
    live = _described(telemetry, live=True)
    return live | {
        name: field for name, field in _described(status, live=False).items() if name not in live
    }


def _described(declared: type, *, live: bool) -> dict[str, ShownField]:
    hints, kinds = get_type_hints(declared, include_extras=True), get_type_hints(declared)
    found = {}
    for name, hint in hints.items():
        for shown in getattr(hint, "__metadata__", ()):
            found[name] = ShownField(name, _kind(kinds[name]), shown, live)
    return found


def _kind(annotation: Any) -> type:
    """Return the type of a known value; that of the values of a range is float."""
    parts = [part for part in get_args(annotation) or (annotation,) if part is not NoneType]
    if getattr(annotation, "__origin__", None) is tuple:
        return tuple
    return parts[0] if parts[0] in {bool, int, str} else float
