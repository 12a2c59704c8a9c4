"""What a configuration may say about a controller that speaks GCS 1."""

from typing import Annotated, Self, TypeAlias

from pydantic import Field, StringConstraints, model_validator

from piezod.config.fields import Quantity, raise_rules
from piezod_drivers.serial_line.options import PortOptions, TimeoutMs, ordered

Axis: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Z]$")]
Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]


class Gcs1Options(PortOptions):
    """Options of `pi_gcs1`; an E-816 comes with 38 400 or 115 200 bits per second."""

    rtscts: bool = Field(default=True, description="Whether RTS and CTS hold up the flow.")
    timeout_ms: TimeoutMs = Field(default=50.0, description="How long to wait for each reply, ms.")
    axes: tuple[Axis, ...] = Field(
        default=("A",), min_length=1, max_length=12, description="Axes that the controller has."
    )
    range_v: tuple[Volts, Volts] = Field(
        default=(-20.0, 120.0), description="Lowest and highest voltage of its amplifiers."
    )

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        raise_rules(ordered(self.range_v))
        return self
