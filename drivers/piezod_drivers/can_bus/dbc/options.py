"""Options of a device whose frames are described by their signals."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, NamedTuple, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.channels import ChannelName
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.config.files import ExistingFile
from piezod.config.messages import suggest
from piezod.devices.interface import ChannelUnits
from piezod.devices.status import DeviceFlag
from piezod_drivers.can_bus.dbc.checksum import Algorithm
from piezod_drivers.can_bus.dbc.codec import DbcMessage, DbcSignal
from piezod_drivers.can_bus.dbc.database import DatabaseError, load
from piezod_drivers.can_bus.frame import EXTENDED_IDS, STANDARD_IDS
from piezod_drivers.can_bus.options import BusOptions, TimeoutMs

_Word: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z_][A-Za-z0-9_]{0,127}$")]
_Factor: TypeAlias = Annotated[float, Quantity(-1e9, 1e9)]
_Flag: TypeAlias = Literal[
    "overload",
    "over-temperature",
    "local mode",
    "watchdog tripped",
    "short or open",
    "low light",
    "saturated",
    "device failure",
]


class SignalPlace(ConfigModel):
    """Names a signal of a message."""

    message: _Word = Field(description="Name of the message.")
    signal: _Word = Field(description="Name of the signal.")


class OutputPlace(SignalPlace):
    """Names the signal of an output."""

    read_back: SignalPlace | None = Field(
        default=None,
        description="Signal of the value in force; left out: the output is not read back.",
    )


class ChecksumPlace(ConfigModel):
    """Names the checksum of a message, one byte of the frame."""

    signal: _Word = Field(description="Name of the signal.")
    algorithm: Algorithm = Field(
        default="crc8_j1850", description="Algorithm over all other bytes: crc8_j1850, xor or sum."
    )


class SignalLayout(ConfigModel):
    """Describes a signal, in the terms of a DBC file."""

    start: Annotated[int, Quantity(0, 63)] = Field(
        description="First bit; bit i of byte j is 8·j + i. It is the lowest bit, or the highest "
        "bit of a big-endian signal."
    )
    bits: Annotated[int, Quantity(1, 64)] = Field(description="Number of bits.")
    big_endian: bool = Field(default=False, description="Whether the highest byte comes first.")
    signed: bool = Field(default=False, description="Whether the highest bit is the sign.")
    scale: _Factor = Field(default=1.0, description="Physical value of one count.")
    offset: _Factor = Field(default=0.0, description="Physical value of count 0.")
    range: tuple[_Factor, _Factor] | None = Field(
        default=None,
        description="Lowest and highest physical value; left out: those that the bits can hold.",
    )
    unit: Annotated[str, StringConstraints(max_length=8)] = Field(
        default="V", description="Unit of the physical value."
    )


class MessageLayout(ConfigModel):
    """Describes a message."""

    id: Annotated[int, Quantity(0, EXTENDED_IDS - 1)] = Field(description="Identifier.")
    extended: bool = Field(default=False, description="Whether the identifier has 29 bits.")
    bytes: Annotated[int, Quantity(0, 8)] = Field(default=8, description="Number of data bytes.")
    signals: dict[_Word, SignalLayout] = Field(default_factory=dict, description="Signals by name.")


class DbcOptions(ConfigModel):
    """Options of a device whose frames are described by a DBC file or by the configuration."""

    bus: BusOptions = Field(description="The CAN bus.")
    dbc: ExistingFile | None = Field(default=None, description="Path of the DBC file.")
    messages: dict[_Word, MessageLayout] = Field(
        default_factory=dict, description="Messages by name, instead of a DBC file."
    )
    inputs: dict[ChannelName, SignalPlace] = Field(
        default_factory=dict, description="Inputs by channel name."
    )
    outputs: dict[ChannelName, OutputPlace] = Field(
        default_factory=dict, description="Outputs by channel name."
    )
    request: _Word | None = Field(
        default=None,
        description="Message that requests the inputs; it must not set an output. Left out: the "
        "device sends its inputs by itself.",
    )
    counters: dict[_Word, _Word] = Field(
        default_factory=dict,
        description="By message: the signal that goes up by one with each frame.",
    )
    checksums: dict[_Word, ChecksumPlace] = Field(
        default_factory=dict, description="By message: its checksum."
    )
    echoes: dict[_Word, _Word] = Field(
        default_factory=dict,
        description="By message: the signal of a reply that repeats the counter of the request. "
        "With it, a late reply is never taken for the next one.",
    )
    constants: dict[_Word, dict[_Word, int]] = Field(
        default_factory=dict,
        description="By message: other signals to be sent, as raw numbers; signals that are left "
        "out are sent as 0.",
    )
    flags: dict[_Flag, SignalPlace] = Field(
        default_factory=dict,
        description="By fault: the signal that is not 0 while the fault lasts.",
    )
    timeout_ms: TimeoutMs = Field(default=5.0, description="Longest wait for replies, ms.")
    max_age_ms: TimeoutMs = Field(
        default=50.0, description="Highest age of a message that the device sends by itself, ms."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if (self.dbc is None) == (not self.messages):
            yield ("dbc",), "give either dbc, a file, or messages"
            return
        if not self.inputs and not self.outputs:
            yield ("inputs",), "give at least one input or output"
        try:
            messages = messages_of(self)
        except DatabaseError as error:
            yield ("dbc",), str(error)
            return
        yield from _broken_layouts(messages)
        for place in self._places():
            yield from _broken_place(place, messages)
        if self.request is not None and self.request not in messages:
            yield ("request",), _unknown("message", self.request, messages)
        elif self.request is not None:
            yield from self._broken_request(self.request, messages)
        yield from self._broken_checksums(messages)

    def _broken_request(
        self, request: str, messages: Mapping[str, DbcMessage]
    ) -> Iterator[BrokenRule]:
        if request not in self.counters and self.echoes:
            yield ("echoes",), f"an echo repeats a counter: give the counter of {request}"
        for name, output in self.outputs.items():
            message = messages.get(output.message)
            if message is not None and message.id == messages[request].id:
                what = f"{request} sets output {name}: the first request would set it to 0"
                remedy = "give a message that sets no output, or leave out request if the device"
                yield ("request",), f"{what}; {remedy} sends by itself"
                return

    def _broken_checksums(self, messages: Mapping[str, DbcMessage]) -> Iterator[BrokenRule]:
        for name, place in self.checksums.items():
            signal = messages[name].signals.get(place.signal) if name in messages else None
            if signal is not None and (signal.bits != 8 or not _is_aligned(signal)):
                yield ("checksums", name), f"{place.signal} must be exactly one byte of the frame"

    def _places(self) -> "Iterator[_SignalReference]":
        for name, one in self.inputs.items():
            yield _SignalReference(("inputs", name), one.message, one.signal)
        for name, output in self.outputs.items():
            yield _SignalReference(("outputs", name), output.message, output.signal)
            if (back := output.read_back) is not None:
                yield _SignalReference(("outputs", name, "read_back"), back.message, back.signal)
        for flag, one in self.flags.items():
            yield _SignalReference(("flags", flag), one.message, one.signal)
        for name, signal in self.counters.items():
            yield _SignalReference(("counters", name), name, signal)
        for name, signal in self.echoes.items():
            yield _SignalReference(("echoes", name), name, signal)
        for name, checksum in self.checksums.items():
            yield _SignalReference(("checksums", name), name, checksum.signal)
        for name, constants in self.constants.items():
            for signal in constants:
                yield _SignalReference(("constants", name, signal), name, signal)


class _SignalReference(NamedTuple):
    path: tuple[str, ...]
    message: str
    signal: str


def messages_of(options: DbcOptions) -> Mapping[str, DbcMessage]:
    """Return the messages of a configuration by name; reads the DBC file, if there is one.

    Raises:
        DatabaseError: If the file cannot be read.
    """
    if options.dbc is not None:
        return load(options.dbc)
    return {
        name: DbcMessage(
            name,
            one.id,
            one.bytes,
            one.extended,
            {key: _signal(key, signal) for key, signal in one.signals.items()},
        )
        for name, one in options.messages.items()
    }


def channels(options: DbcOptions) -> ChannelUnits:
    """Return the configured channels with the units of their signals."""
    messages = messages_of(options)

    def unit(place: SignalPlace) -> str:
        return messages[place.message].signals[place.signal].unit or "1"

    return ChannelUnits(
        {name: unit(place) for name, place in options.inputs.items()},
        {name: unit(place) for name, place in options.outputs.items()},
    )


def flag_of(name: _Flag) -> DeviceFlag:
    """Return the flag with a name of `flags`."""
    return DeviceFlag(name)


def _signal(name: str, one: SignalLayout) -> DbcSignal:
    low, high = one.range or (None, None)
    return DbcSignal(
        name,
        one.start,
        one.bits,
        one.big_endian,
        one.signed,
        one.scale,
        one.offset,
        low,
        high,
        one.unit,
    )


def _is_aligned(signal: DbcSignal) -> bool:
    return signal.start % 8 == (7 if signal.big_endian else 0)


def _broken_layouts(messages: Mapping[str, DbcMessage]) -> Iterator[BrokenRule]:
    for message in messages.values():
        if message.id >= STANDARD_IDS and not message.extended:
            what = f"0x{message.id:X} does not fit into 11 bits: set extended: true"
            yield ("messages", message.name, "id"), what
        for signal in message.signals.values():
            path = ("messages", message.name, "signals", signal.name)
            if signal.shift(message.n_bytes) < 0:
                yield path, f"does not fit into the {message.n_bytes} bytes of {message.name}"
            if signal.scale == 0.0:
                yield path, "scale must not be 0"


def _broken_place(
    place: _SignalReference, messages: Mapping[str, DbcMessage]
) -> Iterator[BrokenRule]:
    if place.message not in messages:
        yield place.path, _unknown("message", place.message, messages)
    elif place.signal not in messages[place.message].signals:
        yield place.path, _unknown("signal", place.signal, messages[place.message].signals)


def _unknown(what: str, name: str, known: Mapping[str, object]) -> str:
    return f"there is no {what} {name}, {suggest(name, list(known), f'known {what}s')}"
