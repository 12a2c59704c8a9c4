"""Groups of registers that are read or written by one request."""

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from math import inf, nan
from typing import Final, NamedTuple, TypeAlias

from piezod_drivers.modbus.codec import (
    MAX_READ,
    MAX_WRITTEN,
    ModbusRequest,
    WriteMany,
    read,
    write_one,
)
from piezod_drivers.modbus.register import BITS, Register, Table, packer, unpacker

FORMS: Final = 3
"""Number of lengths in which a block is read in turn, if the device has the registers."""
MAX_BITS: Final = 64

Extent: TypeAlias = tuple[int, int]
"""First address, and the address behind the last."""


class Decoded(NamedTuple):
    """How a number of a block becomes a value."""

    position: int  #: Index of the value in the result.
    #: Returns the value from a reply with its function code; NaN if it is out of range.
    value_of: Callable[[bytes], float]


class ReadBlock:
    """Reads several registers in one request, in forms that differ in their length.

    Replies of different length cannot be mistaken for each other, so a late reply is recognized.

    Args:
        unit: Address of the device.
        wanted: Index of each value and its register; all registers lie in one extent.
        extent: Range of addresses around them that the device has.
    """

    def __init__(self, unit: int, wanted: Sequence[tuple[int, Register]], extent: Extent) -> None:
        table: Table = wanted[0][1].table
        start, end = _span(register for _, register in wanted)
        self.unit, self.start, self.count = unit, start, end - start
        most = min(extent[1] - start, MAX_BITS if table in BITS else MAX_READ)
        # The longer forms also read registers behind the wanted ones, so these must exist.
        longer = range(self.count, min(most, self.count + FORMS - 1) + 1)
        counts = longer if table not in BITS else (self.count,)
        self.counts = tuple(counts)
        self.requests = [read(table, start, count) for count in counts]
        self._decoded = [Decoded(position, _decoder(reg, start)) for position, reg in wanted]
        self._form = 0

    def keep_forms(self, forms: Sequence[int]) -> None:
        """Use only these forms, given by their index."""
        self.counts = tuple(self.counts[form] for form in forms)
        self.requests = [self.requests[form] for form in forms]

    def next_form(self) -> int:
        """Return the index of the form that is due. Real-time safe."""
        # In turn, so that consecutive replies differ in length: see the class docstring.
        self._form = form = (self._form + 1) % len(self.requests)
        return form

    def decode(self, pdu: bytes, into: list[float]) -> None:
        """Write the values of a reply, in any form, to their indices. Real-time safe."""
        for position, value_of in self._decoded:
            into[position] = value_of(pdu)


class WriteBlock:
    """Writes consecutive registers, in one request or one by one.

    Args:
        unit: Address of the device.
        wanted: Index of each value and its register, in the order of addresses.
        functions: Functions that the device has for writing, of 6 and 16.
    """

    def __init__(
        self, unit: int, wanted: Sequence[tuple[int, Register]], functions: Iterable[int]
    ) -> None:
        self.unit, self.start = unit, wanted[0][1].address
        self.count = sum(register.size for _, register in wanted)
        self._many = WriteMany(self.start, self.count)
        self._packed = [(position, packer(register)) for position, register in wanted]
        # Function 6 sets one word, so it cannot set a number of two words in one step.
        singly = 6 in functions and self.count == len(wanted)
        self._alternatives: list[Callable[[Sequence[float]], list[ModbusRequest]]] = []
        # One register: function 6 is the best. Several: one request for all of them is the best.
        if 16 in functions or not singly:
            self._alternatives.append(self._at_once)
        if singly:
            # If the reply to the best form is overdue, the other form is used.
            self._alternatives.insert(1 if self.count > 1 else 0, self._one_by_one)

    def words(self, values: Sequence[float]) -> bytes:
        """Return the words that are written. Real-time safe."""
        return b"".join([pack(values[position]) for position, pack in self._packed])

    def requests(self, values: Sequence[float]) -> list[list[ModbusRequest]]:
        """Return the alternative lists of requests, the best one first. Real-time safe."""
        return [make(values) for make in self._alternatives]

    def _at_once(self, values: Sequence[float]) -> list[ModbusRequest]:
        return [self._many.request(self.words(values))]

    def _one_by_one(self, values: Sequence[float]) -> list[ModbusRequest]:
        return [
            write_one(self.start + i, pack(values[position]))
            for i, (position, pack) in enumerate(self._packed)
        ]


