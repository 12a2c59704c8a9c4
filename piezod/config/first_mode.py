"""The first mechanical mode of an axis, in configurations and in model files."""

from typing import Annotated

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity


class FirstModeConfig(ConfigModel):
    """The first mechanical mode of an axis, from its data sheet or a measurement."""

    frequency_hz: Annotated[float, Quantity(1, 100_000, "Hz")] = Field(
        description="Undamped frequency, Hz."
    )
    damping: Annotated[float, Quantity(0.001, 1)] = Field(description="Damping ratio.")


class FoundModeConfig(FirstModeConfig):
    """The first mode in a model file, with the lag of amplifier and sensor in the record."""

    lag_s: Annotated[float, Quantity(0, 1, "s")] = Field(
        default=0.0, description="Time constant of a lag of first order, part of `delay_s`, s."
    )
