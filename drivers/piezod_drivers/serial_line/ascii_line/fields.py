"""The single options of a device that speaks in lines of text, without the rules between them."""

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import ConfigModel, Quantity
from piezod_drivers.serial_line.ascii_line.patterns import Pattern
from piezod_drivers.serial_line.ascii_line.templates import Template
from piezod_drivers.serial_line.options import LineOptions

Key: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,30}$")]
"""Name of a channel, as used in commands and patterns."""
Unit: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=10)]
Terminator: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4)]
Value: TypeAlias = Annotated[float, Quantity(-1e9, 1e9)]
FlagName: TypeAlias = Literal[
    "wrong request",
    "device failure",
    "busy",
    "overload",
    "over-temperature",
    "local mode",
    "watchdog tripped",
    "short or open",
    "low light",
    "saturated",
]


class AskConfig(ConfigModel):
    """Options of a command and its reply."""

    send: Template = Field(
        description="Command; {x:.3f} is the value of channel x, {n} a running number."
    )
    reply: Pattern | None = Field(
        default=None,
        description="Regular expression for the whole reply; (?P<x>…) is the value of channel x, "
        "(?P<n>…) the running number. Left out: the command has no reply.",
    )


class FlagConfig(ConfigModel):
    """Options of a line that reports a fault."""

    pattern: Pattern = Field(description="Regular expression for the whole line.")
    flag: FlagName = Field(description="Fault that the line reports.")


class StatusConfig(ConfigModel):
    """Options of the status request."""

    send: Template = Field(description="Command.")
    every_ms: Annotated[float, Quantity(10, 10_000, "ms")] = Field(
        default=100.0, description="Period of the request, ms; it follows a setpoint or a sample."
    )
    flags: tuple[FlagConfig, ...] = Field(
        min_length=1, max_length=20, description="Faults; all whose pattern matches are reported."
    )


class AsciiOutputConfig(ConfigModel):
    """Options of an output."""

    unit: Unit = Field(default="V", description="Unit of the values: V, µm, %, ….")
    lowest: Value = Field(description="Lowest value that is sent.")
    highest: Value = Field(description="Highest value that is sent.")
    tolerance: Annotated[float, Quantity(0, 1e9)] | None = Field(
        default=None,
        description="Largest difference between a setpoint without reply and the value that is "
        "read back just after it, for a device that reads back the setpoint. Left out: no check.",
    )


class AsciiInputConfig(ConfigModel):
    """Options of an input."""

    unit: Unit = Field(default="µm", description="Unit of the values: µm, V, counts, ….")


class AsciiFields(LineOptions):
    """All options of the driver, without the rules between them."""

    terminator: Terminator = Field(default="\n", description="End of a command.")
    reply_terminator: Terminator | None = Field(
        default=None, description="End of a reply; left out: the same."
    )
    encoding: Literal["ascii", "latin-1", "utf-8"] = Field(
        default="ascii", description="Encoding of characters."
    )
    longest_reply: Annotated[int, Quantity(1, 250, "bytes")] = Field(
        default=120, description="Length of the longest reply; a longer line is garbage."
    )
    max_rate_hz: Annotated[float, Quantity(0.1, 20_000, "Hz")] = Field(
        default=50.0, description="Highest rate that device and line allow, Hz."
    )
    inputs: Mapping[Key, AsciiInputConfig] = Field(default={}, description="Inputs by name.")
    outputs: Mapping[Key, AsciiOutputConfig] = Field(default={}, description="Outputs by name.")
    identify: AskConfig | None = Field(
        default=None,
        description="Requests the identity; groups of the reply: maker, model, serial, firmware.",
    )
    start: tuple[AskConfig, ...] = Field(
        default=(),
        max_length=20,
        description="Sent before the first setpoint or sample, unless none of the outputs is used.",
    )
    stop: tuple[AskConfig, ...] = Field(
        default=(),
        max_length=20,
        description="Sent at the end, unless none of the outputs is used.",
    )
    set: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Set the outputs, one or several per command."
    )
    read: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Read the inputs, one or several per command."
    )
    read_back: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Read back the outputs."
    )
    status: StatusConfig | None = Field(default=None, description="Requests the status.")
    errors: tuple[FlagConfig, ...] = Field(
        default=(), max_length=20, description="Lines that may replace any reply."
    )
    stream: Pattern | None = Field(
        default=None, description="Line that the device sends by itself; instead of `read`."
    )

    @property
    def reply_ending(self) -> str:
        """End of a reply."""
        return self.terminator if self.reply_terminator is None else self.reply_terminator
