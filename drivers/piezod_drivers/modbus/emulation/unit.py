"""The registers of an emulated device, and its answers to requests without their frames."""

from collections.abc import Callable
from struct import Struct
from typing import Final, NamedTuple

from piezod_drivers.modbus.codec import FAILED
from piezod_drivers.modbus.register import STRUCTS, NumberType, Table

NO_FUNCTION, NO_REGISTER, NO_VALUE, FAILURE = 1, 2, 3, 4
"""Exception codes."""
READS: Final[dict[int, Table]] = {1: "coil", 3: "holding", 4: "input"}
_TWO: Final = Struct(">HH")
_SET_MANY: Final = Struct(">HHB")
_SET_AND_READ: Final = Struct(">HHHHB")
_FEEDBACK: Final = Struct(">BHB")


class ModbusRefusal(Exception):  # noqa: N818 - an answer that a device gives
    """Raised where a device refuses.

    Args:
        code: Its exception code.
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"exception {code}")
        self.code = code


class RegisterCell(NamedTuple):
    """A number in one or two registers.

    Attributes:
        layout: How it is coded.
        get: Gives the number.
        set: Takes one, or raises `ModbusRefusal`; None where it cannot be written.
    """

    layout: Struct
    get: Callable[[], float]
    set: Callable[[float], None] | None


class EmulatedUnit:
    """Answers requests.

    Args:
        functions: Those that it has.
    """

    def __init__(self, functions: frozenset[int]) -> None:
        self._functions = functions
        self._cells: dict[tuple[Table, int], RegisterCell] = {}

    def has(
        self,
        table: Table,
        address: int,
        kind: NumberType,
        get: Callable[[], float],
        set_: Callable[[float], None] | None = None,
    ) -> None:
        """Add a number."""
        self._cells[table, address] = RegisterCell(STRUCTS[kind], get, set_)

    def stores(
        self, table: Table, address: int, kind: NumberType, number: float = 0
    ) -> Callable[[], float]:
        """Add a number that is kept; return what tells it."""
        kept = [number]
        self.has(table, address, kind, lambda: kept[0], lambda value: kept.__setitem__(0, value))
        return lambda: kept[0]

    def answer(self, pdu: bytes) -> bytes:
        """Return the answer to any request; never raises."""
        if not pdu:
            return b""
        function = pdu[0]
        if function not in self._functions:
            return bytes((function | FAILED, NO_FUNCTION))
        try:
            return bytes((function,)) + self._do(function, pdu[1:])
        except ModbusRefusal as refusal:
            return bytes((function | FAILED, refusal.code))

    def _do(self, function: int, data: bytes) -> bytes:
        if function in READS:
            return self._counted(READS[function], *_unpack(_TWO, data))
        if function == 6:
            address, _ = _unpack(_TWO, data)
            self._write(address, data[2:])
            return data
        if function == 16:
            address, count, n_bytes = _unpack(_SET_MANY, data, exact=False)
            words = data[_SET_MANY.size :]
            _check(1 <= count <= 123 and 2 * count == n_bytes == len(words))
            self._write(address, words)
            return data[:4]
        if function == 23:
            read, n_read, address, count, n_bytes = _unpack(_SET_AND_READ, data, exact=False)
            words = data[_SET_AND_READ.size :]
            _check(1 <= count <= 121 and 2 * count == n_bytes == len(words))
            self._write(address, words)
            return self._counted("holding", read, n_read)
        return self._feedback(data)

    def _counted(self, table: Table, address: int, count: int) -> bytes:
        _check(1 <= count <= 125)
        if table == "coil":
            bits = [self._cell(table, address + i).get() for i in range(count)]
            packed = sum(1 << i for i, bit in enumerate(bits) if bit)
            data = packed.to_bytes((count + 7) // 8, "little")
        else:
            data = self._read(table, address, count)
        return bytes((len(data),)) + data

    def _feedback(self, data: bytes) -> bytes:
        """Do LabJack's reads and writes one after the other."""
        told = b""
        while data:
            kind, address, count = _unpack(_FEEDBACK, data, exact=False)
            data = data[_FEEDBACK.size :]
            if kind == 0:
                told += self._read("holding", address, count)
            else:
                _check(kind == 1 and len(data) >= 2 * count > 0)
                self._write(address, data[: 2 * count])
                data = data[2 * count :]
        return told

    def _cell(self, table: Table, address: int) -> RegisterCell:
        cell = self._cells.get((table, address))
        if cell is None:
            raise ModbusRefusal(NO_REGISTER)
        return cell

    def _read(self, table: Table, address: int, count: int) -> bytes:
        words = b""
        while len(words) < 2 * count:
            cell = self._cell(table, address + len(words) // 2)
            words += _pack(cell)
        if len(words) > 2 * count:
            raise ModbusRefusal(NO_REGISTER)
        return words

    def _write(self, address: int, words: bytes) -> None:
        """Set numbers; none if one of them cannot be set."""
        cells = []
        at = 0
        while at < len(words):
            cell = self._cell("holding", address + at // 2)
            if cell.set is None or at + cell.layout.size > len(words):
                raise ModbusRefusal(NO_REGISTER)
            cells.append((cell.set, cell.layout.unpack_from(words, at)[0]))
            at += cell.layout.size
        for set_, number in cells:
            set_(number)


def _pack(cell: RegisterCell) -> bytes:
    number = cell.get()
    if cell.layout.format == ">f":
        return cell.layout.pack(number)
    bits = 8 * cell.layout.size
    low = -(1 << bits - 1) if cell.layout.format in {">h", ">i"} else 0
    return cell.layout.pack(min(max(round(number), low), low + (1 << bits) - 1))


def _unpack(layout: Struct, data: bytes, *, exact: bool = True) -> tuple[int, ...]:
    _check(len(data) == layout.size if exact else len(data) >= layout.size)
    return layout.unpack_from(data)


def _check(true: bool) -> None:
    if not true:
        raise ModbusRefusal(NO_VALUE)
