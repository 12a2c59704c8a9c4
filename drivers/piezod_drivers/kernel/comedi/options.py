"""Options of a converter card."""

from collections.abc import Iterator
from itertools import chain
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


class CardLine(ConfigModel):
    """A digital line, which is high at the value 1 and low at 0."""

    number: _Number = Field(description="Number of the channel on its subdevice.")
    subdevice: _Number | None = Field(
        default=None, description="Number of the subdevice; default: the first one that can."
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
    digital_inputs: dict[ChannelName, CardLine] = Field(
        default_factory=dict, description="Digital inputs by channel name."
    )
    digital_outputs: dict[ChannelName, CardLine] = Field(
        default_factory=dict, description="Digital outputs by channel name."
    )
    calibration: _Path | None = Field(
        default=None,
        description="Calibration file of a card that is calibrated by software; default: where "
        "comedi_soft_calibrate has written it.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not any(chain(*channels(self))):
            yield ("inputs",), "give at least one input or output"
        for name in self.inputs.keys() & self.digital_inputs.keys():
            yield ("digital_inputs", name), "is the name of one of the inputs, too"
        for name in self.outputs.keys() & self.digital_outputs.keys():
            yield ("digital_outputs", name), "is the name of one of the outputs, too"
        numbers = [output.number for output in self.outputs.values()]
        if len(set(numbers)) < len(numbers):
            yield ("outputs",), "two outputs have the same number"
        lines = [(line.subdevice, line.number) for line in self.digital_outputs.values()]
        if len(set(lines)) < len(lines):
            yield ("digital_outputs",), "two outputs are the same line"


def channels(options: ComediOptions) -> ChannelUnits:
    """Return the configured channels: in V, and lines, which are 0 or 1."""
    return ChannelUnits(
        dict.fromkeys(options.inputs, "V") | dict.fromkeys(options.digital_inputs, "level"),
        dict.fromkeys(options.outputs, "V") | dict.fromkeys(options.digital_outputs, "level"),
    )
