"""Envelopes: how the swing of a periodic waveform changes over time."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel
from piezod.config.quantities import DurationS, Fraction, FrequencyHz


class ConstantEnvelope(ConfigModel):
    """The swing stays the full one."""

    kind: Literal["constant"] = "constant"


class ModulatedEnvelope(ConfigModel):
    """The swing shrinks from the full one to the smallest and grows again, over and over."""

    kind: Literal["modulated"]
    depth: Fraction = Field(description="1 - smallest swing / full swing, 0 to 1.")
    frequency_hz: FrequencyHz = Field(description="How often the swing shrinks and grows, Hz.")


class DecayingEnvelope(ConfigModel):
    """The swing shrinks exponentially from the full one."""

    kind: Literal["decaying"]
    time_constant_s: DurationS = Field(description="Time constant of the decay, s.")
    final_fraction: Fraction = Field(
        default=0.0, description="Swing in the end / full swing, 0 to 1."
    )


Envelope: TypeAlias = Annotated[
    ConstantEnvelope | ModulatedEnvelope | DecayingEnvelope, Field(discriminator="kind")
]
