"""The swings that a person sets with a few numbers: on the command line, and in records of the IOC.

Both have no time to import the models, with which a test compares these numbers.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple


class Number(NamedTuple):
    """A number of a swing, a field of its model."""

    key: str  #: Name of the field.
    what: str  #: Description for people, at most 40 characters.
    unit: str  #: Unit of the value.
    low: float  #: Lowest allowed value.
    high: float  #: Highest allowed value.
    start: float = 0  #: Value before somebody sets it.


_ENDS: Final = (
    Number("low", "Lowest position of the waveform", "um", -1e6, 1e6),
    Number("high", "Highest position of the waveform", "um", -1e6, 1e6, start=1),
)
_FREQUENCY: Final = Number("frequency_hz", "Frequency", "Hz", 1e-4, 1e4, start=1)
SWINGS: Final[Mapping[str, tuple[Number, ...]]] = {
    "sine": (*_ENDS, _FREQUENCY),
    "triangle": (*_ENDS, _FREQUENCY),
    "chirp": (
        *_ENDS,
        Number("from_hz", "Frequency at the start of a chirp", "Hz", 1e-4, 1e4, start=1),
        Number("to_hz", "Frequency at the end of a chirp", "Hz", 1e-4, 1e4, start=10),
        Number("sweep_s", "Duration of the sweep of a chirp", "s", 1e-3, 86_400, start=60),
    ),
}
"""The numbers of each kind that is set in this way, in the order of the command line."""
