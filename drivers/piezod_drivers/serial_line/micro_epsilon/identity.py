"""Reads the reply to `GETINFO`, lines of text with the identity of a sensor."""

import re
from typing import Final, NamedTuple

from piezod.devices.interface import NOT_TOLD

PROMPT: Final = "->"
REQUEST: Final = b"GETINFO\n"

_FIELD: Final = re.compile(
    r"^ *(Name|Serial|Measuring range|Version) *: *(\S[^\r\n]*?) *\r?$", re.M
)
_MILLIMETRES: Final = re.compile(r"([0-9]{1,6}(?:\.[0-9]{1,6})?) *mm")


class SensorIdentity(NamedTuple):
    """Identity of a sensor."""

    name: str  #: Model.
    serial: str  #: Serial number.
    version: str  #: Version of its software.
    range_mm: float  #: Measuring range in mm, 0 if it is not reported.


def parse_identity(text: str) -> SensorIdentity | None:
    """Return the identity in a text, None while the reply is incomplete."""
    # The last reply: an earlier one may be incomplete.
    begin = text.rfind("Name")
    if begin < 0 or PROMPT not in text[begin:]:
        return None
    fields = dict(_FIELD.findall(text[begin : text.index(PROMPT, begin)]))
    if "Name" not in fields or "Serial" not in fields:
        return None
    range_ = _MILLIMETRES.match(fields.get("Measuring range", ""))
    range_mm = float(range_[1]) if range_ else 0.0
    return SensorIdentity(
        fields["Name"], fields["Serial"], fields.get("Version", NOT_TOLD), range_mm
    )
