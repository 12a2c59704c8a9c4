"""What is said to a device before and after its cyclic use: who it is, and its watchdog."""

from collections.abc import Sequence
from typing import Final

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import Identity
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.modbus.codec import WriteMany, read, write_one
from piezod_drivers.modbus.profiles.profile import ModbusProfile, Setting, WatchdogPlan
from piezod_drivers.modbus.register import STRUCTS, NumberType, Table
from piezod_drivers.modbus.transactions import Transactions

NOT_TOLD: Final = "not told"
"""What a device says of itself that its protocol cannot ask for."""


class Setup:
    """Reads and writes single numbers of one device; not for the loop.

    Args:
        transactions: Its line, open; a late reply is waited for.
        unit: Its address.

    Raises:
        LineFault: If the line is gone.
    """

    def __init__(self, transactions: Transactions, unit: int) -> None:
        self._transactions, self._unit = transactions, unit
        transactions.settle()

    def number(self, table: Table, address: int, kind: NumberType) -> float:
        """Read a number.

        Raises:
            LineFault: If that fails.
        """
        layout = STRUCTS[kind]
        count = 1 if table == "coil" else layout.size // 2
        pdu = self._transactions.ask(self._unit, [read(table, address, count)])
        return float(pdu[2] & 1 if table == "coil" else layout.unpack_from(pdu, 2)[0])

    def set(self, setting: Setting) -> None:
        """Write a number.

        Raises:
            LineFault: If that fails.
        """
        words = _words(setting)
        many = WriteMany(setting.address, len(words) // 2)
        request = write_one(setting.address, words) if len(words) == 2 else many.request(words)
        self._transactions.ask(self._unit, [request])

    def check(self, profile: ModbusProfile) -> None:
        """Look for what such a device always holds.

        Raises:
            DeviceError: If it is another device, or gives its words in another order.
            LineFault: If an exchange fails.
        """
        for table, address, kind, expected in profile.constants:
            found = self.number(table, address, kind)
            if found != expected:
                raise DeviceError(
                    f"unit {self._unit} is no {profile.maker} {profile.model} as it should be set: "
                    f"{table} {address} holds {found:.12g}, expected {expected:.12g}"
                )

    def identity(self, profile: ModbusProfile | None) -> Identity:
        """Ask who it is; what it does not tell is `NOT_TOLD`.

        Raises:
            LineFault: If an exchange fails.
        """
        told = dict.fromkeys(("model", "serial", "firmware"), NOT_TOLD)
        if profile is None:
            return Identity(NOT_TOLD, **told)
        told["model"] = profile.model
        for word, fact in profile.facts:
            try:
                told[word] = fact.show(self.number(fact.table, fact.address, fact.type))
            except LineFault as fault:
                if fault.flag is not DeviceFlag.WRONG_REQUEST:
                    raise
        return Identity(profile.maker, **told)

    def arm(self, plan: WatchdogPlan, timeout_s: float, safe: float) -> None:
        """Arm the watchdog; what it already holds is not written again, to spare its memory.

        Raises:
            DeviceError: If the device holds something else afterwards.
            LineFault: If an exchange fails.
        """
        settings = plan.settings(timeout_s, safe)
        if not (self._differing(settings) or self._differing(plan.on)):
            return
        for setting in (*plan.off, *self._differing(settings), *plan.on):
            if setting.is_set:
                self.set(setting)
        if wrong := self._differing((*settings, *plan.on)):
            address, kind, expected = wrong[0][:3]
            found = self.number("holding", address, kind)
            raise DeviceError(
                f"the watchdog of unit {self._unit} cannot be armed: register {address} holds "
                f"{found:.12g} instead of {expected:.12g}"
            )

    def disarm(self, plan: WatchdogPlan) -> None:
        """Stop the watchdog.

        Raises:
            LineFault: If an exchange fails.
        """
        for setting in plan.off:
            self.set(setting)

    def _differing(self, settings: Sequence[Setting]) -> list[Setting]:
        return [
            setting
            for setting in settings
            if setting.is_told
            and self.number("holding", setting.address, setting.type) != _held(setting)
        ]


def _words(setting: Setting) -> bytes:
    number = setting.number if setting.type == "float32" else int(setting.number)
    return STRUCTS[setting.type].pack(number)


def _held(setting: Setting) -> float:
    """Return the number as a device can hold it."""
    return float(STRUCTS[setting.type].unpack(_words(setting))[0])
