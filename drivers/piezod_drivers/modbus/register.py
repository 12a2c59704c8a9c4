"""A register of a device: its options, and the conversion between its words and a number."""

from collections.abc import Callable, Iterator
from struct import Struct
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.status import DeviceFlag

NumberType: TypeAlias = Literal["int16", "uint16", "int32", "uint32", "float32"]
Role: TypeAlias = Literal["input", "output", "read-back", "status"]
Table: TypeAlias = Literal["holding", "input", "coil", "discrete"]
WordOrder: TypeAlias = Literal["big", "little"]
Address: TypeAlias = Annotated[int, Quantity(0, 65_535)]
Value: TypeAlias = Annotated[float, Quantity(-1e9, 1e9)]

BITS: Final = frozenset({"coil", "discrete"})
"""The tables of bits."""
STRUCTS: Final[dict[NumberType, Struct]] = {
    "int16": Struct(">h"),
    "uint16": Struct(">H"),
    "int32": Struct(">i"),
    "uint32": Struct(">I"),
    "float32": Struct(">f"),
}
"""Coding of the number types, most significant byte first."""
_LIMITS: Final = {
    "int16": (-(2**15), 2**15 - 1),
    "uint16": (0, 2**16 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}

Unpack: TypeAlias = Callable[[bytes, int], float]
"""Returns the number whose first byte is at an offset."""
Pack: TypeAlias = Callable[[float], bytes]
"""Returns the words of a number."""


class Register(ConfigModel):
    """One number that a device holds: value = scale · number + offset."""

    channel: ChannelName | None = Field(
        default=None,
        description="Name of the channel. For a read-back: name of its output. For a status: the "
        "channel that it concerns; left out: all channels of the unit.",
    )
    role: Role = Field(description="Use: input, output, read-back of an output, or status.")
    table: Table = Field(
        default="holding",
        description="Table: holding, input, coil or discrete; the last two hold bits, 0 or 1.",
    )
    address: Address = Field(description="Address as sent: 0 for 40001 or 30001 of some manuals.")
    type: NumberType = Field(default="uint16", description="Coding of the number.")
    words: WordOrder = Field(
        default="big",
        description="Word of a 32-bit number that comes first: high (big) or low (little).",
    )
    scale: Value = Field(default=1.0, description="Change of the value per count.")
    offset: Value = Field(default=0.0, description="Value at the number 0.")
    unit: Annotated[str, StringConstraints(min_length=1, max_length=8)] = Field(
        default="V", description="Unit of the value."
    )
    range: tuple[Value, Value] | None = Field(
        default=None,
        description="Lowest and highest value. An output is never set beyond it; an input beyond "
        "it is saturated.",
    )
    flag: DeviceFlag | None = Field(
        default=None,
        strict=False,
        description="Fault that a status reports: overload, watchdog tripped, …",
    )
    mask: Annotated[int, Quantity(1, 2**32 - 1)] = Field(
        default=1, description="For a status: the fault is present if one of these bits is set."
    )

    @property
    def size(self) -> int:
        """Number of words, or of bits."""
        return 1 if self.table in BITS or self.type in {"int16", "uint16"} else 2

    @property
    def sets_coil(self) -> bool:
        """Whether it is an output of one bit."""
        return self.role == "output" and self.table == "coil"

    @property
    def low(self) -> float:
        """Lowest value."""
        lowest = 0.0 if self.sets_coil else float("-inf")
        return lowest if self.range is None else self.range[0]

    @property
    def high(self) -> float:
        """Highest value."""
        highest = 1.0 if self.sets_coil else float("inf")
        return highest if self.range is None else self.range[1]

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.role == "status":
            if self.flag is None:
                yield ("flag",), "a status needs a flag: the fault that it reports"
            if self.type == "float32" and self.table not in BITS:
                yield ("type",), "a status must be a whole number, such as uint16"
        elif self.channel is None:
            yield ("channel",), "give the channel a name"
        if self.role != "status" and self.table in BITS:
            for key in self.model_fields_set & {"type", "words", "scale", "offset", "range"}:
                yield (key,), "a bit is 0 or 1: leave it out"
        if self.role == "output" and not self.sets_coil:
            yield from self._broken_rules_of_output()
        # Values are divided by the scale.
        if abs(self.scale) < 1e-12:
            yield (
                ("scale",),
                f"too small (got {self.scale:g}), allowed: magnitudes of 1e-12 and more",
            )
        if self.range is not None and not self.range[0] < self.range[1]:
            yield ("range", 1), "must be above the first of the two"
        if self.address + self.size > 65_536:
            yield ("address",), "a number of two words does not fit there, allowed: 65534 and less"

    def _broken_rules_of_output(self) -> Iterator[BrokenRule]:
        if self.table != "holding":
            yield ("table",), "only holding registers and coils can be written"
        if self.range is None:
            yield ("range",), "an output needs a range, so that it is never driven beyond it"
        elif self.type != "float32" and abs(self.scale) >= 1e-12:
            low, high = _LIMITS[self.type]
            ends = sorted((value - self.offset) / self.scale for value in self.range)
            # `packer` rounds, so an excess of half a count still fits.
            if ends[0] < low - 0.5 or ends[1] > high + 0.5:
                what = f"numbers {ends[0]:g} to {ends[1]:g} do not fit into {self.type}"
                yield ("range",), f"{what}, {low} to {high}"


def unpacker(register: Register) -> Unpack:
    """Return the function that reads the number of a register from bytes."""
    unpack_from = STRUCTS[register.type].unpack_from
    if register.size == 1 or register.words == "big":
        return lambda data, at: unpack_from(data, at)[0]
    # Low word first: swap the words; inside a word the high byte always comes first.
    return lambda data, at: unpack_from(data[at + 2 : at + 4] + data[at : at + 2])[0]


def packer(register: Register) -> Pack:
    """Return the function that converts a value within the range into the register's words."""
    pack = STRUCTS[register.type].pack
    scale, offset = register.scale, register.offset
    if register.type == "float32":
        words: Pack = lambda value: pack((value - offset) / scale)  # noqa: E731 - one of two
    else:
        low, high = _LIMITS[register.type]
        words = lambda value: pack(min(max(round((value - offset) / scale), low), high))  # noqa: E731 - likewise
    if register.size == 1 or register.words == "big":
        return words
    return lambda value: (packed := words(value))[2:] + packed[:2]
