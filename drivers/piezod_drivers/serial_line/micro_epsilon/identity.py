"""The answer to `GETINFO`: who a sensor is, in lines of text."""

import re
from typing import Final, NamedTuple

PROMPT: Final = "->"
REQUEST: Final = b"GETINFO\n"

_FIELD: Final = re.compile(
    r"^ *(Name|Serial|Measuring range|Version) *: *(\S[^\r\n]*?) *\r?$", re.M
)
_MILLIMETRES: Final = re.compile(r"([0-9]{1,6}(?:\.[0-9]{1,6})?) *mm")


class Info(NamedTuple):
    """Who a sensor says it is.

    Attributes:
        name: Its model.
        serial: Its serial number.
        version: Of its software.
        range_mm: Its measuring range, 0 where it is not told.
    """

    name: str
    serial: str
    version: str
    range_mm: float


def info_of(text: str) -> Info | None:
    """Return what a text tells, None as long as the answer is not complete."""
    begin = text.rfind("Name")
    if begin < 0 or PROMPT not in text[begin:]:
        return None
    fields = dict(_FIELD.findall(text[begin : text.index(PROMPT, begin)]))
    if "Name" not in fields or "Serial" not in fields:
        return None
    told = _MILLIMETRES.match(fields.get("Measuring range", ""))
    range_mm = float(told[1]) if told else 0.0
    return Info(fields["Name"], fields["Serial"], fields.get("Version", "not told"), range_mm)
