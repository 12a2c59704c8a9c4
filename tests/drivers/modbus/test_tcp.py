from struct import pack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.codec import read
from piezod_drivers.modbus.tcp_transactions import TcpTransactions
from tests.devices.bus.played_line import MS, PlayedLine

REQUEST = read("input", 0, 2)
TIMEOUT_S = 0.05


def reply_to(request: bytes, value: int, unit: int = 1) -> bytes:
    """Answer a request for two registers."""
    return request[:2] + pack(">HHBBBI", 0, 7, unit, 4, 4, value)


def tcp(line: PlayedLine) -> TcpTransactions:
    """Return open transactions over a line of the test."""
    transactions = TcpTransactions(line, TIMEOUT_S)
    transactions.open()
    return transactions


def test_requests_are_numbered_and_framed() -> None:
    """A frame has its own number, the protocol 0, its length and the unit."""
    line = PlayedLine(lambda request: [(MS, reply_to(request, 5, request[6]))])
    transactions = tcp(line)
    for unit in (1, 255):
        assert transactions.ask(unit, [REQUEST]) == b"\4\4\0\0\0\5"
    assert line.sent == [
        b"\0\1\0\0\0\6\x01\4\0\0\0\2",
        b"\0\2\0\0\0\6\xff\4\0\0\0\2",
    ]


@pytest.mark.sees("modbus", "B5")
def test_a_late_reply_is_dropped() -> None:
    """The reply to a request that has timed out is never taken for the next one."""
    line = PlayedLine()
    transactions = tcp(line)
    late: list[bytes] = []
    for number in range(200):
        line.answer = lambda request, late=late, number=number: (  # type: ignore[misc]
            late.append(reply_to(request, number)) or []
            if number % 2
            else [(MS, b"".join(late) + reply_to(request, number))]
        )
        if number % 2:
            with pytest.raises(LineFault, match="no reply"):
                transactions.ask(1, [REQUEST])
        else:
            assert transactions.ask(1, [REQUEST])[2:] == pack(">I", number)
            late.clear()
    assert DeviceFlag.OUT_OF_ORDER in transactions.take_noticed()


@pytest.mark.sees("modbus", "B3")
def test_a_damaged_header_is_not_accepted() -> None:
    """Any flipped bit in header, function or byte count is refused; data has TCP's checksum."""
    whole = reply_to(b"\0\1", 0)
    passed = []
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        line = PlayedLine(lambda _request, damaged=bytes(damaged): [(MS, damaged)])  # type: ignore[misc]
        try:
            tcp(line).ask(1, [REQUEST])
            passed.append(bit)
        except LineFault:
            pass
    assert passed == list(range(8 * (len(whole) - 4), 8 * len(whole)))


def test_another_unit_is_not_believed() -> None:
    """A reply with the right number from another unit is a fault."""
    line = PlayedLine(lambda request: [(MS, reply_to(request, 5, 9))])
    with pytest.raises(LineFault, match="unit 9 replied instead of unit 1"):
        tcp(line).ask(1, [REQUEST])


def test_an_answer_of_another_form_is_not_believed() -> None:
    """A reply with the right number and another length is a fault."""
    line = PlayedLine(lambda request: [(MS, request[:2] + b"\0\0\0\5\1\4\2\0\7")])
    with pytest.raises(LineFault, match="sent another reply: 04 02 00 07"):
        tcp(line).ask(1, [REQUEST])


@given(st.binary(max_size=300), st.binary(max_size=40))
def test_garbage_raises_nothing_but_line_faults(before: bytes, after: bytes) -> None:
    """Garbage raises only `LineFault`, and the reply behind it is found."""
    line = PlayedLine(lambda request: [(MS, before + reply_to(request, 5) + after)])
    transactions = tcp(line)
    try:
        assert transactions.ask(1, [REQUEST])[2:] == b"\0\0\0\5"
    except LineFault as fault:
        assert fault.flag in {DeviceFlag.LATE_REPLY, DeviceFlag.GARBAGE, DeviceFlag.BUSY,
                              DeviceFlag.WRONG_REQUEST, DeviceFlag.DEVICE_FAILURE}  # fmt: skip
    line.answer = lambda request: [(MS, reply_to(request, 6))]
    assert transactions.ask(1, [REQUEST])[2:] == b"\0\0\0\6"


def test_a_long_stream_of_nothing_is_searched_once() -> None:
    """Zeros, which look like a header everywhere, take no longer than other bytes."""
    line = PlayedLine(lambda request: [(MS, bytes(60_000) + reply_to(request, 5))])
    assert tcp(line).ask(1, [REQUEST])[2:] == b"\0\0\0\5"


def test_gateway_that_numbers_its_replies_itself_is_told_as_such() -> None:
    """Its replies are not taken, since a late one could not be told; the fault has both numbers."""
    line = PlayedLine(lambda request: [(MS, b"\x01\x2c" + reply_to(request, 5)[2:])])
    transactions = tcp(line)
    with pytest.raises(LineFault, match="had transaction number 1, a reply had 300"):
        transactions.ask(1, [REQUEST])
    line.answer = lambda _request: []
    with pytest.raises(LineFault) as silent:
        transactions.ask(1, [REQUEST])
    assert "transaction number" not in str(silent.value)
