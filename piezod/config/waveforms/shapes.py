"""Waveforms that a formula gives: a constant, and those that swing, with the envelopes of a swing.

A swing starts at its lowest value and rises, so
that with `low: 0` it leaves the rest position without a step.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import BrokenRule, Quantity
from piezod.config.quantities import DurationS, Fraction, FrequencyHz, Level, Size
from piezod.config.waveforms import formulas
from piezod.config.waveforms.formulas import Value
from piezod.config.waveforms.waveform import (
    Budget,
    Packed,
    Swinging,
    Timed,
    Waveform,
    WaveformModel,
    by_kind,
)


class EnvelopeModel(Timed):
    """The change of a swing over time."""

    @abstractmethod
    def scale(self) -> tuple[Value | None, float]:
        """Return the swing over time from 0 s on, 0 to 1, and by how many Hz it is faster.

        None in place of the first if the swing is 1 at all times.
        """


class ConstantEnvelope(EnvelopeModel):
    """The swing is constant."""

    kind: Literal["constant"] = "constant"

    def scale(self) -> tuple[Value | None, float]:
        """Return 1 at all times."""
        return None, 0.0


class ModulatedEnvelope(EnvelopeModel):
    """The swing shrinks to its smallest value and grows again, periodically."""

    kind: Literal["modulated"]
    depth: Fraction = Field(description="1 - smallest swing / full swing, 0 to 1.")
    frequency_hz: FrequencyHz = Field(description="Frequency of the modulation, Hz.")

    def scale(self) -> tuple[Value | None, float]:
        """Return 1 minus a raised cosine; a modulated sine has side bands in this distance."""
        return formulas.modulated(self.depth, self.frequency_hz), self.frequency_hz


class DecayingEnvelope(EnvelopeModel):
    """The swing decays exponentially."""

    kind: Literal["decaying"]
    time_constant_s: DurationS = Field(description="Time constant of the decay, s.")
    final_fraction: Fraction = Field(default=0.0, description="Final swing / full swing, 0 to 1.")

    def scale(self) -> tuple[Value | None, float]:
        """Return an exponential from 1 to the final fraction."""
        return formulas.decaying(self.time_constant_s, self.final_fraction), 0.0


Envelope: TypeAlias = ConstantEnvelope | ModulatedEnvelope | DecayingEnvelope
ENVELOPES: Final[Mapping[str, type[EnvelopeModel]]] = by_kind(Envelope)
"""Every envelope by its kind."""


class Formula(WaveformModel):
    """A waveform that a formula gives; it goes to the loop as it is."""

    @abstractmethod
    def formula(self) -> Waveform:
        """Return the waveform of its fields. Real-time safe."""

    def packed(self, duration_s: float, budget: Budget) -> Packed:  # noqa: ARG002 - it has no end
        """Return its fields, and take one term."""
        budget.take(terms=1)
        return self.model_dump()

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the waveform of fields, which were validated before."""
        return cls.model_construct(**packed).formula()


class Setpoint(Formula):
    """One constant value."""

    kind: Literal["setpoint"]
    level: Level = Field(description="The value.")

    def formula(self) -> Waveform:
        """Return a constant."""
        level = self.level
        return Waveform(lambda _: level, level, level, 0.0)


