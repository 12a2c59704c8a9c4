"""Envelopes: the change of a periodic waveform's swing over time."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel
from piezod.config.quantities import DurationS, Fraction, FrequencyHz


class ConstantEnvelope(ConfigModel):
    """The swing is constant."""

    kind: Literal["constant"] = "constant"


class ModulatedEnvelope(ConfigModel):
    """The swing shrinks to its smallest value and grows again, periodically."""

    kind: Literal["modulated"]
    depth: Fraction = Field(description="1 - smallest swing / full swing, 0 to 1.")
    frequency_hz: FrequencyHz = Field(description="Frequency of the modulation, Hz.")


class DecayingEnvelope(ConfigModel):
    """The swing decays exponentially."""

    kind: Literal["decaying"]
    time_constant_s: DurationS = Field(description="Time constant of the decay, s.")
    final_fraction: Fraction = Field(default=0.0, description="Final swing / full swing, 0 to 1.")


Envelope: TypeAlias = Annotated[
    ConstantEnvelope | ModulatedEnvelope | DecayingEnvelope, Field(discriminator="kind")
]
