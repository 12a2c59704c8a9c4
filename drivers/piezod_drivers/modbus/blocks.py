"""Which registers are read together, and which are written together."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from math import inf, nan
from typing import Final, NamedTuple, TypeAlias

from piezod_drivers.modbus.codec import (
    MOST_READ,
    MOST_WRITTEN,
    ModbusRequest,
    WriteMany,
    read,
    write_one,
)
from piezod_drivers.modbus.register import Register, Table, packer, unpacker

FORMS: Final = 3
"""In so many lengths a block is read by turns, where its device has the registers."""
MOST_COILS: Final = 64

Extent: TypeAlias = tuple[int, int]
"""First address, and the one behind the last."""


class Decoded(NamedTuple):
    """How a number of a block becomes a value.

    Attributes:
        place: Where the value goes.
        value_of: Gives it from a reply with its function; NaN where it is beyond the range.
    """

    place: int
    value_of: Callable[[bytes], float]


class ReadBlock:
    """Reads several registers in one request, in forms that differ in their length.

    Args:
        unit: Address of the device.
        wanted: Where each value goes, and its register; all of one extent.
        extent: All addresses around them that the device has.
    """

    def __init__(self, unit: int, wanted: Sequence[tuple[int, Register]], extent: Extent) -> None:
        table: Table = wanted[0][1].table
        start, end = _around(register for _, register in wanted)
        self.unit, self.start, self.count = unit, start, end - start
        most = min(extent[1] - start, MOST_COILS if table == "coil" else MOST_READ)
        longer = range(self.count, min(most, self.count + FORMS - 1) + 1)
        counts = longer if table != "coil" else (self.count,)
        self.counts = tuple(counts)
        self.requests = [read(table, start, count) for count in counts]
        self._decoded = [Decoded(place, _decoder(reg, start)) for place, reg in wanted]
        self._turn = 0

    def keep(self, forms: Sequence[int]) -> None:
        """Ask in these forms only, by their places."""
        self.counts = tuple(self.counts[form] for form in forms)
        self.requests = [self.requests[form] for form in forms]

    def turn(self) -> int:
        """Tell which form is due; may be called in the loop."""
        self._turn = turn = (self._turn + 1) % len(self.requests)
        return turn

    def decode(self, pdu: bytes, into: list[float]) -> None:
        """Put the values of a reply, in any form, where they go; may be called in the loop."""
        for place, value_of in self._decoded:
            into[place] = value_of(pdu)


class WriteBlock:
    """Writes consecutive registers, in one request or one by one.

    Args:
        unit: Address of the device.
        wanted: Where each value comes from, and its register; in the order of addresses.
        functions: What the device has for writing, of 6 and 16.
    """

    def __init__(
        self, unit: int, wanted: Sequence[tuple[int, Register]], functions: Iterable[int]
    ) -> None:
        self.unit, self.start = unit, wanted[0][1].address
        self.count = sum(register.size for _, register in wanted)
        self._many = WriteMany(self.start, self.count)
        self._packed = [(place, packer(register)) for place, register in wanted]
        singly = 6 in functions and self.count == len(wanted)
        self._ways: list[Callable[[Sequence[float]], list[ModbusRequest]]] = []
        if 16 in functions or not singly:
            self._ways.append(self._at_once)
        if singly:
            self._ways.insert(1 if self.count > 1 else 0, self._one_by_one)

    def words(self, values: Sequence[float]) -> bytes:
        """Return the words to be written; may be called in the loop."""
        return b"".join([pack(values[place]) for place, pack in self._packed])

    def requests(self, values: Sequence[float]) -> list[list[ModbusRequest]]:
        """Return the ways to write them, the best one first; may be called in the loop."""
        return [way(values) for way in self._ways]

    def _at_once(self, values: Sequence[float]) -> list[ModbusRequest]:
        return [self._many.request(self.words(values))]

    def _one_by_one(self, values: Sequence[float]) -> list[ModbusRequest]:
        return [
            write_one(self.start + i, pack(values[place]))
            for i, (place, pack) in enumerate(self._packed)
        ]


def read_blocks(
    unit: int, wanted: Iterable[tuple[int, Register]], known: Iterable[Register]
) -> list[ReadBlock]:
    """Group registers into as few requests as can be, reading none that the device has not.

    Args:
        unit: Address of the device.
        wanted: Where each value goes, and its register.
        known: All registers that the device has.
    """
    extents = _extents(known)
    groups: dict[tuple[Table, Extent], list[tuple[int, Register]]] = {}
    blocks = []
    for place, register in sorted(wanted, key=lambda one: one[1].address):
        extent = next(
            (low, high) for low, high in extents[register.table] if low <= register.address < high
        )
        group = groups.setdefault((register.table, extent), [])
        most = MOST_COILS if register.table == "coil" else MOST_READ
        if group and register.address + register.size - group[0][1].address > most:
            blocks.append(ReadBlock(unit, group, extent))
            group = groups[register.table, extent] = []
        group.append((place, register))
    return blocks + [ReadBlock(unit, group, extent) for (_, extent), group in groups.items()]


def write_blocks(
    unit: int, wanted: Iterable[tuple[int, Register]], functions: Sequence[int]
) -> list[WriteBlock]:
    """Group registers that follow each other, where the device can write several at once."""
    groups: list[list[tuple[int, Register]]] = []
    for place, register in sorted(wanted, key=lambda one: one[1].address):
        start, end = _around(reg for _, reg in groups[-1]) if groups else (0, -1)
        fits = register.address + register.size - start <= MOST_WRITTEN
        if end == register.address and fits and 16 in functions:
            groups[-1].append((place, register))
        else:
            groups.append([(place, register)])
    return [WriteBlock(unit, group, functions) for group in groups]


def _around(registers: Iterable[Register]) -> Extent:
    ends = [(register.address, register.address + register.size) for register in registers]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _extents(known: Iterable[Register]) -> dict[Table, list[Extent]]:
    spans: dict[Table, list[Extent]] = {}
    for register in known:
        span = (register.address, register.address + register.size)
        spans.setdefault(register.table, []).append(span)
    return {table: _joined(sorted(set(each))) for table, each in spans.items()}


def _joined(spans: Sequence[Extent]) -> list[Extent]:
    starts = [spans[0][0]] + [start for (_, end), (start, _) in pairwise(spans) if start > end]
    return [
        (start, max(high for low, high in spans if start <= low < until))
        for start, until in pairwise([*starts, 1 << 17])
    ]


def _decoder(register: Register, start: int) -> Callable[[bytes], float]:
    if register.table == "coil":
        place, bit = divmod(register.address - start, 8)
        return lambda pdu: float(pdu[2 + place] >> bit & 1)
    at = 2 + 2 * (register.address - start)
    number_of, scale, offset = unpacker(register), register.scale, register.offset
    if register.role != "input" or (register.low == -inf and register.high == inf):
        return lambda pdu: scale * number_of(pdu, at) + offset
    low, high = register.low, register.high

    def value_of(pdu: bytes) -> float:
        value = scale * number_of(pdu, at) + offset
        return value if low <= value <= high else nan

    return value_of
