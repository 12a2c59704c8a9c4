"""The data of a known device: registers, constants, identity, watchdog."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from piezod_drivers.modbus.register import NumberType, Register, Table


class IdentityField(NamedTuple):
    """The register that holds a part of the identity.

    Attributes:
        table: Table of the register.
        address: Address of the register.
        type: Coding of the number.
        to_text: Converts the number to text.
    """

    table: Table
    address: int
    type: NumberType
    to_text: Callable[[float], str]


class Constant(NamedTuple):
    """A register that shows whether the device is the one that the profile describes.

    It holds a number that never changes, which also reveals a wrong order of words, or a setting on
    which the scale of the values depends.

    Attributes:
        table: Table of the register.
        address: Address of the register.
        type: Coding of the number.
        number: The number that it holds, or the lowest allowed one.
        highest: The highest allowed number; None if only `number` is allowed.
        channel: The channel whose setting it is; it is checked only if this channel is used. None:
            it is checked always.
        remedy: What to do if it holds another number, for people.
    """

    table: Table
    address: int
    type: NumberType
    number: float
    highest: float | None = None
    channel: str | None = None
    remedy: str = ""

    def allows(self, found: float) -> bool:
        """Return whether the register may hold this number."""
        return self.number <= found <= (self.number if self.highest is None else self.highest)

    def __str__(self) -> str:
        """Return the allowed numbers for people."""
        return f"{self.number:.12g}" + ("" if self.highest is None else f" to {self.highest:.12g}")


class Setting(NamedTuple):
    """A holding register of a watchdog.

    Attributes:
        address: Address of the register.
        type: Coding of the number.
        number: The number that it is set to.
        is_written: Whether it is written; a status is not.
        is_readable: Whether it can be read back; a command cannot.
    """

    address: int
    type: NumberType
    number: float
    is_written: bool = True
    is_readable: bool = True


class WatchdogPlan(NamedTuple):
    """How a device's watchdog is armed.

    Attributes:
        off: Settings that stop it: at first if another setting differs, and at the end.
        settings: Returns its settings for a time-out in s and a safe value.
        on: Settings that start it.
        objection: Returns why a time-out in s or a safe value is impossible, "" if both are
            possible.
        writes: The functions for writing that the watchdog notices.
    """

    off: Sequence[Setting]
    settings: Callable[[float, float], Sequence[Setting]]
    on: Sequence[Setting]
    objection: Callable[[float, float], str]
    writes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ModbusProfile:
    """A device whose registers are known.

    Attributes:
        name: Name in configurations.
        maker: Maker.
        model: Name of the model.
        registers: All registers that can be used.
        write_functions: Functions that it has for writing.
        feedback: Whether it has LabJack's combined function.
        constants: Registers that always hold the same number.
        identity_fields: Registers with model, serial number and firmware, by these words.
        max_rate_hz: Highest rate of requests, independent of the line.
        watchdog: How to arm its watchdog; None if that is unknown.
    """

    name: str
    maker: str
    model: str
    registers: tuple[Register, ...]
    write_functions: tuple[int, ...] = (6, 16)
    feedback: bool = False
    constants: tuple[Constant, ...] = ()
    identity_fields: tuple[tuple[str, IdentityField], ...] = ()
    max_rate_hz: float = 1000.0
    watchdog: WatchdogPlan | None = None


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
