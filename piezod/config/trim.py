"""The feedback of an axis: integral and share of the measured error, added to an inverse model."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity

TrimBase: TypeAlias = Literal["feedforward", "adaptive"]


class TrimConfig(ConfigModel):
    """Parameters of the trim of mode `trimmed`."""

    base: TrimBase = Field(default="feedforward", description="Mode that the trim is added to.")
    gain_per_s: Annotated[float, Quantity(0.01, 5000, "1/s")] | None = Field(
        default=None,
        description="Gain of the integral, 1/s: errors decay with time constant 1/gain; default: "
        "50, or the largest gain with enough margin if that is smaller.",
    )
    proportional: Annotated[float, Quantity(0, 2)] = Field(
        default=0.0, description="Share of the error that is added to the integral."
    )
    notch: Literal["auto", "none"] = Field(
        default="auto",
        description="Notches of the trim: at the modes of the response, if it is known, or none.",
    )
    authority_pct: Annotated[float, Quantity(0.1, 20, "%")] = Field(
        default=5.0, description="Largest magnitude of the trim, % of the range."
    )


class ClosedConfig(ConfigModel):
    """Parameters of the feedback of mode `closed`."""

    gain_per_s: Annotated[float, Quantity(0.01, 50_000, "1/s")] | None = Field(
        default=None,
        description="Gain of the integral, 1/s; default: 100, or the largest gain with enough "
        "margin if that is smaller.",
    )
    proportional: Annotated[float, Quantity(0, 2)] = Field(
        default=0.0, description="Share of the error that is added to the integral."
    )
    authority_pct: Annotated[float, Quantity(0.1, 100, "%")] = Field(
        default=20.0, description="Largest magnitude of the feedback, % of the range."
    )
