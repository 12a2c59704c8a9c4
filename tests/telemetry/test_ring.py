import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.telemetry.layout import Layout
from piezod.telemetry.ring import RingReader, RingWriter
from piezod.telemetry.shared_map import SharedMap, attach, create
from tests.telemetry.conftest import CAPACITY, fields_of

HAMMER = Path(__file__).with_name("hammer.py")
KEPT = CAPACITY - 1  # the place of the record after the newest is not to be relied on


def test_record_comes_out_as_it_went_in(shared: SharedMap) -> None:
    """Every field, of the cycle and of each axis, under its name."""
    reader = RingReader(shared)

    seq = RingWriter(shared).append(fields_of(5))

    record = reader.latest()
    assert record is not None
    assert (seq, record["seq"], record["end_seq"]) == (1, 1, 1)
    assert (record["t_ns"], record["state"], record["shadow"]) == (5, 5, True)
    assert list(record["axes"]["drive_v"]) == [5.0, 5.0]


def test_empty_ring_has_nothing_to_tell(shared: SharedMap) -> None:
    """Before the first cycle there is no newest record, and nothing is lost."""
    reader = RingReader(shared)

    assert reader.latest() is None
    assert len(reader.last(10)) == 0
    assert reader.read(10)[1] == 0


@given(turns=st.lists(st.tuples(st.integers(0, 150), st.integers(1, 100)), max_size=20))
def test_each_record_is_read_once_or_counted_as_lost(
    tmp_path_factory: pytest.TempPathFactory, turns: list[tuple[int, int]]
) -> None:
    """However writing and reading alternate, the records come in order, and the sum is right."""
    path = tmp_path_factory.mktemp("ring") / "loop.map"
    shared = create(path, Layout(("x",), CAPACITY, 1_000_000))
    writer, reader = RingWriter(shared), RingReader(shared)
    read: list[int] = []
    lost = written = 0

    for appended, limit in turns:
        for _ in range(appended):
            written += 1
            writer.append(fields_of(written, axes=1))
        records, more = reader.read(limit)
        assert len(records) <= limit
        read += [int(number) for number in records["t_ns"]]
        lost += more
    records, more = reader.read(10**6)
    read += [int(number) for number in records["t_ns"]]

    assert read == sorted(set(read))
    assert len(read) + lost + more == written


def test_what_was_overwritten_is_counted(shared: SharedMap) -> None:
    """A reader that comes late gets the newest, and is told how many it missed."""
    reader, writer = RingReader(shared), RingWriter(shared)
    for number in range(1, 3 * CAPACITY + 1):
        writer.append(fields_of(number))

    records, lost = reader.read(10**6)

    assert lost == 3 * CAPACITY - KEPT
    assert records["t_ns"][-1] == 3 * CAPACITY
    assert len(records) == KEPT


def test_last_records_leave_the_position(shared: SharedMap) -> None:
    """Looking back is not reading."""
    reader, writer = RingReader(shared), RingWriter(shared)
    for number in range(1, 11):
        writer.append(fields_of(number))

    assert list(reader.last(3)["t_ns"]) == [8, 9, 10]
    assert len(reader.last(10**6)) == 10
    assert len(reader.read(100)[0]) == 10


def test_half_written_record_is_not_told(shared: SharedMap) -> None:
    """One whose numbers at both ends differ is left out."""
    reader, writer = RingReader(shared), RingWriter(shared)
    for number in (1, 2, 3):
        writer.append(fields_of(number))
    size = len(shared.part("ring")) // CAPACITY
    shared.part("ring").cast("q")[2 * size // 8] = 99  # as if its writer had just begun anew

    records, lost = reader.read(10)

    assert list(records["t_ns"]) == [1, 3]
    assert lost == 1


def test_writer_goes_on_where_the_one_before_ended(shared: SharedMap) -> None:
    """Numbers do not start again when the ring gets another writer."""
    RingWriter(shared).append(fields_of(1))

    assert RingWriter(shared).append(fields_of(2)) == 2


def hammered(shared: SharedMap, count: int) -> tuple[int, int]:
    """Read while another process writes without a pause; return records read and lost."""
    reader = RingReader(attach(shared.path))
    read = lost = 0
    with subprocess.Popen([sys.executable, HAMMER, shared.path, str(count)]) as process:
        while read + lost < count:
            ended = process.poll() is not None
            records, more = reader.read(CAPACITY)
            axes, numbers = records["axes"], records["t_ns"]
            for name in ("drive_v", "sample_ns", "motion"):
                assert np.all(axes[name] == numbers[:, None])
            assert np.all(records["latched_hi"] == numbers)
            assert np.all(records["seq"] == numbers)
            read, lost = read + len(records), lost + more
            assert read + lost == count or not ended
    return read, lost


def test_readers_never_see_a_torn_record(shared: SharedMap) -> None:
    """A writer that never pauses cannot make a reader take halves of two records for one."""
    read, lost = hammered(shared, 200_000)

    assert read + lost == 200_000


@pytest.mark.stress
def test_readers_never_see_a_torn_record_for_long(shared: SharedMap) -> None:
    """The same, with 20 million records."""
    read, lost = hammered(shared, 20_000_000)

    assert read + lost == 20_000_000
