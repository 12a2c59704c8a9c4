"""The ranges and units of the quantities that configurations share."""

from typing import Annotated, TypeAlias

from pydantic import StringConstraints

from piezod.config.fields import Quantity

# Names of axes, devices and drivers: they become parts of paths, of file names and of commands.
Name: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=32)]

RateHz: TypeAlias = Annotated[float, Quantity(10, 20_000, "Hz")]
FrequencyHz: TypeAlias = Annotated[float, Quantity(1e-4, 10_000, "Hz")]
DurationS: TypeAlias = Annotated[float, Quantity(1e-3, 86_400, "s")]
PauseS: TypeAlias = Annotated[float, Quantity(0, 3600, "s")]
DriveV: TypeAlias = Annotated[float, Quantity(-2000, 2000, "V")]
PositionUm: TypeAlias = Annotated[float, Quantity(-100_000, 100_000, "µm")]
Percent: TypeAlias = Annotated[float, Quantity(0, 100, "%")]
PercentOfRange: TypeAlias = Annotated[float, Quantity(0, 1e6, "%")]
Fraction: TypeAlias = Annotated[float, Quantity(0, 1)]
Seed: TypeAlias = Annotated[int, Quantity(0, 2**32 - 1)]
# Values of a waveform: in the unit that the key around the waveform names.
Level: TypeAlias = Annotated[float, Quantity(-1e6, 1e6)]
Size: TypeAlias = Annotated[float, Quantity(1e-6, 1e6)]
