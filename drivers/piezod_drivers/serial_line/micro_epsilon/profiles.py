"""Properties in which the streams of the sensors differ, as data.

Scales and ranges are from the manuals of ILD1420, ILD1402, ILD1700, ILD1750, ILD1900 and ODC2520.
Only the manual of the ILD1700 explains the single error codes; the meaning of the others is not
confirmed.
"""

from collections.abc import Mapping
from math import nan
from types import MappingProxyType
from typing import Final, NamedTuple

from piezod.devices.status import NO_FLAGS, SATURATED, DeviceFlag, Flags

UM_PER_MM: Final = 1000.0

_LOW_LIGHT: Final = frozenset({DeviceFlag.LOW_LIGHT})
_OVERLOADED: Final = frozenset({DeviceFlag.BUS_OVERLOADED})

_CODES_3: Final[Mapping[int, Flags]] = MappingProxyType(
    {
        262_073: SATURATED,  # below the lowest value that can be sent
        262_074: SATURATED,  # above the highest
        262_075: _OVERLOADED,  # too much data for the bit rate
        262_076: _LOW_LIGHT,  # no peak
        262_077: SATURATED,  # in front of the measuring range
        262_078: SATURATED,  # behind it
        262_081: _LOW_LIGHT,  # the peak is too wide
        262_082: _LOW_LIGHT,  # the laser is off
    }
)
_CODES_2: Final[Mapping[int, Flags]] = MappingProxyType(
    {
        16_370: _LOW_LIGHT,  # no target
        16_372: SATURATED,  # too near
        16_374: SATURATED,  # too far
        16_376: _LOW_LIGHT,  # the target cannot be evaluated
        16_378: _LOW_LIGHT,  # the laser is off
    }
)


class SensorProfile(NamedTuple):
    """The stream of a family of sensors; displacement = count · `per_count` + `offset`."""

    word_bytes: int  #: Bytes of a word: 3 with 18 bits, or 2 with 14.
    baud: int  #: Bits per second as delivered.
    #: Displacement of a count: a fraction of the measuring range, or in µm if not `scaled`.
    per_count: float
    offset: float  #: Displacement at count 0, in the same unit.
    lowest: int  #: Lowest count within the range.
    highest: int  #: Highest count within the range.
    first_code: int  #: Counts from here on are error codes.
    codes: Mapping[int, Flags]  #: Meaning of some of them.
    scaled: bool = True  #: Whether displacements scale with the measuring range.
    answers_commands: bool = True  #: Whether the sensor answers text commands.

    def read(self, count: int, range_um: float) -> tuple[float, Flags]:
        """Return the displacement of a count in µm, NaN if it has none, and its flags."""
        if count >= self.first_code:
            return nan, self.codes.get(count, NO_FLAGS)
        if not self.lowest <= count <= self.highest:
            return nan, SATURATED
        return (count * self.per_count + self.offset) * (range_um if self.scaled else 1.0), NO_FLAGS

    def count_at(self, position_um: float, range_um: float) -> int:
        """Return the count of a displacement in µm, which may be beyond the range."""
        part = position_um / (range_um if self.scaled else 1.0)
        return round((part - self.offset) / self.per_count)


# From the manuals: displacement = (1.02 · count / 65520 - 0.01) · measuring range.
_ILD1X20: Final = SensorProfile(3, 921_600, 1.02 / 65_520, -0.01, 643, 64_877, 262_072, _CODES_3)
# Displacement = (count - 98232) / 65536 · measuring range.
_ILD1X50: Final = SensorProfile(
    3, 921_600, 1 / 65_536, -98_232 / 65_536, 0, 230_604, 262_072, _CODES_3
)
# Displacement = (1.02 · count / 16368 - 0.01) · measuring range.
_ILD14: Final = SensorProfile(
    2, 115_200, 1.02 / 16_368, -0.01, 161, 16_207, 16_368, _CODES_2, answers_commands=False
)

PROFILES: Final[Mapping[str, SensorProfile]] = MappingProxyType(
    {
        "ILD1220": _ILD1X20,
        "ILD1320": _ILD1X20,
        "ILD1420": _ILD1X20,
        "ILD1750": _ILD1X50,
        "ILD1900": _ILD1X50,
        "ILD1402": _ILD14,
        "ILD1700": _ILD14,
        "ODC2520": SensorProfile(
            3, 115_200, 1.0, -131_000.0, 0, 262_071, 262_072, _CODES_3, scaled=False
        ),
    }
)
"""Profiles by the name of the family."""
