"""The trim of an axis: a slow integral of the measured error on top of an inverse model."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity

TrimBase: TypeAlias = Literal["feedforward", "adaptive"]


class TrimConfig(ConfigModel):
    """What mode `trimmed` adds to an inverse model."""

    base: TrimBase = Field(default="feedforward", description="Mode that the trim is added to.")
    gain_per_s: Annotated[float, Quantity(0.01, 5000, "1/s")] = Field(
        default=50.0, description="Gain of the integral: an error fades with 1/gain, 1/s."
    )
    authority_pct: Annotated[float, Quantity(0.1, 20, "%")] = Field(
        default=5.0, description="Most that the trim may add, either way, % of the range."
    )
