"""Exchanges with a device before and after the loop: identity and watchdog."""

from collections.abc import Collection, Sequence

from piezod.devices.bus.line import LineFault
from piezod.devices.interface import NOT_TOLD, Identity
from piezod.devices.status import DeviceFlag
from piezod.errors import DeviceError
from piezod_drivers.modbus.codec import WriteMany, read, write_one
from piezod_drivers.modbus.profiles.profile import (
    Constant,
    ModbusProfile,
    Setting,
    WatchdogPlan,
)
from piezod_drivers.modbus.register import BITS, STRUCTS, NumberType, Table
from piezod_drivers.modbus.transactions import Transactions


class DeviceSetup:
    """Reads and writes single numbers of one device. Not real-time safe.

    Every method raises `LineFault` if an exchange fails, and the constructor if the line is lost.

    Args:
        transactions: The open line; late replies are waited for first.
        unit: Address of the device.
    """

    def __init__(self, transactions: Transactions, unit: int) -> None:
        self._transactions, self._unit = transactions, unit
        transactions.settle()

    def read_number(self, table: Table, address: int, kind: NumberType) -> float:
        """Read a number."""
        layout = STRUCTS[kind]
        count = 1 if table in BITS else layout.size // 2
        pdu = self._transactions.ask(self._unit, [read(table, address, count)])
        return float(pdu[2] & 1 if table in BITS else layout.unpack_from(pdu, 2)[0])

    def write(self, setting: Setting) -> None:
        """Write a setting."""
        words = _words(setting)
        many = WriteMany(setting.address, len(words) // 2)
        # Function 6 writes one register, function 16 writes several.
        request = write_one(setting.address, words) if len(words) == 2 else many.request(words)
        self._transactions.ask(self._unit, [request])

    def check_constants(self, profile: ModbusProfile, channels: Collection[str]) -> None:
        """Check the registers that show whether the device fits its profile.

        Args:
            profile: The profile.
            channels: Names of the used channels; settings of the others are not checked.

        Raises:
            DeviceError: If it is another device, has other settings, or sends its words in another
                order.
        """
        for constant in profile.constants:
            if constant.channel in {None, *channels} and (what := self._objection(constant)):
                raise DeviceError(
                    f"unit {self._unit} is no {profile.maker} {profile.model}, or its settings "
                    f"differ: {constant.table} {constant.address} {what}, expected {constant}"
                    + (f"; {constant.remedy}" if constant.remedy else "")
                )

    def read_identity(self, profile: ModbusProfile | None) -> Identity:
        """Read the identity; an unreported part is `NOT_TOLD`."""
        identity = dict.fromkeys(("model", "serial", "firmware"), NOT_TOLD)
        if profile is None:
            return Identity(NOT_TOLD, **identity)
        identity["model"] = profile.model
        for name, field in profile.identity_fields:
            try:
                identity[name] = field.to_text(
                    self.read_number(field.table, field.address, field.type)
                )
            except LineFault as fault:
                if fault.flag is not DeviceFlag.WRONG_REQUEST:
                    raise
        return Identity(profile.maker, **identity)

    def arm(self, plan: WatchdogPlan, timeout_s: float, safe: float) -> None:
        """Arm the watchdog. Settings that the device already has are not written again.

        This spares the device's flash memory.

        Raises:
            DeviceError: If the device does not hold the settings afterwards.
        """
        settings = plan.settings(timeout_s, safe)
        if not (self._differing(settings) or self._differing(plan.on)):
            return
        # The watchdog must not run while its settings change.
        for setting in (*plan.off, *self._differing(settings), *plan.on):
            if setting.is_written:
                self.write(setting)
        # A device may accept a write and keep its own value.
        if wrong := self._differing((*settings, *plan.on)):
            address, kind, expected = wrong[0][:3]
            found = self.read_number("holding", address, kind)
            raise DeviceError(
                f"the watchdog of unit {self._unit} cannot be armed: register {address} holds "
                f"{found:.12g} instead of {expected:.12g}"
            )

    def disarm(self, plan: WatchdogPlan) -> None:
        """Stop the watchdog."""
        for setting in plan.off:
            self.write(setting)

    def _objection(self, constant: Constant) -> str:
        """Return why the device has the wrong number in a register, "" if it has a right one."""
        try:
            found = self.read_number(constant.table, constant.address, constant.type)
        except LineFault as fault:
            # The registers of a profile exist on its device.
            if fault.flag is not DeviceFlag.WRONG_REQUEST:
                raise
            return "cannot be read"
        return "" if constant.allows(found) else f"holds {found:.12g}"

    def _differing(self, settings: Sequence[Setting]) -> list[Setting]:
        return [
            setting
            for setting in settings
            if setting.is_readable
            and self.read_number("holding", setting.address, setting.type)
            != _stored_number(setting)
        ]


def _words(setting: Setting) -> bytes:
    number = setting.number if setting.type == "float32" else int(setting.number)
    return STRUCTS[setting.type].pack(number)


def _stored_number(setting: Setting) -> float:
    """Return the number as the device can store it."""
    return float(STRUCTS[setting.type].unpack(_words(setting))[0])
