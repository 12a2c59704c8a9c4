"""What a configuration may say about a CANopen node with analogue inputs and outputs."""

from collections.abc import Iterator
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, StringConstraints, model_validator

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.devices.interface import ChannelUnits
from piezod_drivers.can_bus.cia401.objects import MOST_WORDS
from piezod_drivers.can_bus.options import BusOptions, TimeoutMs

NodeNumber: TypeAlias = Annotated[int, Quantity(1, 127)]
_Code: TypeAlias = Annotated[int, Quantity(-32_768, 65_535)]
_Value: TypeAlias = Annotated[float, Quantity(-1e6, 1e6)]
_Unit: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=8)]


class NodeInput(ConfigModel):
    """An analogue input."""

    number: Annotated[int, Quantity(1, 254)] = Field(
        description="Of the input on the node: the sub-index of object 0x6401."
    )
    code_at_min: _Code = Field(description="What it shows at the lowest value of `range`.")
    code_at_max: _Code = Field(description="What it shows at the highest value of `range`.")
    range: tuple[_Value, _Value] = Field(
        description="Lowest and highest value, in `unit`: the range of the converter."
    )
    unit: _Unit = Field(default="V", description="Of its values.")

    @model_validator(mode="after")
    def _check_codes(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterator[BrokenRule]:
        codes = self.code_at_min, self.code_at_max
        if codes[0] == codes[1]:
            yield ("code_at_max",), f"must differ from code_at_min (got {codes[1]} for both)"
        if min(codes) < 0 and max(codes) > 32_767:
            what = "16 bits hold codes from -32768 to 32767, or from 0 to 65535"
            yield ("code_at_max",), f"{what} (got {min(codes)} and {max(codes)})"
        if not self.range[0] < self.range[1]:
            yield ("range", 1), "must be above the first of the two"


class NodeOutput(NodeInput):
    """An analogue output; its number is the sub-index of object 0x6411."""

    safe_code: Annotated[int, Quantity(-(2**31), 2**31 - 1)] | None = Field(
        default=None,
        description="What object 0x6444 is set to, as the node's manual has it: there the code is "
        "as in 0x6411, or shifted to the left. The node takes it when this host falls silent. "
        "Left out: the output stays as it is then.",
    )


class Cia401Options(ConfigModel):
    """Options of a CANopen node with analogue inputs and outputs, by CiA 401."""

    bus: BusOptions = Field(description="The bus.")
    node: NodeNumber = Field(description="Number of the node.")
    inputs: dict[ChannelName, NodeInput] = Field(
        default_factory=dict, description="Inputs by the names that axes call them."
    )
    outputs: dict[ChannelName, NodeOutput] = Field(
        default_factory=dict, description="Outputs likewise."
    )
    read_back: Literal["sdo", "pdo", "none"] = Field(
        default="sdo",
        description="How outputs are read back: sdo, two more frames each, which every node can; "
        "pdo, with the inputs, which some nodes can; or not at all.",
    )
    timeout_ms: TimeoutMs = Field(default=5.0, description="How long to wait in a cycle, ms.")
    heartbeat_ms: Annotated[int, Quantity(0, 10_000, "ms")] = Field(
        default=100, description="How often the node shows that it lives, ms; 0: not at all."
    )
    host_node: NodeNumber = Field(
        default=126, description="This host's number; no other node on the bus may have it."
    )
    watchdog_ms: Annotated[int, Quantity(10, 10_000, "ms")] = Field(
        default=200,
        description="After so long without a sign of this host the node takes its safe codes, ms.",
    )
    rpdo: Annotated[int, Quantity(1, 512)] = Field(
        default=2, description="Which PDO sets the outputs, as the node numbers them."
    )
    tpdo: Annotated[int, Quantity(1, 512)] = Field(
        default=2, description="Which PDO tells the inputs."
    )

    @model_validator(mode="after")
    def _check_node(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if not self.inputs and not self.outputs:
            yield ("inputs",), "name at least one input or output of the node"
        told = len(self.inputs) + (len(self.outputs) if self.read_back == "pdo" else 0)
        for key, count in (("inputs", told), ("outputs", len(self.outputs))):
            if count > MOST_WORDS:
                what = f"{MOST_WORDS} channels go into a PDO (got {count})"
                yield (key,), f"{what}: leave out those that no axis uses"
        if self.host_node == self.node:
            yield ("host_node",), "must not be the number of the node"


def channels(options: Cia401Options) -> ChannelUnits:
    """Tell the channels that a configuration names, with their units."""
    return ChannelUnits(
        {name: channel.unit for name, channel in options.inputs.items()},
        {name: channel.unit for name, channel in options.outputs.items()},
    )
