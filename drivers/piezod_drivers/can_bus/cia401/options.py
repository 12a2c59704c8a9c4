"""Options of a CANopen node with analogue inputs and outputs."""

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.interface import ChannelUnits
from piezod_drivers.can_bus.cia401.objects import MOST_WORDS
from piezod_drivers.can_bus.options import BusOptions, TimeoutMs

NodeNumber: TypeAlias = Annotated[int, Quantity(1, 127)]
_Code: TypeAlias = Annotated[int, Quantity(-32_768, 65_535)]
_Value: TypeAlias = Annotated[float, Quantity(-1e6, 1e6)]
_Unit: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=8)]


class NodeInput(ConfigModel):
    """Options of an analogue input."""

    number: Annotated[int, Quantity(1, 254)] = Field(
        description="Number of the input on the node: the sub-index of object 0x6401."
    )
    code_at_min: _Code = Field(description="Code at the lowest value of `range`.")
    code_at_max: _Code = Field(description="Code at the highest value of `range`.")
    range: tuple[_Value, _Value] = Field(
        description="Lowest and highest value, in `unit`: the range of the converter."
    )
    unit: _Unit = Field(default="V", description="Unit of its values.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        codes = self.code_at_min, self.code_at_max
        if codes[0] == codes[1]:
            yield ("code_at_max",), f"must differ from code_at_min (both are {codes[1]})"
        if min(codes) < 0 and max(codes) > 32_767:
            what = "16 bits hold codes from -32768 to 32767, or from 0 to 65535"
            yield ("code_at_max",), f"{what} (got {min(codes)} and {max(codes)})"
        if not self.range[0] < self.range[1]:
            yield ("range", 1), "must be above the first of the two"


class NodeOutput(NodeInput):
    """Options of an analogue output; its number is the sub-index of object 0x6411."""

    safe_code: Annotated[int, Quantity(-(2**31), 2**31 - 1)] | None = Field(
        default=None,
        description="Value of object 0x6444, in the form that the node's manual states: the code "
        "as in 0x6411, or shifted to the left. The node sets the output to it when this host has "
        "fallen silent. Left out: the output then holds its value.",
    )


class Cia401Options(ConfigModel):
    """Options of a CANopen node with analogue inputs and outputs, profile CiA 401."""

    bus: BusOptions = Field(description="The CAN bus.")
    node: NodeNumber = Field(description="Number of the node.")
    inputs: dict[ChannelName, NodeInput] = Field(
        default_factory=dict, description="Inputs by channel name."
    )
    outputs: dict[ChannelName, NodeOutput] = Field(
        default_factory=dict, description="Outputs by channel name."
    )
    read_back: Literal["sdo", "pdo", "none"] = Field(
        default="sdo",
        description="How outputs are read back: sdo takes two more frames for each output, and "
        "every node supports it; pdo reads them with the inputs, and some nodes support it; none.",
    )
    timeout_ms: TimeoutMs = Field(default=5.0, description="Longest wait for a reply, ms.")
    heartbeat_ms: Annotated[int, Quantity(0, 10_000, "ms")] = Field(
        default=100, description="Period of the node's heartbeat, ms; 0: none."
    )
    host_node: NodeNumber = Field(
        default=126, description="Node number of this host; no other node on the bus may have it."
    )
    watchdog_ms: Annotated[int, Quantity(10, 10_000, "ms")] = Field(
        default=200,
        description="After this time without this host's heartbeat the node sets safe codes, ms.",
    )
    rpdo: Annotated[int, Quantity(1, 512)] = Field(
        default=2, description="Number of the node's receive PDO that sets the outputs."
    )
    tpdo: Annotated[int, Quantity(1, 512)] = Field(
        default=2, description="Number of the node's transmit PDO that carries the inputs."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.inputs and not self.outputs:
            yield ("inputs",), "give at least one input or output"
        n_read = len(self.inputs) + (len(self.outputs) if self.read_back == "pdo" else 0)
        for key, count in (("inputs", n_read), ("outputs", len(self.outputs))):
            if count > MOST_WORDS:
                what = f"a PDO carries at most {MOST_WORDS} channels (got {count})"
                yield (key,), f"{what}: leave out the channels that no axis uses"
        if self.host_node == self.node:
            yield ("host_node",), "must not be the number of the node"


def channels(options: Cia401Options) -> ChannelUnits:
    """Return the configured channels with their units."""
    return ChannelUnits(
        {name: channel.unit for name, channel in options.inputs.items()},
        {name: channel.unit for name, channel in options.outputs.items()},
    )
