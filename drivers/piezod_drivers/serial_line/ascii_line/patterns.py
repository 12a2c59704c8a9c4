"""Regular expressions for replies that are matched in a short time, whatever the reply is.

Python's engine tries again if a pattern is ambiguous. With nested or repeated ambiguities the time
grows with a power of the length of the reply, or doubles with each character. Here a pattern may
have one ambiguity, outside of repetitions. Then the time grows with the square of the length, which
is limited.
"""

import re
from typing import Annotated, Final, TypeAlias

from pydantic import AfterValidator, StringConstraints

from piezod.config.fields import broken_rule
from piezod_drivers.serial_line.ascii_line.ambiguity import find_ambiguities

LONGEST_PATTERN: Final = 400


def compiled(pattern: str) -> re.Pattern[str]:
    """Compile a pattern for a whole reply.

    Raises:
        ValueError: If it is invalid or may take long; the text has the remedy.
    """
    if not all(ord(char) < 256 for char in pattern):
        raise ValueError("has characters beyond latin-1: use . for them")
    try:
        regex = re.compile(pattern, re.ASCII)
    except re.error as error:
        raise ValueError(f"is no regular expression: {error}") from error
    ambiguities = find_ambiguities(pattern)
    if len({clash.first for clash in ambiguities}) > 1 or any(
        clash.repeated for clash in ambiguities
    ):
        shown = ", ".join(f"{first} or {second}" for _, (first, second), _ in ambiguities[:4])
        raise ValueError(
            f"may take long, because the same characters match several of its parts ({shown}): "
            "use classes without common characters, such as [^,]* for .* before a comma"
        )
    return regex


def _checked(pattern: str) -> str:
    try:
        compiled(pattern)
    except ValueError as error:
        raise broken_rule(f"pattern {error} (got {pattern!r})") from error
    return pattern


Pattern: TypeAlias = Annotated[
    str,
    StringConstraints(min_length=1, max_length=LONGEST_PATTERN),
    AfterValidator(_checked),
]
"""A regular expression for a whole reply, without its terminator."""
