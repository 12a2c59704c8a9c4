"""Options of a converter that an IIO driver of the kernel drives."""

from collections.abc import Iterator
from typing import Annotated, Final, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.interface import ChannelUnits

_Path: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
_Raw: TypeAlias = Annotated[int, Quantity(-(2**31), 2**32 - 1)]
_INPUT: Final = r"^in_[a-z]+[0-9]*(-[a-z]+[0-9]*)?$"
_OUTPUT: Final = r"^out_[a-z]+[0-9]*(-[a-z]+[0-9]*)?$"
UNITS: Final = {"voltage": ("V", 1e-3), "current": ("mA", 1.0), "distance": ("µm", 1e6)}
"""Unit of each type of channel, and its size in the kernel's unit: mV, mA, m."""
RAW: Final = ("raw", 1.0)


class _Channel(ConfigModel):
    """A channel."""

    scale: Annotated[float, Quantity(-1e6, 1e6)] | None = Field(
        default=None,
        description="Value of a raw step, in the unit of the channel; needed if the driver has no "
        "file for it, otherwise it replaces that one.",
    )


class IioInput(_Channel):
    """An input."""

    file: Annotated[str, StringConstraints(pattern=_INPUT)] = Field(
        description="Beginning of the name of its files: in_voltage0, in_voltage0-voltage1."
    )
    raw: tuple[_Raw, _Raw] | None = Field(
        default=None,
        description="Lowest and highest raw value: a sample at one of them counts as saturated.",
    )


class IioOutput(_Channel):
    """An output."""

    file: Annotated[str, StringConstraints(pattern=_OUTPUT)] = Field(
        description="Beginning of the name of its files: out_voltage0."
    )
    raw: tuple[_Raw, _Raw] = Field(
        description="Lowest and highest raw value: for 12 bits [0, 4095]."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.raw[0] < self.raw[1]:
            yield ("raw", 1), "must be above the first of the two"


class IioOptions(ConfigModel):
    """Options of one device of IIO; a converter for each direction is a device of its own."""

    device: _Path = Field(
        description="Name of the chip, as its file `name` tells; if there are several, the folder: "
        "/sys/bus/iio/devices/iio:device0."
    )
    inputs: dict[ChannelName, IioInput] = Field(
        default_factory=dict, description="Inputs by channel name."
    )
    outputs: dict[ChannelName, IioOutput] = Field(
        default_factory=dict, description="Outputs by channel name."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.inputs and not self.outputs:
            yield ("inputs",), "give at least one input or output"


def unit_of(file: str) -> tuple[str, float]:
    """Return the unit of a channel, and its size in the kernel's unit."""
    kind = file.partition("_")[2].partition("-")[0].rstrip("0123456789")
    return UNITS.get(kind, RAW)


def channels(options: IioOptions) -> ChannelUnits:
    """Return the configured channels with their units."""
    return ChannelUnits(
        {name: unit_of(channel.file)[0] for name, channel in options.inputs.items()},
        {name: unit_of(channel.file)[0] for name, channel in options.outputs.items()},
    )
