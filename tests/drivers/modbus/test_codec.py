from contextlib import suppress
from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu.decoders import DecodePDU
from pymodbus.pdu.register_message import ReadWriteMultipleRegistersRequest

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.checksum import checksum, has_valid_checksum
from piezod_drivers.modbus.codec import (
    ModbusRequest,
    WriteAndRead,
    WriteMany,
    check_reply,
    read,
    write_one,
)
from piezod_drivers.modbus.register import Register, packer, unpacker

SERVER = DecodePDU(is_server=True)


@given(st.binary(max_size=300))
def test_the_checksum_is_that_of_pymodbus(data: bytes) -> None:
    """The checksum computed by words equals pymodbus' checksum, for any length."""
    assert checksum(data) == FramerRTU.compute_CRC(data).to_bytes(2, "big")
    assert has_valid_checksum(data + checksum(data)) == bool(data)


@pytest.mark.parametrize(("table", "function"), [("coil", 1), ("holding", 3), ("input", 4)])
def test_a_read_names_table_address_and_number(table: str, function: int) -> None:
    """Pymodbus decodes a read request to its table, address and number."""
    request = read(table, 0x1234, 10)  # type: ignore[arg-type] # one of the three
    found = SERVER.decode(request.pdu)
    assert found is not None
    assert (found.function_code, found.address, found.count) == (function, 0x1234, 10)
    n_data = 2 if table == "coil" else 20
    assert (request.echo, request.n_bytes) == (bytes((function, n_data)), n_data + 2)


@pytest.mark.parametrize(("address", "count"), [(-1, 1), (65_536, 1), (0, 0), (0, 126)])
def test_an_impossible_read_is_refused(address: int, count: int) -> None:
    """Impossible addresses and numbers are refused."""
    with pytest.raises(ValueError):
        read("holding", address, count)


def test_writes_carry_the_words() -> None:
    """Pymodbus decodes the words of each of the three write requests."""
    one = SERVER.decode(write_one(7, b"\x12\x34").pdu)
    assert one is not None
    assert (one.address, list(one.registers)) == (7, [0x1234])
    many = SERVER.decode(WriteMany(9, 2).request(b"\0\1\0\2").pdu)
    assert many is not None
    assert (many.address, many.count, list(many.registers)) == (9, 2, [1, 2])
    both = SERVER.decode(WriteAndRead(5, 1, 0x10, 3).request(b"\0\7").pdu)
    assert isinstance(both, ReadWriteMultipleRegistersRequest)
    assert (both.write_address, both.write_registers) == (5, [7])
    assert (both.read_address, both.read_count) == (0x10, 3)


@pytest.mark.sees("modbus", "B10")
@pytest.mark.parametrize(
    ("codes", "flag"),
    [
        ((1, 2, 3, 7), DeviceFlag.WRONG_REQUEST),
        ((4, 8, 9, 99), DeviceFlag.DEVICE_FAILURE),
        ((5, 6, 10, 11), DeviceFlag.BUSY),
    ],
)
def test_every_exception_code_has_its_meaning(codes: tuple[int, ...], flag: DeviceFlag) -> None:
    """An exception is a wrong request, a failure or a busy device, and names the request."""
    for code in codes:
        for request in (read("holding", 16, 1), write_one(16, b"\0\0")):
            refusal = bytes((request.pdu[0] | 0x80, code))
            with pytest.raises(LineFault, match=f"00 10.*exception {code}") as caught:
                check_reply(refusal, request, "unit 1")
            assert caught.value.flag is flag


@given(st.binary(max_size=20))
def test_judging_raises_nothing_but_line_faults(pdu: bytes) -> None:
    """Any reply is either valid or raises a `LineFault`."""
    request = ModbusRequest(b"\x03\0\0\0\1", b"\x03\x02", 4)
    with suppress(LineFault):
        assert check_reply(pdu, request, "unit 1").startswith(b"\x03\x02")


@pytest.mark.parametrize("kind", ["int16", "uint16", "int32", "uint32", "float32"])
@pytest.mark.parametrize("words", ["big", "little"])
@given(value=st.floats(0, 30), scale=st.sampled_from([1e-3, 0.5, 1.0]))
def test_packed_values_can_be_unpacked(kind: str, words: str, value: float, scale: float) -> None:
    """Values are packed and unpacked within the resolution of the code, in both word orders."""
    register = Register.model_validate(
        {
            "channel": "a",
            "role": "output",
            "address": 0,
            "type": kind,
            "words": words,
            "scale": scale,
            "range": (0.0, 30.0),
        }
    )
    packed = packer(register)(value)
    assert len(packed) == 2 * register.size
    found = scale * unpacker(register)(b"--" + packed, 2)
    assert found == pytest.approx(value, abs=1e-5 if kind == "float32" else scale / 2 + 1e-9)


def test_the_order_of_words() -> None:
    """With little order the low word comes first; inside a word the high byte comes first."""
    rows = {"channel": "a", "role": "input", "address": 0, "type": "uint32"}
    big, little = (
        unpacker(Register.model_validate(rows | {"words": words})) for words in ("big", "little")
    )
    assert big(pack(">I", 0x00112233), 0) == 0x00112233
    assert little(b"\x22\x33\x00\x11", 0) == 0x00112233
