"""Requests without their frames, and the properties of a valid reply."""

from struct import Struct
from typing import Final, NamedTuple

from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest
from pymodbus.pdu.pdu import ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.register import BITS, Table

FEEDBACK: Final = 0x4C
"""LabJack's function for several reads and writes in one request."""
EXCEPTION_BIT: Final = 0x80
"""Added to the function code in a reply if the function has failed."""
# Highest numbers of registers in a request: 125 to read, 121 to write with function 23. The
# standard limits a request without its frame to 253 bytes. Function 16 allows 123.
MAX_READ: Final = 125
MAX_WRITTEN: Final = 121

_READS: Final[dict[Table, type[ModbusPDU]]] = {
    "holding": ReadHoldingRegistersRequest,
    "input": ReadInputRegistersRequest,
    "coil": ReadCoilsRequest,
    "discrete": ReadDiscreteInputsRequest,
}
_WRITE_ONE: Final = Struct(">BH2s")

# Exception codes of the Modbus standard; 9 is not defined.
_EXCEPTIONS: Final = {
    1: (DeviceFlag.WRONG_REQUEST, "function not supported"),
    2: (DeviceFlag.WRONG_REQUEST, "no such register"),
    3: (DeviceFlag.WRONG_REQUEST, "value or number of registers not allowed"),
    4: (DeviceFlag.DEVICE_FAILURE, "the device has failed"),
    5: (DeviceFlag.BUSY, "request accepted but not finished yet"),
    6: (DeviceFlag.BUSY, "the device is busy"),
    7: (DeviceFlag.WRONG_REQUEST, "the device cannot do this"),
    8: (DeviceFlag.DEVICE_FAILURE, "the memory of the device has failed"),
    10: (DeviceFlag.BUSY, "the gateway has no path to the device"),
    11: (DeviceFlag.BUSY, "the device does not answer the gateway"),
}


class ModbusRequest(NamedTuple):
    """A request, and how to recognize its reply."""

    pdu: bytes  #: Function code and data.
    echo: bytes  #: First bytes of the reply.
    n_bytes: int  #: Number of bytes of the reply, the function code included.


def read(table: Table, address: int, count: int) -> ModbusRequest:
    """Return the request that reads registers or bits.

    Raises:
        ValueError: If the addresses or their number are impossible.
    """
    asking = _READS[table](address=address, count=count)
    n_data = (count + 7) // 8 if table in BITS else 2 * count
    function = bytes((asking.function_code,))
    return ModbusRequest(function + asking.encode(), function + bytes((n_data,)), 2 + n_data)


def write_one(address: int, word: bytes) -> ModbusRequest:
    """Return the request that sets one register; the reply repeats it. Real-time safe."""
    pdu = _WRITE_ONE.pack(6, address, word)
    return ModbusRequest(pdu, pdu, 5)


def set_coil(address: int, *, on: bool) -> ModbusRequest:
    """Return the request that sets one coil; the reply repeats it. Real-time safe."""
    pdu = _WRITE_ONE.pack(5, address, b"\xff\0" if on else b"\0\0")
    return ModbusRequest(pdu, pdu, 5)


class WriteMany:
    """Sets consecutive registers.

    Args:
        address: Address of the first register.
        count: Number of registers, 1 to 121.
    """

    def __init__(self, address: int, count: int) -> None:
        asking = WriteMultipleRegistersRequest(address=address, registers=[0] * count)
        # pymodbus encodes the request once; in the loop only the words change.
        self._head = bytes((asking.function_code,)) + asking.encode()[: -2 * count]
        # The reply repeats function, address and number of registers, without the words.
        self._echo = self._head[:5]

    def request(self, words: bytes) -> ModbusRequest:
        """Return the request that writes these words. Real-time safe."""
        return ModbusRequest(self._head + words, self._echo, 5)


class WriteAndRead:
    """Sets consecutive registers, then reads others, in one request (function 23).

    Args:
        write_address: Address of the first register that is set.
        write_count: Number of registers that are set, 1 to 121.
        read_address: Address of the first register that is read.
        read_count: Number of registers that are read, 1 to 125.

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
        """Return the request that writes these words. Real-time safe."""
        return ModbusRequest(self._head + words, self._echo, 2 + self._echo[1])


def check_reply(pdu: bytes, request: ModbusRequest, device: str) -> bytes:
    """Return a reply, its function code included, if it is valid. Real-time safe.

    Args:
        pdu: The reply, with its function code.
        request: The request.
        device: The device, for messages to people.

    Raises:
        LineFault: If the device refuses, or the reply belongs to another request.
    """
    if len(pdu) == request.n_bytes and pdu.startswith(request.echo):
        return pdu
    if len(pdu) > 1 and pdu[0] == request.pdu[0] | EXCEPTION_BIT:
        flag, what = _EXCEPTIONS.get(pdu[1], (DeviceFlag.DEVICE_FAILURE, "unknown code"))
        asked = f"function {request.pdu[0]} ({request.pdu[1:6].hex(' ')})"
        raise LineFault(flag, f"{device} refuses {asked}: exception {pdu[1]}, {what}")
    raise LineFault(DeviceFlag.GARBAGE, f"{device} sent another reply: {pdu[:8].hex(' ')}")
