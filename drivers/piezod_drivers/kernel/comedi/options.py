"""Options of a converter card."""

from collections.abc import Iterator
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.interface import ChannelUnits

_Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]
_Number: TypeAlias = Annotated[int, Quantity(0, 255)]
_Path: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
REFERENCES: Final = {"ground": 0, "common": 1, "diff": 2, "other": 3}


class CardInput(ConfigModel):
    """An analogue input or output."""

    number: _Number = Field(description="Number of the channel on the card.")
    range: tuple[_Volts, _Volts] = Field(
        default=(-10.0, 10.0),
        description="Lowest and highest voltage, V; the card uses its smallest range with both.",
    )
    reference: Literal["ground", "common", "diff", "other"] = Field(
        default="ground", description="What the voltage is measured against, as wired."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.range[0] < self.range[1]:
            yield ("range", 1), "must be above the first of the two"


class CardOutput(CardInput):
    """An analogue output."""

    measured_by: CardInput | None = Field(
        default=None,
        description="An input that is wired to this output: reads it back. Plays need it.",
    )


class ComediOptions(ConfigModel):
    """Options of a converter card that a comedi driver of the kernel drives."""

    port: _Path = Field(default="/dev/comedi0", description="File of the card.")
    inputs: dict[ChannelName, CardInput] = Field(
        default_factory=dict, description="Inputs by channel name."
    )
    outputs: dict[ChannelName, CardOutput] = Field(
        default_factory=dict, description="Outputs by channel name."
    )
    calibration: _Path | None = Field(
        default=None,
        description="Calibration file of a card that is calibrated by software; default: where "
        "comedi_soft_calibrate has written it.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.inputs and not self.outputs:
            yield ("inputs",), "give at least one input or output"
        numbers = [output.number for output in self.outputs.values()]
        if len(set(numbers)) < len(numbers):
            yield ("outputs",), "two outputs have the same number"


def channels(options: ComediOptions) -> ChannelUnits:
    """Return the configured channels, in V."""
    return ChannelUnits(dict.fromkeys(options.inputs, "V"), dict.fromkeys(options.outputs, "V"))
