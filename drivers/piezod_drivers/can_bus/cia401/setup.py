"""Prepares a node: who it is, its process data, its watchdog; by SDO, before the loop runs."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.devices.interface import Identity
from piezod.errors import DeviceError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess, SdoRefusedError

_ID_MASK: Final = 0x7FF
_WORD_MASK: Final = 0xFFFF


class Pdo(NamedTuple):
    """One PDO of a node, as it is to be or as it is.

    Attributes:
        settings: Index of its settings.
        mapping: Index of its mapping.
        transmission: Its transmission type.
        entries: Entries of its mapping.
    """

    settings: int
    mapping: int
    transmission: int
    entries: tuple[int, ...]

    @classmethod
    def sets(cls, number: int, outputs: Sequence[int]) -> "Pdo":
        """Return the PDO of this number that sets outputs, as soon as it comes."""
        entries = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        return cls(objects.RPDO + i, objects.RPDO_MAPPING + i, objects.AT_ONCE, entries)

    @classmethod
    def tells(cls, number: int, inputs: Sequence[int], outputs: Sequence[int]) -> "Pdo":
        """Return the PDO of this number that tells inputs, and outputs, at each SYNC."""
        read = tuple(objects.mapped(objects.INPUT, one) for one in inputs)
        set_to = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        mapping = objects.TPDO_MAPPING + i
        return cls(objects.TPDO + i, mapping, objects.EVERY_SYNC, read + set_to)


class PdoLayout(NamedTuple):
    """Where the channels are in a PDO that is in force.

    Attributes:
        id: Its identifier.
        places: Index of the word of each channel.
        fill: The words as they are to be where no channel of ours is.
    """

    id: int
    places: tuple[int, ...]
    fill: tuple[int, ...]


def identify(access: SdoAccess) -> Identity:
    """Ask a node who it is.

    Raises:
        DeviceError: If it is no CiA 401 node.
        LineFault: If it does not answer.
    """
    try:
        kind = access.number(objects.DEVICE_TYPE) & _WORD_MASK
        vendor, product, revision, serial = (_number_or_0(access, i) for i in range(1, 5))
    except SdoRefusedError as error:
        raise DeviceError(f"{error}: every CANopen node has it") from error
    if kind != objects.PROFILE:
        what = f"the node is of profile {kind}, not of {objects.PROFILE}, analogue and digital I/O"
        raise DeviceError(f"{what}: check its number")
    name = access.text(objects.NAME) or f"product 0x{product:08X}"
    software = access.text(objects.SOFTWARE) or f"revision 0x{revision:08X}"
    return Identity(f"vendor 0x{vendor:08X}", name, str(serial), software)


def has(access: SdoAccess, index: int, number: int) -> bool:
    """Tell whether a node has an object that can be read.

    Raises:
        LineFault: If it does not answer.
    """
    try:
        access.read(index, number)
    except SdoRefusedError:
        return False
    return True


def prepare(access: SdoAccess, pdos: Sequence[Pdo]) -> list[PdoLayout]:
    """Set PDOs up, unless they are so already, and return where the channels are in each.

    A node whose mapping cannot be changed is used with the one that it has, if all channels are in
    it. Outputs stay as they are.

    Raises:
        DeviceError: If it cannot be set up so.
        LineFault: If it does not answer.
    """
    try:
        if any(_in_force(access, pdo) != pdo for pdo in pdos):
            access.order(objects.PREPARE)
            for pdo in pdos:
                _set_up(access, pdo)
        return [_layout(access, pdo) for pdo in pdos]
    except SdoRefusedError as error:
        raise DeviceError(f"the node cannot be set up: {error}") from error


def _in_force(access: SdoAccess, pdo: Pdo) -> Pdo | None:
    if access.number(pdo.settings, 1) & objects.DISABLED:
        return None
    transmission = access.number(pdo.settings, 2)
    return pdo._replace(transmission=transmission, entries=_entries(access, pdo))


def _entries(access: SdoAccess, pdo: Pdo) -> tuple[int, ...]:
    count = access.number(pdo.mapping)
    return tuple(access.number(pdo.mapping, i + 1) for i in range(min(count, 8)))


def _set_up(access: SdoAccess, pdo: Pdo) -> None:
    identifier = access.number(pdo.settings, 1) & ~objects.DISABLED
    access.write(pdo.settings, 1, identifier | objects.DISABLED, 4)
    access.write(pdo.settings, 2, pdo.transmission, 1)
    try:
        access.write(pdo.mapping, 0, 0, 1)
        for i, entry in enumerate(pdo.entries):
            access.write(pdo.mapping, i + 1, entry, 4)
        access.write(pdo.mapping, 0, len(pdo.entries), 1)
    except SdoRefusedError as error:
        # One whose mapping is fixed refuses the first write, and is as it was.
        if not set(pdo.entries) <= set(_entries(access, pdo)):
            what = f"{error}; its mapping is fixed, and lacks a channel"
            raise DeviceError(f"{what}: name another rpdo or tpdo") from error
    access.write(pdo.settings, 1, identifier, 4)


def _layout(access: SdoAccess, pdo: Pdo) -> PdoLayout:
    entries = _entries(access, pdo)
    if any(entry & 0xFF != objects.WORD_BITS for entry in entries):
        what = f"PDO 0x{pdo.settings:04X} of the node has entries that have not 16 bits"
        raise DeviceError(f"{what}: name another rpdo or tpdo")
    foreign = set(entries) - set(pdo.entries)
    fill = tuple(
        access.number(entry >> 16, entry >> 8 & 0xFF) if entry in foreign else 0
        for entry in entries
    )
    places = tuple(entries.index(entry) for entry in pdo.entries)
    return PdoLayout(access.number(pdo.settings, 1) & _ID_MASK, places, fill)


def arm(
    access: SdoAccess, host: int, watchdog_ms: int, safe_codes: Sequence[tuple[int, int]]
) -> None:
    """Have a node take safe codes when this host falls silent.

    Args:
        access: The node.
        host: This host's number, whose heartbeat the node is to expect.
        watchdog_ms: How long the node waits for it, in ms.
        safe_codes: Number of each output, and what its error value is set to.

    Raises:
        DeviceError: If the node refuses.
        LineFault: If it does not answer.
    """
    try:
        for output, code in safe_codes:
            n_bytes = len(access.read(objects.ERROR_VALUE, output))  # 2 or 4, as nodes differ
            access.write(objects.ERROR_VALUE, output, code, n_bytes)
            n_bytes = len(access.read(objects.ERROR_MODE, output))
            access.write(objects.ERROR_MODE, output, 1, n_bytes)
        access.write(objects.CONSUMER_HEARTBEAT, 1, host << 16 | watchdog_ms, 4)
    except SdoRefusedError as error:
        what = "the node refuses to watch this host"
        raise DeviceError(f"{what}: {error}; leave out safe_code") from error


def disarm(access: SdoAccess) -> None:
    """Have a node expect no heartbeat any more, so that its outputs hold.

    Raises:
        LineFault: If it does not answer.
    """
    try:
        access.write(objects.CONSUMER_HEARTBEAT, 1, 0, 4)
    except SdoRefusedError:
        return  # it has none


def beat(access: SdoAccess, heartbeat_ms: int) -> bool:
    """Have a node show that it lives, this often; tell whether it does.

    Raises:
        LineFault: If it does not answer.
    """
    try:
        access.write(objects.PRODUCER_HEARTBEAT, 0, heartbeat_ms, 2)
    except SdoRefusedError:
        return False
    return heartbeat_ms > 0


def _number_or_0(access: SdoAccess, number: int) -> int:
    try:
        return access.number(objects.IDENTITY, number)
    except SdoRefusedError as error:
        if error.is_missing:
            return 0
        raise
