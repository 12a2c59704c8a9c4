"""The registers of an emulated device, and its replies without their frames."""

from collections.abc import Callable
from struct import Struct
from typing import Final, NamedTuple

from piezod_drivers.modbus.register import STRUCTS, NumberType, Table

FEEDBACK: Final = 0x4C
"""LabJack's function for several reads and writes in one request."""
EXCEPTION_BIT: Final = 0x80
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE = 1, 2, 3, 4
"""Exception codes."""
READS: Final[dict[int, Table]] = {1: "coil", 3: "holding", 4: "input"}
_ADDRESS_COUNT: Final = Struct(">HH")
_SET_MANY: Final = Struct(">HHB")
_SET_AND_READ: Final = Struct(">HHHHB")
_FEEDBACK: Final = Struct(">BHB")


class ModbusRefusal(Exception):  # noqa: N818 - a reply of the device
    """Raised if a device refuses a request.

    Args:
        code: Exception code.
        detail: The device's own error code; 0 if it has none.
    """

    def __init__(self, code: int, detail: int = 0) -> None:
        super().__init__(f"exception {code}, {detail}")
        self.code, self.detail = code, detail


class RegisterCell(NamedTuple):
    """A number in one or two registers."""

    layout: Struct  #: Coding of the number.
    get: Callable[[], float]  #: Returns the number.
    #: Stores a number, or raises `ModbusRefusal`; None if it cannot be written.
    set: Callable[[float], None] | None


class RegisterPort(NamedTuple):
    """A register that takes or gives any number of words at its own address."""

    #: Returns this number of words; None if it cannot be read.
    read: Callable[[int], bytes] | None = None
    #: Takes words, or raises `ModbusRefusal`; None if it cannot be written.
    write: Callable[[bytes], None] | None = None


class EmulatedUnit:
    """Replies to requests from its registers.

    Args:
        functions: Function codes that it supports.

    Attributes:
        last_error: The device's own code of the last error; 0 if there was none, or it has none.
        last_exception: Exception code of the last error; 0 if there was none.
    """

    def __init__(self, functions: frozenset[int]) -> None:
        self._functions = functions
        self._cells: dict[tuple[Table, int], RegisterCell] = {}
        self._ports: dict[int, RegisterPort] = {}
        self.last_error = self.last_exception = 0

    def add(
        self,
        table: Table,
        address: int,
        kind: NumberType,
        get: Callable[[], float],
        set_: Callable[[float], None] | None = None,
    ) -> None:
        """Add a number."""
        self._cells[table, address] = RegisterCell(STRUCTS[kind], get, set_)

    def add_stored(
        self, table: Table, address: int, kind: NumberType, number: float = 0
    ) -> Callable[[], float]:
        """Add a number that is stored; return a function that returns it."""
        kept = [number]
        self.add(table, address, kind, lambda: kept[0], lambda value: kept.__setitem__(0, value))
        return lambda: kept[0]

    def add_port(self, address: int, port: RegisterPort) -> None:
        """Add a holding register that takes or gives any number of words."""
        self._ports[address] = port

    def answer(self, pdu: bytes) -> bytes:
        """Return the reply to any request. Never raises."""
        if not pdu:
            return b""
        function = pdu[0]
        if function not in self._functions:
            return bytes((function | EXCEPTION_BIT, ILLEGAL_FUNCTION))
        try:
            return bytes((function,)) + self._run(function, pdu[1:])
        except ModbusRefusal as refusal:
            self.last_error, self.last_exception = refusal.detail, refusal.code
            return bytes((function | EXCEPTION_BIT, refusal.code))

    def _run(self, function: int, data: bytes) -> bytes:
        if function in READS:
            return self._counted(READS[function], *_unpack(_ADDRESS_COUNT, data))
        if function == 6:
            address, _ = _unpack(_ADDRESS_COUNT, data)
            self._write(address, data[2:])
            return data
        if function == 16:
            address, count, n_bytes = _unpack(_SET_MANY, data, exact=False)
            words = data[_SET_MANY.size :]
            _require(1 <= count <= 123 and 2 * count == n_bytes == len(words))
            self._write(address, words)
            return data[:4]
        if function == 23:
            read, n_read, address, count, n_bytes = _unpack(_SET_AND_READ, data, exact=False)
            words = data[_SET_AND_READ.size :]
            _require(1 <= count <= 121 and 2 * count == n_bytes == len(words))
            self._write(address, words)
            return self._counted("holding", read, n_read)
        return self._feedback(data)

    def _counted(self, table: Table, address: int, count: int) -> bytes:
        _require(1 <= count <= 125)
        if table == "coil":
            bits = [self._cell(table, address + i).get() for i in range(count)]
            # The first coil is the lowest bit.
            packed = sum(1 << i for i, bit in enumerate(bits) if bit)
            data = packed.to_bytes((count + 7) // 8, "little")
        else:
            data = self._read(table, address, count)
        return bytes((len(data),)) + data

    def _feedback(self, data: bytes) -> bytes:
        """Run LabJack's reads and writes one after the other."""
        data_read = b""
        while data:
            kind, address, count = _unpack(_FEEDBACK, data, exact=False)
            data = data[_FEEDBACK.size :]
            if kind == 0:
                # Reads and writes run in their order, so a value can be read before and after it is
                # set.
                data_read += self._read("holding", address, count)
            else:
                _require(kind == 1 and len(data) >= 2 * count > 0)
                self._write(address, data[: 2 * count])
                data = data[2 * count :]
        return data_read

    def _cell(self, table: Table, address: int) -> RegisterCell:
        cell = self._cells.get((table, address))
        if cell is None:
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return cell

    def _read(self, table: Table, address: int, count: int) -> bytes:
        port = self._ports.get(address)
        if port is not None and port.read is not None and table == "holding":
            return port.read(count)
        words = b""
        while len(words) < 2 * count:
            cell = self._cell(table, address + len(words) // 2)
            words += _pack(cell)
        # The last number is longer than the request: half of it cannot be read.
        if len(words) > 2 * count:
            raise ModbusRefusal(ILLEGAL_ADDRESS)
        return words

    def _write(self, address: int, words: bytes) -> None:
        """Write numbers; none is written if one of them is refused."""
        port = self._ports.get(address)
        if port is not None and port.write is not None:
            port.write(words)
            return
        cells = []
        at = 0
        while at < len(words):
            cell = self._cell("holding", address + at // 2)
            # Half a number cannot be written.
            if cell.set is None or at + cell.layout.size > len(words):
                raise ModbusRefusal(ILLEGAL_ADDRESS)
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
    # A converter at its end reports its last code.
    return cell.layout.pack(min(max(round(number), low), low + (1 << bits) - 1))


def _unpack(layout: Struct, data: bytes, *, exact: bool = True) -> tuple[int, ...]:
    _require(len(data) == layout.size if exact else len(data) >= layout.size)
    return layout.unpack_from(data)


def _require(condition: bool) -> None:
    if not condition:
        raise ModbusRefusal(ILLEGAL_VALUE)
