"""Requests without their frames, and what their replies must look like."""

from struct import Struct
from typing import Final, NamedTuple

from pymodbus.pdu.bit_message import ReadCoilsRequest
from pymodbus.pdu.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.register import Table

FEEDBACK: Final = 0x4C
"""LabJack's function for several reads and writes at once."""
FAILED: Final = 0x80
"""Added to the function where it has failed."""
MOST_READ: Final = 125
MOST_WRITTEN: Final = 121

_READS: Final[dict[Table, type[ModbusPDU]]] = {
    "holding": ReadHoldingRegistersRequest,
    "input": ReadInputRegistersRequest,
    "coil": ReadCoilsRequest,
}
_WRITE_ONE: Final = Struct(">BH2s")

_EXCEPTIONS: Final = {
    1: (DeviceFlag.WRONG_REQUEST, "it has no such function"),
    2: (DeviceFlag.WRONG_REQUEST, "it has no such register"),
    3: (DeviceFlag.WRONG_REQUEST, "it does not take this value or number of registers"),
    4: (DeviceFlag.DEVICE_FAILURE, "the device has failed"),
    5: (DeviceFlag.BUSY, "it has begun and not finished"),
    6: (DeviceFlag.BUSY, "it is busy"),
    7: (DeviceFlag.WRONG_REQUEST, "it does not do that"),
    8: (DeviceFlag.DEVICE_FAILURE, "its memory has failed"),
    10: (DeviceFlag.BUSY, "the gateway has no path to it"),
    11: (DeviceFlag.BUSY, "it does not answer the gateway"),
}


class ModbusRequest(NamedTuple):
    """A request and the marks of its reply.

    Attributes:
        pdu: Function and data.
        echo: How the reply begins.
        n_bytes: Number of bytes of the reply, with its function.
    """

    pdu: bytes
    echo: bytes
    n_bytes: int


def read(table: Table, address: int, count: int) -> ModbusRequest:
    """Ask for registers or coils.

    Raises:
        ValueError: If addresses or their number are impossible.
    """
    asking = _READS[table](address=address, count=count)
    n_data = (count + 7) // 8 if table == "coil" else 2 * count
    function = bytes((asking.function_code,))
    return ModbusRequest(function + asking.encode(), function + bytes((n_data,)), 2 + n_data)


def write_one(address: int, word: bytes) -> ModbusRequest:
    """Set one register; the reply repeats the request; may be called in the loop."""
    pdu = _WRITE_ONE.pack(6, address, word)
    return ModbusRequest(pdu, pdu, 5)


class WriteMany:
    """Sets consecutive registers.

    Args:
        address: Of the first.
        count: How many, 1 to 121.
    """

    def __init__(self, address: int, count: int) -> None:
        asking = WriteMultipleRegistersRequest(address=address, registers=[0] * count)
        self._head = bytes((asking.function_code,)) + asking.encode()[: -2 * count]
        self._echo = self._head[:5]

    def request(self, words: bytes) -> ModbusRequest:
        """Make the request for these words; may be called in the loop."""
        return ModbusRequest(self._head + words, self._echo, 5)


class WriteAndRead:
    """Sets consecutive registers, then reads others, in one request (function 23).

    Args:
        write_address: Of the first that is set.
        write_count: How many are set, 1 to 121.
        read_address: Of the first that is read.
        read_count: How many are read, 1 to 125.

    Raises:
        ValueError: If addresses or their numbers are impossible.
    """

    def __init__(
        self, write_address: int, write_count: int, read_address: int, read_count: int
    ) -> None:
        asking = ReadWriteMultipleRegistersRequest(
            read_address, read_count, write_address, [0] * write_count
        )
        self._head = bytes((asking.function_code,)) + asking.encode()[: -2 * write_count]
        self._echo = bytes((asking.function_code, 2 * read_count))

    def request(self, words: bytes) -> ModbusRequest:
        """Make the request for these words; may be called in the loop."""
        return ModbusRequest(self._head + words, self._echo, 2 + self._echo[1])


def judge(pdu: bytes, request: ModbusRequest, who: str) -> bytes:
    """Return a reply, function and all, that answers a request; may be called in the loop.

    Raises:
        LineFault: If the device refuses, or the reply is no answer to this request.
    """
    if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
        return pdu
    if len(pdu) > 1 and pdu[0] == request.pdu[0] | FAILED:
        flag, what = _EXCEPTIONS.get(pdu[1], (DeviceFlag.DEVICE_FAILURE, "no reason is known"))
        asked = f"function {request.pdu[0]} ({request.pdu[1:6].hex(' ')})"
        raise LineFault(flag, f"{who} refuses {asked}: exception {pdu[1]}, {what}")
    raise LineFault(DeviceFlag.GARBAGE, f"{who} answers something else: {pdu[:8].hex(' ')}")
