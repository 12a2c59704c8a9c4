"""What is known of a device, as data."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from piezod_drivers.modbus.register import NumberType, Register, Table


class Fact(NamedTuple):
    """Where a device tells who it is.

    Attributes:
        table: Of the register.
        address: Of the register.
        type: Of the number.
        show: Makes a text of the number.
    """

    table: Table
    address: int
    type: NumberType
    show: Callable[[float], str]


class Constant(NamedTuple):
    """A register that always holds the same number, by which words in a wrong order show.

    Attributes:
        table: Of the register.
        address: Of the register.
        type: Of the number.
        number: What it holds.
    """

    table: Table
    address: int
    type: NumberType
    number: float


class Setting(NamedTuple):
    """A holding register of a watchdog.

    Attributes:
        address: Of the register.
        type: Of the number.
        number: What it is set to.
        is_set: Whether it is written; a status is not.
        is_told: Whether it can be read back; a command cannot.
    """

    address: int
    type: NumberType
    number: float
    is_set: bool = True
    is_told: bool = True


class WatchdogPlan(NamedTuple):
    """How a device's watchdog is armed.

    Attributes:
        off: Stops it, first of all where a setting differs, and at the end.
        settings: Its settings, from the time in s and the safe value.
        on: Starts it.
        objection: Tells why a time in s or a safe value is impossible, "" where they are not.
        writes: The functions for writing that it notices.
    """

    off: Sequence[Setting]
    settings: Callable[[float, float], Sequence[Setting]]
    on: Sequence[Setting]
    objection: Callable[[float, float], str]
    writes: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ModbusProfile:
    """A device that needs only its name.

    Attributes:
        name: As configurations call it.
        maker: Who makes it.
        model: What they call it.
        registers: All that can be used.
        write_functions: Functions that it has for writing.
        feedback: Whether it has LabJack's combined function.
        constants: What it always holds.
        facts: Where it tells its model, serial number and firmware, by these words.
        max_rate_hz: How often it can be asked at most, whatever the line takes.
        watchdog: How to arm its watchdog; None where that is not known.
    """

    name: str
    maker: str
    model: str
    registers: tuple[Register, ...]
    write_functions: tuple[int, ...] = (6, 16)
    feedback: bool = False
    constants: tuple[Constant, ...] = ()
    facts: tuple[tuple[str, Fact], ...] = ()
    max_rate_hz: float = 1000.0
    watchdog: WatchdogPlan | None = None


def row(
    names: Sequence[str | None],
    first: int,
    *,
    step: int = 1,
    **columns: object,
) -> tuple[Register, ...]:
    """Return registers that differ in name and address only.

    Args:
        names: Of the channels, in the order of their addresses.
        first: Address of the first.
        step: From address to address.
        **columns: What they have in common.
    """
    return tuple(
        Register.model_validate({"channel": name, "address": first + step * i, **columns})
        for i, name in enumerate(names)
    )
