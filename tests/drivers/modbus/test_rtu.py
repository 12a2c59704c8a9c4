from random import Random
from struct import pack, unpack_from

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.bus.conversation import PATIENCE
from piezod.devices.bus.line import LineFault
from piezod.devices.status import DeviceFlag
from piezod_drivers.modbus.checksum import checksum
from piezod_drivers.modbus.codec import ModbusRequest, WriteMany, read, write_one
from piezod_drivers.modbus.rtu_transactions import RtuTransactions
from tests.devices.bus.played_line import MS, PlayedLine

FORMS = [read("holding", 0, count) for count in (1, 2, 3)]
TIMEOUT_NS = 50 * MS


def with_checksum(pdu: bytes, unit: int = 1) -> bytes:
    """Return a frame."""
    return (frame := bytes((unit,)) + pdu) + checksum(frame)


def rtu(line: PlayedLine, silence_s: float = 0.0) -> RtuTransactions:
    """Return open transactions with units 1 and 2 over a line of the test."""
    transactions = RtuTransactions(line, TIMEOUT_NS * 1e-9, [1, 2], silence_s)
    transactions.open()
    return transactions


def registers(request: bytes, value: int) -> bytes:
    """Answer a read of holding registers: the first has this value, the others 0xFFFF."""
    _, count = unpack_from(">HH", request, 2)
    return with_checksum(bytes((3, 2 * count)) + pack(">H", value) + b"\xff\xff" * (count - 1))


def forms(line: PlayedLine) -> list[int]:
    """Return which of `FORMS` each request was: the first is for one register."""
    return [unpack_from(">H", request, 4)[0] - 1 for request in line.sent]


