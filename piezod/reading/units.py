"""Units in the names of columns, in rows of units and in attributes."""

import re
from typing import Final, NamedTuple

_PREFIXES: Final = {
    "time": {
        "s": 1.0,
        "sec": 1.0,
        "secs": 1.0,
        "second": 1.0,
        "seconds": 1.0,
        "ms": 1e-3,
        "msec": 1e-3,
        "millisecond": 1e-3,
        "milliseconds": 1e-3,
        "us": 1e-6,
        "µs": 1e-6,
        "usec": 1e-6,
        "microsecond": 1e-6,
        "microseconds": 1e-6,
        "ns": 1e-9,
        "nanoseconds": 1e-9,
        "min": 60.0,
    },
    "voltage": {
        "v": 1.0,
        "volt": 1.0,
        "volts": 1.0,
        "mv": 1e-3,
        "millivolt": 1e-3,
        "millivolts": 1e-3,
        "kv": 1e3,
    },
    "length": {
        "um": 1.0,
        "µm": 1.0,
        "micron": 1.0,
        "microns": 1.0,
        "micrometer": 1.0,
        "micrometers": 1.0,
        "micrometre": 1.0,
        "micrometres": 1.0,
        "nm": 1e-3,
        "nanometer": 1e-3,
        "nanometers": 1e-3,
        "nanometre": 1e-3,
        "nanometres": 1e-3,
        "mm": 1e3,
        "millimeter": 1e3,
        "millimeters": 1e3,
        "millimetre": 1e3,
        "millimetres": 1e3,
        "m": 1e6,
        "meter": 1e6,
        "meters": 1e6,
        "metre": 1e6,
        "metres": 1e6,
    },
}
BASE: Final = {"time": "s", "voltage": "V", "length": "µm"}
"""The unit that the values of each quantity get."""
_IN_BRACKETS: Final = re.compile(r"(.*?)\s*[\[({]\s*([^\])}]+?)\s*[\])}]\s*")
_BEHIND_SLASH: Final = re.compile(r"(.*?)\s*/\s*(\S+)")
_AT_END: Final = re.compile(r"(.+)[_ .-]([^_ .-]+)")


class Unit(NamedTuple):
    """A unit that is known."""

    text: str  #: As the file has it.
    quantity: str  #: "time", "voltage" or "length".
    factor: float  #: Size in the unit of `BASE`.


def unit_of(text: str) -> Unit | None:
    """Return the unit that a text is; None if it is no unit of time, voltage or length.

    Capitals do not matter: scopes write S and VOLT, and nobody records megavolts.
    """
    plain = text.strip().strip("[](){}").strip()
    folded = plain.lower().replace("\N{GREEK SMALL LETTER MU}", "µ")
    for quantity, factors in _PREFIXES.items():
        if folded in factors:
            return Unit(plain, quantity, factors[folded])
    return None


def parts_of_name(name: str) -> tuple[str, Unit | None]:
    """Return the name of a column in small letters without its unit, and the unit.

    Units are read in `Time [s]`, `Time (s)`, `Time / s` and `time_s`.
    """
    for pattern in (_IN_BRACKETS, _BEHIND_SLASH, _AT_END):
        found = pattern.fullmatch(name.strip())
        if found and (unit := unit_of(found[2])):
            return _words(found[1]), unit
    return _words(name), None


def _words(name: str) -> str:
    return re.sub(r"[^0-9a-z]+", " ", name.lower()).strip()
