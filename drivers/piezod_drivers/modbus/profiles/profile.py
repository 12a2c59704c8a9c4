"""The data of a known device: registers, constants, identity, watchdog."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from piezod_drivers.modbus.register import NumberType, Register, Table


class IdentityField(NamedTuple):
    """The register that holds a part of the identity."""

    table: Table  #: Table of the register.
    address: int  #: Address of the register.
    type: NumberType  #: Coding of the number.
    to_text: Callable[[float], str]  #: Converts the number to text.


class Constant(NamedTuple):
    """A register that shows whether the device is the one that the profile describes.

    It holds a number that never changes, which also reveals a wrong order of words, or a setting on
    which the scale of the values depends.
    """

    table: Table  #: Table of the register.
    address: int  #: Address of the register.
    type: NumberType  #: Coding of the number.
    number: float  #: The number that it holds, or the lowest allowed one.
    highest: float | None = None  #: The highest allowed number; None if only `number` is allowed.
    #: The channel whose setting it is; it is checked only if this channel is used. None: it is
    #: checked always.
    channel: str | None = None
    remedy: str = ""  #: What to do if it holds another number, for people.

    def allows(self, found: float) -> bool:
        """Return whether the register may hold this number."""
        return self.number <= found <= (self.number if self.highest is None else self.highest)

    def __str__(self) -> str:
        """Return the allowed numbers for people."""
        return f"{self.number:.12g}" + ("" if self.highest is None else f" to {self.highest:.12g}")


class Setting(NamedTuple):
    """A holding register of a watchdog."""

    address: int  #: Address of the register.
    type: NumberType  #: Coding of the number.
    number: float  #: The number that it is set to.
    is_written: bool = True  #: Whether it is written; a status is not.
    is_readable: bool = True  #: Whether it can be read back; a command cannot.


class WatchdogPlan(NamedTuple):
    """How a device's watchdog is armed."""

    #: Settings that stop it: at first if another setting differs, and at the end.
    off: Sequence[Setting]
    #: Returns its settings for a time-out in s and a safe value.
    settings: Callable[[float, float], Sequence[Setting]]
    on: Sequence[Setting]  #: Settings that start it.
    #: Returns why a time-out in s or a safe value is impossible, "" if both are possible.
    objection: Callable[[float, float], str]
    writes: tuple[int, ...]  #: The functions for writing that the watchdog notices.


@dataclass(frozen=True, slots=True)
class ModbusProfile:
    """A device whose registers are known."""

    name: str  #: Name in configurations.
    maker: str  #: Maker.
    model: str  #: Name of the model.
    registers: tuple[Register, ...]  #: All registers that can be used.
    write_functions: tuple[int, ...] = (6, 16)  #: Functions that it has for writing.
    feedback: bool = False  #: Whether it has LabJack's combined function.
    constants: tuple[Constant, ...] = ()  #: Registers that always hold the same number.
    #: Registers with model, serial number and firmware, by these words.
    identity_fields: tuple[tuple[str, IdentityField], ...] = ()
    max_rate_hz: float = 1000.0  #: Highest rate of requests, independent of the line.
    watchdog: WatchdogPlan | None = None  #: How to arm its watchdog; None if that is unknown.


def register_row(
    names: Sequence[str | None],
    first: int,
    *,
    step: int = 1,
    **columns: object,
) -> tuple[Register, ...]:
    """Return registers that differ only in name and address.

    Args:
        names: Names of the channels, in the order of their addresses.
        first: Address of the first register.
        step: Distance of the addresses.
        **columns: Fields that the registers have in common.
    """
    return tuple(
        Register.model_validate({"channel": name, "address": first + step * i, **columns})
        for i, name in enumerate(names)
    )