def read_blocks(
    unit: int, wanted: Iterable[tuple[int, Register]], known: Iterable[Register]
) -> list[ReadBlock]:
    """Group registers into as few requests as possible, without reading missing ones.

    Args:
        unit: Address of the device.
        wanted: Index of each value and its register.
        known: All registers that the device has.
    """
    extents = _extents(known)
    groups: dict[tuple[Table, Extent], list[tuple[int, Register]]] = {}
    blocks = []
    for position, register in sorted(wanted, key=lambda one: one[1].address):
        # A request must not read a register that the device lacks: it would be refused as a whole.
        extent = next(
            (low, high) for low, high in extents[register.table] if low <= register.address < high
        )
        group = groups.setdefault((register.table, extent), [])
        most = MAX_BITS if register.table in BITS else MAX_READ
        if group and register.address + register.size - group[0][1].address > most:
            blocks.append(ReadBlock(unit, group, extent))
            group = groups[register.table, extent] = []
        group.append((position, register))
    return blocks + [ReadBlock(unit, group, extent) for (_, extent), group in groups.items()]


def write_blocks(
    unit: int, wanted: Iterable[tuple[int, Register]], functions: Sequence[int]
) -> list[WriteBlock]:
    """Group consecutive registers, if the device can write several at once."""
    groups: list[list[tuple[int, Register]]] = []
    for position, register in sorted(wanted, key=lambda one: one[1].address):
        start, end = _span(reg for _, reg in groups[-1]) if groups else (0, -1)
        fits = register.address + register.size - start <= MAX_WRITTEN
        if end == register.address and fits and 16 in functions:
            groups[-1].append((position, register))
        else:
            groups.append([(position, register)])
    return [WriteBlock(unit, group, functions) for group in groups]


def _span(registers: Iterable[Register]) -> Extent:
    ends = [(register.address, register.address + register.size) for register in registers]
    return min(low for low, _ in ends), max(high for _, high in ends)


def _extents(known: Iterable[Register]) -> dict[Table, list[Extent]]:
    spans: dict[Table, list[Extent]] = {}
    for register in known:
        span = (register.address, register.address + register.size)
        spans.setdefault(register.table, []).append(span)
    return {table: _joined(sorted(set(each))) for table, each in spans.items()}


def _joined(spans: Sequence[Extent]) -> list[Extent]:
    # A new extent starts at each gap between registers; 1 << 17 lies behind every address.
    starts = [spans[0][0]] + [start for (_, end), (start, _) in pairwise(spans) if start > end]
    return [
        (start, max(high for low, high in spans if start <= low < until))
        for start, until in pairwise([*starts, 1 << 17])
    ]


def _decoder(register: Register, start: int) -> Callable[[bytes], float]:
    if register.table in BITS:
        # The first one is the lowest bit of the first data byte.
        byte, bit = divmod(register.address - start, 8)
        return lambda pdu: float(pdu[2 + byte] >> bit & 1)
    # Behind the function code and the byte count.
    at = 2 + 2 * (register.address - start)
    number_of, scale, offset = unpacker(register), register.scale, register.offset
    # Only an input beyond its range is saturated; an output that reads back a value out of range is
    # reported as it is.
    if register.role != "input" or (register.low == -inf and register.high == inf):
        return lambda pdu: scale * number_of(pdu, at) + offset
    low, high = register.low, register.high

    def value_of(pdu: bytes) -> float:
        value = scale * number_of(pdu, at) + offset
        return value if low <= value <= high else nan

    return value_of
