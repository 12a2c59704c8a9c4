"""Wire faults: their syntax, when they happen, and their effect on replies."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.devices.emulation.faults import ActiveFault, WireFault, WireFaultKind, WireFaults, parse
from piezod.devices.emulation.outbox import Outbox

MS = 1_000_000


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("lost", WireFault(WireFaultKind.LOST)),
        ("lost:7", WireFault(WireFaultKind.LOST, 7, 7)),
        ("garbled:7-9:13", WireFault(WireFaultKind.GARBLED, 7, 9, value=(13, 13))),
        ("partial:7-", WireFault(WireFaultKind.PARTIAL, 7)),
        ("duplicated:every 7", WireFault(WireFaultKind.DUPLICATED, every=7)),
        ("late:every 7:0.01-0.2", WireFault(WireFaultKind.LATE, every=7, value=(0.01, 0.2))),
        ("disconnect:now:2", WireFault(WireFaultKind.DISCONNECT, 0, 0, value=(2, 2))),
        ("wrong-identity:3", WireFault(WireFaultKind.IMPOSTOR, 3, 3)),
    ],
)
def test_fault_is_what_was_written(text: str, fault: WireFault) -> None:
    """Kind, replies and value are parsed."""
    assert parse(text) == fault


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "unknown fault '' in ''"),
        ("slow", "known: late, lost"),
        ("late", "needs a delay in s"),
        ("late:3", "needs a delay in s"),
        ("lost:now", "affects replies, it cannot happen now"),
        ("lost:0", "counted from 1"),
        ("lost:5-3", "counted from 1, in rising order"),
        ("lost:every 0", "a number of at least 1"),
        ("lost:often", "'often' selects no reply"),
        ("late:1:soon", "invalid value 'soon'"),
        ("late:1:2-1", "invalid value '2-1'"),
        ("late:1:9999", "invalid value '9999'"),
        ("late:1:0.1:x", "too many parts"),
    ],
)
def test_invalid_faults_are_refused(text: str, why: str) -> None:
    """The message states what was expected."""
    with pytest.raises(ValueError, match=why):
        parse(text)


@given(st.text(alphabet="latenowevery:-. 0123456789", max_size=30) | st.text(max_size=20))
def test_any_text_is_a_fault_or_refused(text: str) -> None:
    """No other error than `ValueError` is raised."""
    with suppress(ValueError):
        parse(text)


def test_replies_are_counted_from_the_last_change() -> None:
    """Several faults may affect one reply; new faults start a new count."""
    faults = WireFaults([parse("lost:2"), parse("garbled:every 2:3")])
    first = [faults.next_reply() for _ in range(4)]
    faults.set([parse("lost:2-3")])
    second = [[hit.kind for hit in faults.next_reply()] for _ in range(4)]

    garbled = ActiveFault(WireFaultKind.GARBLED, 3.0)
    assert first == [[], [ActiveFault(WireFaultKind.LOST, None), garbled], [], [garbled]]
    assert second == [[], ["lost"], ["lost"], []]


def test_at_once_is_once() -> None:
    """An immediate fault affects no reply and is reported once."""
    faults = WireFaults([parse("disconnect:now")])

    assert faults.at_once() == [ActiveFault(WireFaultKind.DISCONNECT, 0.5)]
    assert (faults.at_once(), faults.next_reply()) == ([], [])


def sent(reply: bytes, *hits: ActiveFault, wait_ns: int = 0) -> bytes:
    """Return the bytes of a reply that are sent within some time."""
    outbox = Outbox(WireFaults())
    outbox.put(reply, hits, 0)
    return outbox.take(wait_ns)


@pytest.mark.parametrize(
    ("hits", "comes"),
    [
        ([], b"abcd"),
        ([ActiveFault(WireFaultKind.LOST, None)], b""),
        ([ActiveFault(WireFaultKind.DUPLICATED, None)], b"abcdabcd"),
        ([ActiveFault(WireFaultKind.PARTIAL, None)], b"ab"),
        ([ActiveFault(WireFaultKind.PARTIAL, 3.0)], b"abc"),
        ([ActiveFault(WireFaultKind.GARBLED, 9.0)], b"a`cd"),
        (
            [ActiveFault(WireFaultKind.PARTIAL, 1.0), ActiveFault(WireFaultKind.DUPLICATED, None)],
            b"aa",
        ),
    ],
)
def test_reply_with_each_fault(hits: list[ActiveFault], comes: bytes) -> None:
    """The faults apply one after the other."""
    assert sent(b"abcd", *hits) == comes


def test_one_bit_is_flipped() -> None:
    """Without a value it is a random bit; an empty reply stays empty."""
    (flipped,) = [sent(b"abcd", ActiveFault(WireFaultKind.GARBLED, None))]
    bits = int.from_bytes(flipped) ^ int.from_bytes(b"abcd")

    assert bits.bit_count() == 1
    assert sent(b"", ActiveFault(WireFaultKind.GARBLED, None)) == b""


def test_noise_comes_before_the_reply() -> None:
    """The noise has the given number of bytes."""
    noisy = sent(b"abcd", ActiveFault(WireFaultKind.NOISE, 5.0))

    assert (len(noisy), noisy[-4:]) == (9, b"abcd")


def test_late_reply_holds_up_those_behind_it() -> None:
    """A device answers in order; the outbox reports the wait until the next reply."""
    outbox = Outbox(WireFaults())
    outbox.put(b"1", [ActiveFault(WireFaultKind.LATE, 0.05)], 0)
    outbox.put(b"2", [], MS)
    waits = [outbox.wait_ns(now_ns, 100 * MS) for now_ns in (0, 49 * MS, 60 * MS)]

    assert waits == [50 * MS, MS, 0]
    assert (outbox.take(49 * MS), outbox.take(50 * MS)) == (b"", b"12")
    assert outbox.wait_ns(0, 7) == 7
