"""Ranges and units of the quantities that several configurations share."""

import re
from typing import Annotated, Final, TypeAlias

from pydantic import AfterValidator, Field, StringConstraints

from piezod.config.fields import Quantity, broken_rule
from piezod.config.messages import show
from piezod.config.modes import Mode

# Control characters, including Unicode's separators of lines and paragraphs.
_CONTROL: Final = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


def _one_line(text: str) -> str:
    if _CONTROL.search(text):
        raise broken_rule(f"must be one line without control characters (got {show(text)})")
    return text


# Texts for people: they appear in the terminal, in figures and in reports.
OneLine: TypeAlias = Annotated[str, AfterValidator(_one_line)]

# Names of axes, devices and drivers: they become parts of paths, of file names and of commands.
Name: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=32)]

# Files and clients write a mode as text; strict validation would require the enumeration's member.
ModeName: TypeAlias = Annotated[Mode, Field(strict=False)]

RateHz: TypeAlias = Annotated[float, Quantity(10, 20_000, "Hz")]
# All processes of a machine share this clock.
StartS: TypeAlias = Annotated[
    Annotated[float, Quantity(0, 1e9, "s")] | None,
    Field(
        description="Instant at which it begins, at most 30 s ahead, in s of CLOCK_MONOTONIC, as "
        "`t_s` of telemetry; default: as soon as possible."
    ),
]
FrequencyHz: TypeAlias = Annotated[float, Quantity(1e-4, 10_000, "Hz")]
DurationS: TypeAlias = Annotated[float, Quantity(1e-3, 86_400, "s")]
TimeS: TypeAlias = Annotated[float, Quantity(0, 86_400, "s")]
PauseS: TypeAlias = Annotated[float, Quantity(0, 3600, "s")]
DriveV: TypeAlias = Annotated[float, Quantity(-2000, 2000, "V")]
PositionUm: TypeAlias = Annotated[float, Quantity(-100_000, 100_000, "µm")]
PercentOfRange: TypeAlias = Annotated[float, Quantity(0, 1e6, "%")]
Fraction: TypeAlias = Annotated[float, Quantity(0, 1)]
Seed: TypeAlias = Annotated[int, Quantity(0, 2**32 - 1)]
# Values of a waveform, in the unit of the enclosing key.
Level: TypeAlias = Annotated[float, Quantity(-1e6, 1e6)]
Size: TypeAlias = Annotated[float, Quantity(1e-6, 1e6)]
