"""What may be said of a device that speaks in lines of text, before the rules that span fields."""

from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import ConfigModel, Quantity
from piezod_drivers.serial_line.ascii_line.patterns import Pattern
from piezod_drivers.serial_line.ascii_line.templates import Template
from piezod_drivers.serial_line.options import LineOptions

Key: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,30}$")]
"""A channel's name, as it stands in commands and patterns."""
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
    """A command and its answer."""

    send: Template = Field(
        description="The command; {x:.3f} is the value of channel x, {n} a number that goes round."
    )
    reply: Pattern | None = Field(
        default=None,
        description="Regular expression for the whole answer; (?P<x>…) is the value of channel x, "
        "(?P<n>…) the number that was sent. Left out: the device does not answer.",
    )


class FlagConfig(ConfigModel):
    """What a line means."""

    pattern: Pattern = Field(description="Regular expression for the whole line.")
    flag: FlagName = Field(description="What is the matter with the device.")


class StatusConfig(ConfigModel):
    """A question for the status."""

    send: Template = Field(description="The command.")
    every_ms: Annotated[float, Quantity(10, 10_000, "ms")] = Field(
        default=100.0, description="How often it is sent, after a setpoint or a sample, ms."
    )
    flags: tuple[FlagConfig, ...] = Field(
        min_length=1, max_length=20, description="What the answer means; all that match are told."
    )


class AsciiOutputConfig(ConfigModel):
    """A channel that is driven."""

    unit: Unit = Field(default="V", description="Unit of its values: V, µm, %, ….")
    lowest: Value = Field(description="Lowest value that is sent.")
    highest: Value = Field(description="Highest value that is sent.")
    tolerance: Annotated[float, Quantity(0, 1e9)] | None = Field(
        default=None,
        description="How far from a setpoint without an answer the value read back may be, just "
        "after it; for a device that reads the setpoint back. Left out: not compared.",
    )


class AsciiInputConfig(ConfigModel):
    """A channel that is read."""

    unit: Unit = Field(default="µm", description="Unit of its values: µm, V, counts, ….")


class AsciiFields(LineOptions):
    """The fields of the options."""

    terminator: Terminator = Field(default="\n", description="What ends a command.")
    reply_terminator: Terminator | None = Field(
        default=None, description="What ends an answer; left out: the same."
    )
    encoding: Literal["ascii", "latin-1", "utf-8"] = Field(
        default="ascii", description="How characters become bytes."
    )
    longest_reply: Annotated[int, Quantity(1, 250, "bytes")] = Field(
        default=120, description="A longer line is garbage."
    )
    max_rate_hz: Annotated[float, Quantity(0.1, 20_000, "Hz")] = Field(
        default=50.0, description="The fastest loop that device and line can follow, Hz."
    )
    inputs: Mapping[Key, AsciiInputConfig] = Field(
        default={}, description="Channels that are read."
    )
    outputs: Mapping[Key, AsciiOutputConfig] = Field(
        default={}, description="Channels that are driven."
    )
    identify: AskConfig | None = Field(
        default=None,
        description="Asks who is there; groups maker, model, serial, firmware tell, others match.",
    )
    start: tuple[AskConfig, ...] = Field(
        default=(),
        max_length=20,
        description="Sent before the first setpoint or sample; not if none of the outputs is used.",
    )
    stop: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Sent at the end, likewise."
    )
    set: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Set the outputs, one or several at a time."
    )
    read: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Read the inputs, one or several at a time."
    )
    read_back: tuple[AskConfig, ...] = Field(
        default=(), max_length=20, description="Ask what is in force at the outputs."
    )
    status: StatusConfig | None = Field(default=None, description="Asks what is the matter.")
    errors: tuple[FlagConfig, ...] = Field(
        default=(), max_length=20, description="Lines that come in place of any answer."
    )
    stream: Pattern | None = Field(
        default=None, description="A line that comes unasked, again and again; instead of `read`."
    )

    @property
    def reply_ending(self) -> str:
        """What ends an answer."""
        return self.terminator if self.reply_terminator is None else self.reply_terminator
