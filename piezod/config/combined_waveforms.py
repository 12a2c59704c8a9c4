"""Waveforms made of others: a sum, or a sequence."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel
from piezod.config.quantities import DurationS
from piezod.config.waveforms import (
    Bounds,
    Csv,
    Multisine,
    Points,
    Reversals,
    Setpoint,
    Sine,
    SingleWaveform,
    Staircase,
    Triangle,
)


class Sum(ConfigModel):
    """The sum of several waveforms."""

    kind: Literal["sum"]
    parts: tuple[SingleWaveform, ...] = Field(
        min_length=2, max_length=16, description="The waveforms."
    )

    def bounds(self) -> Bounds:
        """Return a range that the sum never leaves: all parts at their ends simultaneously."""
        low = high = 0.0
        for part_low, part_high in (part.bounds() for part in self.parts):
            low += part_low
            high += part_high
        return low, high


class SequencePart(ConfigModel):
    """One waveform of a sequence."""

    duration_s: DurationS = Field(description="Duration, s.")
    waveform: Annotated[
        Setpoint | Sine | Triangle | Multisine | Staircase | Reversals | Points | Csv | Sum,
        Field(discriminator="kind"),
    ] = Field(description="The waveform; its time starts with the part.")


class Sequence(ConfigModel):
    """Waveforms one after the other; the last value is held."""

    kind: Literal["sequence"]
    parts: tuple[SequencePart, ...] = Field(
        min_length=1, max_length=64, description="The waveforms."
    )

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        lows, highs = zip(*(part.waveform.bounds() for part in self.parts), strict=True)
        return min(lows), max(highs)


WaveformConfig: TypeAlias = Annotated[
    Setpoint | Sine | Triangle | Multisine | Staircase | Reversals | Points | Csv | Sum | Sequence,
    Field(discriminator="kind"),
]
