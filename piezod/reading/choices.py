"""What a person says about the columns of a file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, NamedTuple

from piezod.errors import DataError


class Role(NamedTuple):
    """What a column of a record can be."""

    key: str  #: Its name in the options.
    name: str  #: Name of the column that it becomes, with its unit.
    quantity: str  #: "time", "voltage" or "length".
    stems: tuple[str, ...]  #: Names that columns of it have, in small letters, without units.
    names: tuple[str, ...] = ()  #: Names that mean this role alone, the best first.


TIME: Final = Role(
    "t",
    "t_s",
    "time",
    ("t", "time", "elapsed", "elapsed time", "relative time", "timestamp", "zeit", "x", "x value"),
    ("t_s",),
)
DRIVE: Final = Role(
    "drive",
    "drive_v",
    "voltage",
    (
        *("drive", "drive voltage", "voltage", "applied voltage", "piezo voltage", "v", "u"),
        *("spannung", "amplifier", "amplifier voltage", "command voltage", "input voltage"),
    ),
    # A table that piezod exported has the voltage of the next cycle beside that in force.
    ("in_force_v", "drive_v"),
)
POSITION: Final = Role(
    "position",
    "position_um",
    "length",
    (
        *("position", "displacement", "pos", "disp", "sensor", "measured position", "deflection"),
        *("distance", "elongation", "extension", "travel", "weg", "auslenkung", "interferometer"),
    ),
    ("position_um",),
)
COMMAND: Final = Role(
    "position",
    "command_um",
    "length",
    ("command", "target", "setpoint", "reference", "desired", *POSITION.stems),
    ("command_um", "position_um"),
)
RECORD: Final = (TIME, DRIVE, POSITION)
"""The columns of a record for a model."""
TRAJECTORY: Final = (TIME, COMMAND)
"""The columns of positions that a stage shall follow."""
KEYS: Final = ("t", "drive", "position")
"""What options can name."""


@dataclass(frozen=True)
class Choices:
    """What a person says about a file; by default nothing."""

    columns: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Name or number of the column of each role, by its key."""
    scale: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Factor of a column by the key of its role, after its unit is in s, V or µm."""
    offset: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """What is added after that, in V or µm, by the key of the role."""
    invert: frozenset[str] = frozenset()  #: Keys of the roles whose sign is turned.
    rate_hz: float | None = None  #: Samples per second, instead of a column of time.

    def __bool__(self) -> bool:
        """Return whether anything is said."""
        return self != Choices()


def parsed_choices(
    columns: str = "",
    scale: str = "",
    offset: str = "",
    invert: str = "",
    rate_hz: float | None = None,
) -> Choices:
    """Return the choices in the texts of options.

    Args:
        columns: As in `t=TIME,drive=CH1,position=CH2`.
        scale: As in `drive=20,position=2`.
        offset: As in `position=-1.5`.
        invert: As in `position`.
        rate_hz: Samples per second.

    Raises:
        DataError: If a text cannot be understood; it begins with the name of the option.
    """
    keys = [each.strip() for each in invert.split(",") if each.strip()]
    for key in keys:
        _check_key("--invert", key, KEYS[1:])
    if rate_hz is not None and not 0.0 < rate_hz < math.inf:
        raise DataError(f"--rate-hz: must be above 0 (got {rate_hz:g})")
    factors = _numbers("--scale", scale, KEYS)
    if rate_hz is not None and TIME.key in factors:
        raise DataError("--scale: t has no meaning with --rate-hz; give one of them")
    return Choices(
        columns=MappingProxyType(_pairs("--columns", columns, KEYS)),
        scale=MappingProxyType(factors),
        offset=MappingProxyType(_numbers("--offset", offset, KEYS[1:])),
        invert=frozenset(keys),
        rate_hz=rate_hz,
    )


def _pairs(option: str, text: str, keys: tuple[str, ...]) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for part in filter(None, text.split(",")):
        key, equals, value = (each.strip() for each in part.partition("="))
        if not equals or not value:
            example = {"--columns": "t=TIME,drive=CH1,position=CH2"}.get(option, "position=2")
            raise DataError(f"{option}: write it as in {example} (got {part.strip()!r})")
        _check_key(option, key, keys)
        if key in pairs:
            raise DataError(f"{option}: {key} is given twice")
        pairs[key] = value
    return pairs


def _numbers(option: str, text: str, keys: tuple[str, ...]) -> dict[str, float]:
    numbers = {}
    for key, value in _pairs(option, text, keys).items():
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (option == "--scale" and number == 0.0):
            allowed = "a number other than 0" if option == "--scale" else "a number"
            raise DataError(f"{option}: {key} must be {allowed} (got {value!r})")
        numbers[key] = number
    return numbers


def _check_key(option: str, key: str, keys: tuple[str, ...]) -> None:
    if key not in keys:
        raise DataError(f"{option}: {key!r} is none of {', '.join(keys)}")
