"""Regular expressions for answers, of a kind that cannot take long whatever comes.

Python's engine goes back and tries again where a pattern leaves a choice. Nested choices, or
several over the same characters, make it take time that grows with a power of the length of the
answer, or doubles with every character of it. Here a pattern may leave one such choice, outside
of what is repeated: then the time grows with the square of a length that is bounded.
"""

import re
from typing import Annotated, Final, TypeAlias

from pydantic import AfterValidator, StringConstraints

from piezod.config.fields import broken_rule
from piezod_drivers.serial_line.ascii_line.ambiguity import clashes_of

LONGEST_PATTERN: Final = 400


def compiled(pattern: str) -> re.Pattern[str]:
    """Compile a pattern for a whole answer.

    Raises:
        ValueError: If it is no regular expression, or one that may take long; says what to do.
    """
    if not all(ord(char) < 256 for char in pattern):
        raise ValueError("has characters beyond latin-1: write . for them")
    try:
        regex = re.compile(pattern, re.ASCII)
    except re.error as error:
        raise ValueError(f"is no regular expression: {error}") from error
    clashes = clashes_of(pattern)
    if len({clash.first for clash in clashes}) > 1 or any(clash.repeated for clash in clashes):
        shown = ", ".join(f"{first} or {second}" for _, (first, second), _ in clashes[:4])
        raise ValueError(
            f"may take long, as the same characters fit more than one of its parts ({shown}): "
            "use classes that have no character in common, as [^,]* for .* before a comma"
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
"""A regular expression for a whole answer, without its terminator."""
