"""Waveforms made of others, and all kinds together."""

from bisect import bisect_right
from collections.abc import Mapping
from itertools import accumulate
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.quantities import DurationS
from piezod.config.waveforms.paths import AnyPath
from piezod.config.waveforms.shapes import AnyFormula
from piezod.config.waveforms.waveform import (
    MAX_POINTS,
    MAX_TERMS,
    Budget,
    Packed,
    Timed,
    Waveform,
    WaveformModel,
    by_kind,
)

Single: TypeAlias = AnyFormula | AnyPath
BY_KIND: Final = Field(discriminator="kind")


class Sum(WaveformModel):
    """The sum of several waveforms."""

    kind: Literal["sum"]
    parts: tuple[Annotated[Single, BY_KIND], ...] = Field(
        min_length=2, max_length=16, description="The waveforms."
    )

    def packed(self, duration_s: float, budget: Budget) -> Packed:
        """Return the packed parts."""
        parts = [part.packed(duration_s, budget) for part in self.parts]
        return {"kind": self.kind, "parts": parts}

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the sum of the parts; at its bounds all are at their ends simultaneously."""
        parts = [_unpacked(part) for part in packed["parts"]]
        values = [part.value for part in parts]

        def value(t_s: float) -> float:
            total = 0.0
            for part in values:
                total += part(t_s)
            return total

        low = high = 0.0
        for part in parts:
            low += part.low
            high += part.high
        return Waveform(value, low, high, max(part.highest_hz for part in parts))


class SequencePart(Timed):
    """One waveform of a sequence."""

    duration_s: DurationS = Field(description="Duration, s.")
    waveform: Annotated[Single | Sum, BY_KIND] = Field(
        description="The waveform; its time starts with the part."
    )


class Sequence(WaveformModel):
    """Waveforms one after the other; the last value is held."""

    kind: Literal["sequence"]
    parts: tuple[SequencePart, ...] = Field(
        min_length=1, max_length=64, description="The waveforms."
    )

    def packed(self, duration_s: float, budget: Budget) -> Packed:
        """Return the packed parts, each as far as it will be evaluated, and their durations."""
        parts = [
            each.waveform.packed(min(each.duration_s, duration_s), budget) for each in self.parts
        ]
        durations_s = [each.duration_s for each in self.parts]
        return {"kind": self.kind, "durations_s": durations_s, "parts": parts}

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the parts one after the other."""
        durations_s = packed["durations_s"]
        starts_s = [0.0, *accumulate(durations_s[:-1])]
        parts = [_unpacked(part) for part in packed["parts"]]
        values = [part.value for part in parts]

        def value(t_s: float) -> float:
            index = max(bisect_right(starts_s, t_s) - 1, 0)
            local_s = t_s - starts_s[index]
            return values[index](local_s if local_s < durations_s[index] else durations_s[index])

        low, high = min(part.low for part in parts), max(part.high for part in parts)
        return Waveform(value, low, high, max(part.highest_hz for part in parts))


AnyWaveform: TypeAlias = Single | Sum | Sequence
WaveformConfig: TypeAlias = Annotated[AnyWaveform, BY_KIND]
KINDS: Final[Mapping[str, type[WaveformModel]]] = by_kind(AnyWaveform)
"""Every waveform by its kind."""


def pack_waveforms(waveforms: Mapping[str, WaveformConfig], duration_s: float) -> dict[str, Packed]:
    """Return the waveforms of a request, packed so that the loop builds nothing large.

    Random paths become points, and long paths become arrays of doubles, which the loop takes over
    with one copy. Everything else is small, and its amount is limited.

    Args:
        waveforms: Waveforms by axis.
        duration_s: Longest time that will be evaluated, in s.

    Raises:
        WaveformCostError: If they are too large for the loop.
    """
    budget = Budget(MAX_POINTS, MAX_TERMS)
    return {axis: config.packed(duration_s, budget) for axis, config in waveforms.items()}


def unpack_waveforms(packed: Mapping[str, Packed]) -> dict[str, Waveform]:
    """Return the waveforms that `pack_waveforms` packed. Real-time safe.

    They were validated before, and are not validated again.

    Raises:
        AttributeError: If a value is missing; likewise KeyError and TypeError.
        KeyError: If a kind is unknown.
        ValueError: If the bytes are no doubles.
    """
    return {axis: _unpacked(each) for axis, each in packed.items()}


def _unpacked(packed: Packed) -> Waveform:
    return KINDS[packed["kind"]].unpacked(packed)
