"""What a loop takes over from the loop that it replaces: set by the supervisor before the start."""

from typing import Final, NamedTuple

from piezod.telemetry.shared_map import SharedMap
from piezod.telemetry.words import Word

_BITS: Final = 32  # of a word; words are signed
_LOW: Final = (1 << _BITS) - 1


class Succession(NamedTuple):
    """What a loop takes over."""

    latched: int = 0  #: Latched faults, as a bit mask.
    stopped: bool = False  #: Whether faults had stopped the stage, so that only `reset` ends them.


def put_succession(shared: SharedMap, succession: Succession) -> None:
    """Store it; afterwards `succession_of` returns it."""
    words, (latched, stopped) = shared.words, succession
    words[Word.LATCHED_LOW] = latched & _LOW
    words[Word.LATCHED_MIDDLE] = latched >> _BITS & _LOW
    words[Word.LATCHED_HIGH] = latched >> 2 * _BITS
    words[Word.SUCCEEDS] = 2 if stopped else 1


def succession_of(shared: SharedMap) -> Succession | None:
    """Return it; None for the first loop of a daemon."""
    words = shared.words
    if not words[Word.SUCCEEDS]:
        return None
    parts = words[Word.LATCHED_LOW], words[Word.LATCHED_MIDDLE], words[Word.LATCHED_HIGH]
    latched = sum(part << i * _BITS for i, part in enumerate(parts))
    return Succession(latched, words[Word.SUCCEEDS] > 1)
