import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.telemetry.arrays import RingReader
from piezod.telemetry.layout import Layout
from piezod.telemetry.ring import RecordReader, RingWriter
from piezod.telemetry.shared_map import SharedMap, attach, create
from tests.telemetry.conftest import CAPACITY, fields_of

HAMMER = Path(__file__).with_name("hammer.py")
KEPT = CAPACITY - 1  # the place of the record after the newest is not to be relied on


def write(shared: SharedMap, count: int) -> None:
    """Write records with the times from 1 on."""
    writer = RingWriter(shared)
    for number in range(1, count + 1):
        writer.append(fields_of(number))


def test_record_is_read_as_written(shared: SharedMap) -> None:
    """Every field of the cycle and of each axis has its value, one by one and in an array."""
    reader = RingReader(shared)

    seq = RingWriter(shared).append(fields_of(5))

    record = RecordReader(shared).latest()
    records, _ = reader.read(10)
    assert record is not None
    assert (seq, record["seq"], records["end_seq"][0]) == (1, 1, 1)
    assert (record["t_ns"], record["state"], record["shadow"]) == (5, 5, True)
    for name in record.keys() - {"axes"}:
        assert record[name] == records[name][0]
    for name in record["axes"][0]:
        assert [axis[name] for axis in record["axes"]] == list(records["axes"][name][0])


def test_empty_ring_has_no_record(shared: SharedMap) -> None:
    """Before the first cycle there is no record, and none is lost."""
    reader = RingReader(shared)

    assert RecordReader(shared).latest() is None
    assert len(reader.last(10)) == 0
    assert reader.read(10)[1] == 0


def test_newest_records_are_read_in_order(shared: SharedMap) -> None:
    """No more records are read than the ring holds; the oldest comes first."""
    reader = RecordReader(shared)
    write(shared, 2 * CAPACITY)

    assert [record["t_ns"] for record in reader.last(2)] == [2 * CAPACITY - 1, 2 * CAPACITY]
    assert len(reader.last(10**6)) == KEPT


@pytest.mark.parametrize("end", [0, -1])
def test_half_written_newest_record_is_not_returned(shared: SharedMap, end: int) -> None:
    """A record with another number at one of its ends is not read."""
    writer = RingWriter(shared)
    writer.append(fields_of(1))
    size = len(shared.part("ring")) // CAPACITY
    words = shared.part("ring")[size : 2 * size].cast("q")
    words[end] = 99

    assert RecordReader(shared).latest() is None


@given(turns=st.lists(st.tuples(st.integers(0, 150), st.integers(1, 100)), max_size=20))
def test_each_record_is_read_once_or_counted_as_lost(
    tmp_path_factory: pytest.TempPathFactory, turns: list[tuple[int, int]]
) -> None:
    """For any sequence of writes and reads the records are in order and the sum is right."""
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


def test_overwritten_records_are_counted(shared: SharedMap) -> None:
    """A late reader gets the newest records and the number of lost ones."""
    reader = RingReader(shared)
    write(shared, 3 * CAPACITY)

    records, lost = reader.read(10**6)

    assert lost == 3 * CAPACITY - KEPT
    assert records["t_ns"][-1] == 3 * CAPACITY
    assert len(records) == KEPT


def test_last_does_not_change_the_position(shared: SharedMap) -> None:
    """`last` returns records without reading them."""
    reader = RingReader(shared)
    write(shared, 10)

    assert list(reader.last(3)["t_ns"]) == [8, 9, 10]
    assert len(reader.last(10**6)) == 10
    assert len(reader.read(100)[0]) == 10


def test_half_written_record_is_not_returned(shared: SharedMap) -> None:
    """A record with different numbers at its ends is dropped."""
    reader = RingReader(shared)
    write(shared, 3)
    size = len(shared.part("ring")) // CAPACITY
    shared.part("ring").cast("q")[2 * size // 8] = 99  # as if its writer had just started a record

    records, lost = reader.read(10)

    assert list(records["t_ns"]) == [1, 3]
    assert lost == 1


def test_new_writer_continues_the_numbers(shared: SharedMap) -> None:
    """The numbers do not start again with another writer."""
    RingWriter(shared).append(fields_of(1))

    assert RingWriter(shared).append(fields_of(2)) == 2


@pytest.mark.parametrize("count", [80_000, pytest.param(20_000_000, marks=pytest.mark.stress)])
def test_readers_never_see_a_torn_record(shared: SharedMap, count: int) -> None:
    """No reader gets halves of two records from a writer that never pauses."""
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

    assert read + lost == count
