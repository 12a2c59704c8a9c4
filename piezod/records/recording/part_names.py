"""Names of recordings, and of the files of one recording."""

import re
from typing import Final

RECORDING_NAME: Final = re.compile(
    r"[0-9]{8}T[0-9]{6}Z(-[0-9]+)?(-[A-Za-z0-9][A-Za-z0-9_-]{0,31})?(-[0-9]{4,})?"
)
"""Names that the daemon makes: time of day, number, label, and number of the file."""
_PART: Final = re.compile(r"-[0-9]{4,}$")


def part_name(name: str, part: int) -> str:
    """Return the name of a file of a recording; the first file has the name of the recording."""
    return name if part == 1 else f"{name}-{part:04d}"


def without_part(name: str) -> str:
    """Return the name of a file without its number, if it has one."""
    return _PART.sub("", name)
