"""The process data of a node: sets its PDOs up by SDO, and finds the channels in them."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from piezod.errors import DeviceError
from piezod_drivers.can_bus.cia401 import objects
from piezod_drivers.can_bus.cia401.codec import pack, unpack
from piezod_drivers.can_bus.cia401.sdo_client import SdoAccess, SdoRefusedError
from piezod_drivers.can_bus.frame import Frame

_ID_MASK: Final = 0x7FF


class Pdo(NamedTuple):
    """A PDO of a node, as requested or as found."""

    settings: int  #: Index of its communication parameters.
    mapping: int  #: Index of its mapping.
    transmission: int  #: Transmission type.
    entries: tuple[int, ...]  #: Entries of its mapping.

    @classmethod
    def for_outputs(cls, number: int, outputs: Sequence[int]) -> "Pdo":
        """Return the receive PDO that sets outputs as soon as it arrives."""
        entries = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        return cls(objects.RPDO + i, objects.RPDO_MAPPING + i, objects.AT_ONCE, entries)

    @classmethod
    def for_inputs(cls, number: int, inputs: Sequence[int], outputs: Sequence[int]) -> "Pdo":
        """Return the transmit PDO that carries inputs, and outputs, at each SYNC."""
        read = tuple(objects.mapped(objects.INPUT, one) for one in inputs)
        read_back = tuple(objects.mapped(objects.OUTPUT, output) for output in outputs)
        i = number - 1
        mapping = objects.TPDO_MAPPING + i
        return cls(objects.TPDO + i, mapping, objects.EVERY_SYNC, read + read_back)


class PdoLayout(NamedTuple):
    """The positions of channels in a PDO of the node."""

    id: int  #: Identifier of the PDO.
    positions: tuple[int, ...]  #: Index of the word of each channel.
    #: Value of each word that belongs to no channel of ours; 0 for the others.
    fill: tuple[int, ...]

    def frame(self, words: Sequence[int]) -> Frame:
        """Return the process data with the word of each channel. Real-time safe."""
        # Words of other outputs in the same PDO keep the values that they had at first.
        all_words = list(self.fill)
        for position, word in zip(self.positions, words, strict=True):
            all_words[position] = word
        return Frame(self.id, pack(all_words))

    def words(self, data: bytes) -> list[int]:
        """Return the word of each channel in process data. Real-time safe.

        Raises:
            LineFault: `GARBAGE` if the data has another length.
        """
        all_words = unpack(data, len(self.fill))
        return [all_words[position] for position in self.positions]


def prepare(access: SdoAccess, pdos: Sequence[Pdo]) -> list[PdoLayout]:
    """Configure PDOs that differ, and return the positions of the channels in each.

    A node with a fixed mapping is used with that mapping, if it has all channels. The outputs keep
    their values.

    Raises:
        DeviceError: If the node cannot be configured this way.
        LineFault: If it does not reply.
    """
    try:
        if any(_current(access, pdo) != pdo for pdo in pdos):
            # A mapping may only be changed in the state pre-operational. A node that already has
            # the right PDOs keeps running: some nodes change their outputs when their state
            # changes.
            access.send_nmt(objects.PREPARE)
            for pdo in pdos:
                _configure(access, pdo)
        return [_layout(access, pdo) for pdo in pdos]
    except SdoRefusedError as error:
        raise DeviceError(f"the node cannot be set up: {error}") from error


def _current(access: SdoAccess, pdo: Pdo) -> Pdo | None:
    if access.number(pdo.settings, 1, 4) & objects.DISABLED:
        return None
    transmission = access.number(pdo.settings, 2, 1)
    return pdo._replace(transmission=transmission, entries=_entries(access, pdo))


def _entries(access: SdoAccess, pdo: Pdo) -> tuple[int, ...]:
    count = access.number(pdo.mapping, 0, 1)
    # Eight at most: a PDO carries four words, and a wrong number must not cause 255 requests.
    return tuple(access.number(pdo.mapping, i + 1, 4) for i in range(min(count, 8)))


def _configure(access: SdoAccess, pdo: Pdo) -> None:
    # The identifier that the node uses is kept.
    identifier = access.number(pdo.settings, 1, 4)
    enabled = identifier & ~objects.DISABLED
    try:
        # Order of CiA 301: disable the PDO, clear the mapping, write its entries and their number.
        access.write(pdo.settings, 1, enabled | objects.DISABLED, 4)
    except SdoRefusedError as error:
        # A node with fixed PDOs: its mapping cannot be changed either, without this.
        if identifier & objects.DISABLED:
            raise
        _set_transmission(access, pdo)
        _require_channels(access, pdo, error)
        return
    _set_transmission(access, pdo)
    try:
        access.write(pdo.mapping, 0, 0, 1)
        for i, entry in enumerate(pdo.entries):
            access.write(pdo.mapping, i + 1, entry, 4)
        access.write(pdo.mapping, 0, len(pdo.entries), 1)
    except SdoRefusedError as error:
        # A node with a fixed mapping refuses the first write, so its mapping is unchanged.
        _require_channels(access, pdo, error)
    access.write(pdo.settings, 1, enabled, 4)


def _set_transmission(access: SdoAccess, pdo: Pdo) -> None:
    try:
        access.write(pdo.settings, 2, pdo.transmission, 1)
    except SdoRefusedError as error:
        fixed = access.number(pdo.settings, 2, 1)
        # The types 254 and 255 differ in who defines the events; both act on arrival (CiA 301).
        if fixed != pdo.transmission and not {fixed, pdo.transmission} <= objects.ON_ARRIVAL:
            what = f"{error}; its transmission type is fixed at {fixed}"
            what = f"{what}, expected {pdo.transmission}"
            raise DeviceError(f"{what}: set another rpdo or tpdo") from error


def _require_channels(access: SdoAccess, pdo: Pdo, error: SdoRefusedError) -> None:
    if not set(pdo.entries) <= set(_entries(access, pdo)):
        what = f"{error}; its mapping is fixed and lacks a channel"
        raise DeviceError(f"{what}: set another rpdo or tpdo") from error


def _layout(access: SdoAccess, pdo: Pdo) -> PdoLayout:
    entries = _entries(access, pdo)
    if any(entry & 0xFF != objects.WORD_BITS for entry in entries):
        what = f"PDO 0x{pdo.settings:04X} of the node has entries of other than 16 bits"
        raise DeviceError(f"{what}: set another rpdo or tpdo")
    # Outputs of others in the same PDO must be sent with the values that they have now.
    foreign = set(entries) - set(pdo.entries)
    fill = tuple(
        access.number(entry >> 16, entry >> 8 & 0xFF, objects.WORD_BYTES) if entry in foreign else 0
        for entry in entries
    )
    positions = tuple(entries.index(entry) for entry in pdo.entries)
    return PdoLayout(access.number(pdo.settings, 1, 4) & _ID_MASK, positions, fill)
