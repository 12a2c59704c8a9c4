"""Options of devices on Modbus."""

from collections.abc import Iterator
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.document import KeyPath
from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.devices.bus.serial_line import SettleMs
from piezod_drivers.modbus.profiles import PROFILES
from piezod_drivers.modbus.register import Register

UnitAddress: TypeAlias = Annotated[int, Quantity(0, 255)]
Port: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=4096)]
Host: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=253)]

SERIAL_ADDRESSES: Final = range(1, 256)
"""The standard ends at 247; some devices allow higher addresses."""
DEFAULT_BAUD: Final = 9600
DEFAULT_WRITES: Final = (6, 16)


class WatchdogOptions(ConfigModel):
    """Options of the device's own watchdog, which acts when the host falls silent."""

    timeout_s: Annotated[float, Quantity(0.1, 600, "s")] = Field(
        description="After this time without a request the outputs go to `safe`, s."
    )
    safe: Annotated[float, Quantity(-1000, 1000)] = Field(
        description="Value that the outputs then take, in their unit."
    )


class UnitOptions(ConfigModel):
    """Options of one device on the line."""

    unit: UnitAddress = Field(default=1, description="Address, as set on the device.")
    profile: str | None = Field(
        default=None, description="Name of a known device; for any other device give `registers`."
    )
    registers: tuple[Register, ...] = Field(
        default=(), max_length=256, description="All registers of the device that may be used."
    )
    write_functions: tuple[Literal[6, 16, 23], ...] = Field(
        default=DEFAULT_WRITES,
        min_length=1,
        description="For a device with `registers`: its functions for writing. 6 sets one "
        "register, 16 sets several, 23 sets and reads at once.",
    )

    @property
    def known(self) -> tuple[Register, ...]:
        """All registers: those of the profile, or its own."""
        return PROFILES[self.profile].registers if self.profile else self.registers

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.profile is not None and self.profile not in PROFILES:
            known = ", ".join(sorted(PROFILES))
            yield ("profile",), f"unknown (got {self.profile!r}), known: {known}"
        elif self.profile is not None and self.registers:
            yield ("registers",), "a profile has registers: leave out one of the two"
        for role in ("input", "output"):
            names = [reg.channel for reg in self.registers if reg.role == role]
            if twice := {str(name) for name in names if names.count(name) > 1}:
                yield ("registers",), f"{role}s of the same name: {', '.join(sorted(twice))}"
        yield from self._broken_rules_of_references()
        if not {6, 16} & set(self.write_functions):
            yield ("write_functions",), "6 or 16 is required, to write without reading"

    def _broken_rules_of_references(self) -> Iterator[BrokenRule]:
        """Check the channels of read-backs and statuses; unused ones would never be read."""
        outputs = {reg.channel for reg in self.registers if reg.role == "output"}
        inputs = {reg.channel for reg in self.registers if reg.role == "input"}
        for i, reg in enumerate(self.registers):
            path = ("registers", i, "channel")
            if reg.role == "read-back" and reg.channel not in outputs:
                yield path, f"a read-back needs an output, and no output is called {reg.channel!r}"
            if reg.role == "status" and reg.channel not in {None, *inputs, *outputs}:
                yield path, f"no input or output of this unit is called {reg.channel!r}"