class Enveloped(Swinging, Formula):
    """A swing between two values, whose size may change over time."""

    envelope: Annotated[Envelope, Field(discriminator="kind")] = Field(
        default=ConstantEnvelope(), description="Change of the swing over time."
    )
    anchor: Literal["low", "middle"] = Field(
        default="low", description="Level that stays constant while the swing changes."
    )

    @abstractmethod
    def part(self) -> tuple[Value, float]:
        """Return the full swing over time from 0 s on, 0 to 1, and its highest frequency in Hz."""

    def formula(self) -> Waveform:
        """Return the swing, scaled by the envelope about its anchor."""
        anchor = 0.5 if self.anchor == "middle" else 0.0
        (part, part_hz), (scale, scale_hz) = self.part(), self.envelope.scale()
        value = formulas.swing(part, scale, self.low, self.high, anchor)
        return Waveform(value, self.low, self.high, part_hz + scale_hz)

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the waveform of fields and envelope, which were validated before."""
        fields = packed["envelope"]
        envelope = ENVELOPES[fields["kind"]].model_construct(**fields)
        return super().unpacked(packed | {"envelope": envelope})


class Periodic(Enveloped):
    """Common fields of sine and triangle."""

    frequency_hz: FrequencyHz = Field(description="Frequency, Hz.")

    def begin_and_end_s(self) -> tuple[float, float]:
        """Return when the first period begins and ends, in s."""
        return 0.0, 1.0 / self.frequency_hz

    def broken_period(self) -> Iterator[BrokenRule]:
        """Yield why it does not repeat."""
        if not isinstance(self.envelope, ConstantEnvelope):
            yield ("envelope",), "must be constant: a table is periodic"


class Sine(Periodic):
    """A sinusoid between two values."""

    kind: Literal["sine"]

    def part(self) -> tuple[Value, float]:
        """Return a raised cosine."""
        return formulas.raised_cosine(self.frequency_hz), self.frequency_hz


class Triangle(Periodic):
    """A symmetric triangle between two values."""

    kind: Literal["triangle"]

    def part(self) -> tuple[Value, float]:
        """Return straight lines up and down."""
        return formulas.triangle(self.frequency_hz), self.frequency_hz


AnyPeriodic: TypeAlias = Sine | Triangle
"""Every waveform with a period."""


class Chirp(Enveloped):
    """A sinusoid whose frequency runs from one value to another, and stays there."""

    kind: Literal["chirp"]
    from_hz: FrequencyHz = Field(description="Frequency at the start, Hz.")
    to_hz: FrequencyHz = Field(description="Frequency from the end of the sweep on, Hz.")
    sweep_s: DurationS = Field(description="Duration of the sweep, s.")
    sweep: Literal["linear", "logarithmic"] = Field(
        default="linear",
        description="Whether the frequency grows by equal steps or by equal factors.",
    )

    def part(self) -> tuple[Value, float]:
        """Return a raised cosine; its phase, the integral of the frequency, has no steps."""
        linear = self.sweep == "linear"
        part = formulas.swept_cosine(self.from_hz, self.to_hz, self.sweep_s, linear=linear)
        return part, max(self.from_hz, self.to_hz)


class Component(Timed):
    """One sinusoid of a multisine."""

    amplitude: Size = Field(description="Amplitude: half of the peak-to-peak value.")
    frequency_hz: FrequencyHz = Field(description="Frequency, Hz.")
    phase_deg: Annotated[float, Quantity(-360, 360, "°")] = Field(
        default=0.0, description="Phase at t = 0, relative to the lowest point, °."
    )


class Multisine(Formula):
    """A sum of sinusoids, each raised by its amplitude so that the sum stays above `low`."""

    kind: Literal["multisine"]
    low: Level = Field(description="Value if all sinusoids are at their lowest point.")
    components: tuple[Component, ...] = Field(
        min_length=1, max_length=64, description="The sinusoids."
    )

    def formula(self) -> Waveform:
        """Return the sum of the sinusoids above the lowest level."""
        low = high = self.low
        for component in self.components:
            high += 2 * component.amplitude
        components = [
            (part.amplitude, part.frequency_hz, math.radians(part.phase_deg))
            for part in self.components
        ]
        value = formulas.multisine(low, components)
        return Waveform(value, low, high, max(each.frequency_hz for each in self.components))

    def packed(self, duration_s: float, budget: Budget) -> Packed:
        """Return its fields, and take a term for each sinusoid."""
        budget.take(terms=len(self.components) - 1)
        return super().packed(duration_s, budget)

    @classmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the waveform of fields and sinusoids, which were validated before."""
        sines = tuple(Component.model_construct(**each) for each in packed["components"])
        return super().unpacked(packed | {"components": sines})


AnyFormula: TypeAlias = Setpoint | AnyPeriodic | Chirp | Multisine
"""Every waveform of this file."""