@pytest.mark.sees("modbus", "B4")
@pytest.mark.parametrize(
    "request_", [*FORMS, write_one(3, b"\x12\x34"), WriteMany(0, 1).request(b"\0\1")]
)
def test_no_flipped_bit_is_accepted(request_: ModbusRequest) -> None:
    """A reply of any kind with any flipped bit is refused."""
    pdu = (request_.echo + bytes(range(250)))[: request_.n_bytes]
    reply = with_checksum(pdu)
    flags = set()
    for bit in range(8 * len(reply)):
        damaged = bytearray(reply)
        damaged[bit // 8] ^= 1 << bit % 8
        line = PlayedLine(lambda _request, damaged=bytes(damaged): [(MS, damaged)])  # type: ignore[misc]
        with pytest.raises(LineFault) as caught:
            rtu(line).ask(1, [request_])
        flags.add(caught.value.flag)
    assert flags == {DeviceFlag.BAD_CHECKSUM, DeviceFlag.LATE_REPLY}
    line = PlayedLine(lambda _request: [(MS, reply)])
    assert rtu(line).ask(1, [request_]) == pdu


@pytest.mark.sees("modbus", "B5")
@pytest.mark.parametrize("n_forms", [1, 2, 3])
def test_no_late_reply_is_taken_for_another(n_forms: int) -> None:
    """With replies up to ten time-outs late, each value belongs to its request."""
    random, line = Random(n_forms), PlayedLine()  # noqa: S311 - repeatable
    number, last_ns, wrong, right, late = 0, 0, 0, 0, 0

    def answer(request: bytes) -> list[tuple[int, bytes]]:
        nonlocal last_ns
        delay_ns = MS
        if random.random() < 0.2:
            delay_ns = round(random.uniform(1, PATIENCE) * TIMEOUT_NS)
        last_ns = max(last_ns, line.t_ns + delay_ns)
        return [(last_ns - line.t_ns, registers(request, number))]

    line.answer = answer
    transactions = rtu(line)
    for number in range(3000):
        try:
            pdu = transactions.ask(1, FORMS[:n_forms], number % n_forms)
        except LineFault as fault:
            late += fault.flag is DeviceFlag.LATE_REPLY
            line.t_ns += 5 * MS
        else:
            right += unpack_from(">H", pdu, 2)[0] == number
            wrong += unpack_from(">H", pdu, 2)[0] != number
    assert wrong == 0
    assert right > 100
    assert late > 100


def test_other_forms_go_on_while_a_reply_is_owed() -> None:
    """A missing reply fails only its own exchange; a late one makes its form usable again."""
    line = PlayedLine()
    transactions = rtu(line)
    with pytest.raises(LineFault, match="no reply within"):
        transactions.ask(1, FORMS[:2], 0)
    line.answer = lambda request: [(MS, registers(request, 7))]
    for _ in range(3):
        transactions.ask(1, FORMS[:2], 0)
    assert forms(line)[-3:] == [1, 1, 1]
    assert not transactions.is_free(1, FORMS[:1])
    line.comes(registers(bytes((1, *FORMS[0].pdu)), 6))
    assert transactions.is_free(1, FORMS[:1])
    transactions.ask(1, FORMS[:2], 0)
    assert forms(line)[-1] == 0


def test_a_question_of_one_form_waits() -> None:
    """A request with one form waits until the late reply can no longer come."""
    line = PlayedLine()
    transactions = rtu(line)
    with pytest.raises(LineFault, match="no reply within"):
        transactions.ask(1, FORMS[:1])
    n_sent = len(line.sent)
    with pytest.raises(LineFault, match="may still come"):
        transactions.ask(1, FORMS[:1])
    assert len(line.sent) == n_sent
    line.answer = lambda request: [(MS, registers(request, 7))]
    transactions.settle()
    assert transactions.ask(1, FORMS[:1])[2:] == b"\0\7"
    assert line.t_ns > (1 + PATIENCE) * TIMEOUT_NS


def test_a_late_refusal_is_not_taken_for_another() -> None:
    """An exception belongs to the overdue request of its function, not to the present one."""
    line = PlayedLine()
    transactions = rtu(line)
    with pytest.raises(LineFault, match="no reply within"):
        transactions.ask(1, FORMS[:2], 0)
    line.answer = lambda request: [
        (MS, with_checksum(b"\x83\x06")),
        (2 * MS, registers(request, 7)),
    ]
    assert transactions.ask(1, FORMS[:2], 1)[2:] == b"\0\7\xff\xff"
    assert forms(line) == [0, 1]
    line.answer = lambda _request: [(MS, with_checksum(b"\x83\x06"))]
    with pytest.raises(LineFault, match="busy"):
        transactions.ask(1, FORMS[:2], 0)


def test_another_unit_is_not_heard() -> None:
    """A reply of another unit is no reply to this request."""
    line = PlayedLine(
        lambda _request: [
            (MS, with_checksum(b"\x03\x02\0\7", 2) + with_checksum(b"\x03\x02\0\7", 9))
        ]
    )
    transactions = rtu(line)
    with pytest.raises(LineFault, match="no reply within"):
        transactions.ask(1, FORMS[:1])


@pytest.mark.sees("modbus", "B3")
@given(st.binary(max_size=700), st.binary(max_size=20))
def test_garbage_around_a_reply_is_skipped(before: bytes, after: bytes) -> None:
    """A reply is found among garbage, or raises a fault, and the next one is found."""
    line = PlayedLine(lambda request: [(MS, before + registers(request, 7) + after)])
    transactions = rtu(line)
    try:
        assert transactions.ask(1, FORMS[:1])[2:] == b"\0\7"
    except LineFault:
        transactions.settle()
    line.answer = lambda request: [(MS, registers(request, 8))]
    try:
        transactions.ask(1, FORMS, 1)
    except LineFault:
        assert transactions.ask(1, FORMS, 2)[2:4] == b"\0\x08"


def test_the_line_rests_before_a_request() -> None:
    """A silence separates a reply from the next request."""
    line = PlayedLine(lambda request: [(MS, registers(request, 7))])
    transactions = rtu(line, silence_s=0.004)
    begin_ns = line.t_ns
    for _ in range(3):
        transactions.ask(1, FORMS[:1])
    assert line.t_ns - begin_ns == 3 * MS + 2 * 4 * MS