class ModbusOptions(UnitOptions):
    """Options of the driver: one device, or several `units` on the same line."""

    units: tuple[UnitOptions, ...] = Field(
        default=(), max_length=16, description="Several devices on one line, instead of `unit`."
    )
    host: Host | None = Field(default=None, description="Modbus TCP: name or address of the host.")
    tcp_port: Annotated[int, Quantity(1, 65_535)] = Field(
        default=502, description="Modbus TCP: number of the port."
    )
    port: Port | None = Field(
        default=None, description="Modbus RTU: path of the port, preferably in /dev/serial/by-id."
    )
    baud: Annotated[int, Quantity(300, 4_000_000, "bit/s")] = Field(
        default=DEFAULT_BAUD, description="Modbus RTU: bits per second."
    )
    parity: Literal["N", "E", "O"] = Field(default="N", description="Modbus RTU: N, E or O.")
    stop_bits: Literal[1, 2] = Field(default=1, description="Modbus RTU: 1 or 2.")
    silence_ms: Annotated[float, Quantity(0, 100, "ms")] | None = Field(
        default=None,
        description="Modbus RTU: silence before each request, ms; left out: as in the standard, "
        "3.5 characters, and 1.75 ms above 19200 bit/s.",
    )
    settle_ms: SettleMs = 0.0
    timeout_ms: Annotated[float, Quantity(1, 5000, "ms")] = Field(
        default=50.0, description="Longest wait for each reply, ms."
    )
    watchdog: WatchdogOptions | None = Field(
        default=None, description="Arms the device's watchdog while the stage is armed."
    )

    @property
    def every_unit(self) -> tuple[UnitOptions, ...]:
        """The devices on the line, at least one."""
        return self.units or (self,)

    @property
    def silence_s(self) -> float:
        """Silence of the line before a request, in s."""
        if self.silence_ms is not None:
            return self.silence_ms * 1e-3
        return 1.75e-3 if self.baud > 19_200 else 3.5 * self.character_s

    @property
    def character_s(self) -> float:
        """Time that a byte takes on a serial line, in s."""
        # Start bit, data bits, parity bit, stop bits.
        return (1 + 8 + (self.parity != "N") + self.stop_bits) / self.baud

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if (self.port is None) == (self.host is None):
            yield ("port",), "give either host, for Modbus TCP, or port, for Modbus RTU"
        if self.units and (self.profile is not None or self.registers):
            yield ("units",), "each unit has its own profile or registers: leave out those outside"
        for i, unit in enumerate(self.units):
            if unit.profile is None and not unit.registers:
                yield ("units", i, "profile"), "give a profile or registers"
        if not self.units and self.profile is None and not self.registers:
            yield ("profile",), "give a profile, registers or units"
        yield from self._broken_rules_of_addresses()
        yield from self._broken_rules_of_channels()
        yield from self._broken_rules_of_watchdog()

    def _broken_rules_of_addresses(self) -> Iterator[BrokenRule]:
        addresses = [unit.unit for unit in self.units]
        if len(set(addresses)) < len(addresses):
            yield ("units",), "two units have the same address"
        for i, unit in enumerate(self.every_unit):
            if self.port is not None and unit.unit not in SERIAL_ADDRESSES:
                path: KeyPath = ("units", i, "unit") if self.units else ("unit",)
                what = f"no address on a serial line (got {unit.unit}), allowed range 1 to 255"
                yield path, f"{what}; 0 is a broadcast, to which no device replies"

    def _broken_rules_of_channels(self) -> Iterator[BrokenRule]:
        known = [reg for unit in self.units if _is_known(unit) for reg in unit.known]
        for role in ("input", "output"):
            names = [reg.channel for reg in known if reg.role == role]
            if twice := {str(name) for name in names if names.count(name) > 1}:
                what = f"{role}s of the same name: {', '.join(sorted(twice))}; "
                yield ("units",), what + "give one of the units its own registers"

    def _broken_rules_of_watchdog(self) -> Iterator[BrokenRule]:
        if self.watchdog is None or not all(map(_is_known, self.every_unit)):
            return
        profiles = [PROFILES[unit.profile] for unit in self.every_unit if unit.profile]
        watchdogs = [profile.watchdog for profile in profiles if profile.watchdog is not None]
        if not watchdogs:
            yield ("watchdog",), "piezod cannot arm a watchdog of this device: set it by hand"
        for watchdog in watchdogs:
            if why := watchdog.objection(self.watchdog.timeout_s, self.watchdog.safe):
                yield ("watchdog",), why


def _is_known(unit: UnitOptions) -> bool:
    """Return whether `known` can be called: a profile, if one is given, exists."""
    return unit.profile is None or unit.profile in PROFILES
