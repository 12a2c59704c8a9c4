import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.telemetry.layout import (
    ANSWER_BYTES,
    ANSWER_SLOTS,
    REQUEST_BYTES,
    REQUEST_SLOTS,
    URGENT_BYTES,
    URGENT_SLOTS,
    Layout,
)
from piezod.telemetry.mailbox import EXPIRED, MailboxFullError, MailboxReader, MailboxWriter
from piezod.telemetry.shared_map import SharedMap, create
from piezod.telemetry.words import Word

LATER = 1000


def test_request_arrives_once(shared: SharedMap) -> None:
    """A posted request is taken once, with its number."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)

    number = writer.post(b"move", LATER)

    assert reader.take(0) == (number, b"move")
    assert reader.take(0) is None


def test_requests_keep_their_order(shared: SharedMap) -> None:
    """Requests are taken in the order of their numbers."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    sent = [(writer.post(str(i).encode(), LATER), str(i).encode()) for i in range(REQUEST_SLOTS)]

    taken = [reader.take(0) for _ in range(REQUEST_SLOTS)]

    assert taken == sent
    assert [number for number, _ in sent] == list(range(1, REQUEST_SLOTS + 1))


def test_urgent_request_comes_first(shared: SharedMap) -> None:
    """A stop does not queue behind movements, even if their lane is full."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    for _ in range(REQUEST_SLOTS):
        writer.post(b"move", LATER)

    number = writer.post(b"stop", LATER, urgent=True)

    assert reader.take(0) == (number, b"stop")


@pytest.mark.parametrize(("urgent", "slots"), [(False, REQUEST_SLOTS), (True, URGENT_SLOTS)])
def test_full_lane_refuses(shared: SharedMap, urgent: bool, slots: int) -> None:
    """Nothing is overwritten; after one request was taken there is room again."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    for i in range(slots):
        writer.post(str(i).encode(), LATER, urgent=urgent)

    with pytest.raises(MailboxFullError, match=f"{slots} requests wait"):
        writer.post(b"more", LATER, urgent=urgent)
    first = reader.take(0)
    writer.post(b"more", LATER, urgent=urgent)

    assert first is not None
    assert first[1] == b"0"


@pytest.mark.parametrize(("urgent", "size"), [(False, REQUEST_BYTES), (True, URGENT_BYTES)])
def test_payload_may_fill_its_slot_and_no_more(shared: SharedMap, urgent: bool, size: int) -> None:
    """The largest payload arrives complete; a larger one is refused."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    payload = bytes(i % 251 for i in range(size))

    number = writer.post(payload, LATER, urgent=urgent)

    assert reader.take(0) == (number, payload)
    with pytest.raises(MailboxFullError, match=f"at most {size} bytes"):
        writer.post(payload + b"x", LATER, urgent=urgent)


def test_there_is_always_room_for_an_emergency_stop(shared: SharedMap) -> None:
    """It is accepted with full lanes and repeatedly; one answer serves all."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    for _ in range(URGENT_SLOTS):
        writer.post(b"hold", LATER, urgent=True)
    numbers = [writer.post_estop() for _ in range(10 * URGENT_SLOTS)]
    before = writer.estop_answer(numbers[0])

    taken = reader.take_estop()
    reader.answer_estop(taken, accepted=True, why="")

    assert before is None
    assert taken == numbers[-1]
    done = (True, "", 0, 0.0)
    assert [writer.estop_answer(number) for number in numbers] == [done] * len(numbers)
    assert reader.take_estop() == 0


def test_emergency_stop_that_comes_meanwhile_stays_open(shared: SharedMap) -> None:
    """The answer to an earlier stop does not answer it."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    first = writer.post_estop()
    taken = reader.take_estop()
    second = writer.post_estop()

    reader.answer_estop(taken, accepted=True, why="")

    assert writer.estop_answer(first) is not None
    assert writer.estop_answer(second) is None
    assert reader.take_estop() == second


def test_answer_is_found_by_number(shared: SharedMap) -> None:
    """Before the answer there is none."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    number = writer.post(b"move", LATER)
    before = writer.answer(number)

    reader.answer(number, accepted=True, motion=3, duration_s=1.5, why="")

    assert before is None
    assert writer.answer(number) == (True, "", 3, 1.5)


def test_long_answer_is_cut_off_between_letters(shared: SharedMap) -> None:
    """The text fits into its slot and is valid UTF-8."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    reader.answer(1, accepted=False, why="x" + "µ" * ANSWER_BYTES)

    answer = writer.answer(1)

    assert answer is not None
    assert answer.why == "x" + "µ" * (ANSWER_BYTES // 2 - 1)


def test_old_answers_are_overwritten(shared: SharedMap) -> None:
    """The answers to the newest requests are kept."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    for number in range(1, ANSWER_SLOTS + 2):
        reader.answer(number, accepted=True, motion=number, why="")

    assert writer.answer(1) is None
    assert writer.answer(2) == (True, "", 2, 0.0)


def test_expired_request_is_answered_and_dropped(shared: SharedMap) -> None:
    """The loop gets the next request that has not expired, and the count rises."""
    writer, reader = MailboxWriter(shared), MailboxReader(shared)
    late, wanted = writer.post(b"late", 10), writer.post(b"wanted", 30)

    taken = reader.take(20)

    assert taken == (wanted, b"wanted")
    assert writer.answer(late) == (False, EXPIRED, 0, 0.0)
    assert shared.words[Word.REQUESTS_EXPIRED] == 1


def test_numbers_continue_with_a_new_writer(shared: SharedMap) -> None:
    """Another writer of the same memory does not use a number twice."""
    MailboxWriter(shared).post(b"a", LATER)
    MailboxWriter(shared).post(b"b", LATER, urgent=True)

    assert MailboxWriter(shared).post(b"c", LATER) == 3


@given(payloads=st.lists(st.binary(max_size=2000), max_size=40))
def test_any_payload_passes(
    tmp_path_factory: pytest.TempPathFactory, payloads: list[bytes]
) -> None:
    """Slots are used again, and no request leaves bytes in the next one."""
    shared = create(tmp_path_factory.mktemp("m") / "loop.map", Layout(("x",), 64, 10**6))
    writer, reader = MailboxWriter(shared), MailboxReader(shared)

    for payload in payloads:
        number = writer.post(payload, LATER)
        assert reader.take(0) == (number, payload)
