"""The counts of the cycles, and those of the devices."""

from math import inf, nan

import pytest

from piezod.telemetry.cycle_counts import LIMITS, CycleCounter, Histogram, counts_of
from piezod.telemetry.device_counts import DeviceCounts, device_counts_of, put_device_counts
from piezod.telemetry.layout import BUCKETS, Layout
from piezod.telemetry.shared_map import SharedMap, create

LATE_NS = 500_000


def only(bucket: int, total: int, count: int = 1) -> Histogram:
    """Return a histogram whose values are all in one bucket."""
    return Histogram(tuple(count * (i == bucket) for i in range(BUCKETS)), total)


def test_cycles_are_counted(shared: SharedMap) -> None:
    """The counts have the times of all cycles, and the cycles that began late."""
    counter = CycleCounter(shared, LATE_NS)
    for late_ns, skipped in ((LATE_NS, 0), (LATE_NS + 1, 0), (0, 2)):
        counter.cycle(late_ns, skipped, read_ns=20, write_ns=30, busy_ns=1000)

    counts = counts_of(shared)

    assert (counts.late, counts.read_ns, counts.write_ns) == (2, 60, 90)
    assert counts.duration == only(0, 3000, 3)
    assert (sum(counts.lateness.buckets), counts.lateness.total) == (3, 2 * LATE_NS + 1)


@pytest.mark.parametrize("place", range(BUCKETS - 1))
def test_a_limit_belongs_to_its_bucket(shared: SharedMap, place: int) -> None:
    """A value equal to the limit of a bucket is in it, the next larger one is not."""
    limit_ns = LIMITS[place] * 1000
    counter = CycleCounter(shared, LATE_NS)
    counter.cycle(limit_ns, 0, 0, 0, limit_ns + 1)

    assert counts_of(shared).lateness == only(place, limit_ns)
    assert counts_of(shared).duration == only(place + 1, limit_ns + 1)


def test_times_beyond_all_limits_are_in_the_last_bucket(shared: SharedMap) -> None:
    """A stall of an hour is counted too."""
    hour_ns = 3600 * 10**9
    CycleCounter(shared, LATE_NS).cycle(hour_ns, 0, 0, 0, hour_ns)

    assert counts_of(shared).lateness == only(BUCKETS - 1, hour_ns)


def test_errors_are_counted_for_each_axis(shared: SharedMap) -> None:
    """An error is counted without its sign, and not if it is no number."""
    counter = CycleCounter(shared, LATE_NS)
    for error_um in (nan, inf, -0.003, 0.004):
        counter.error(1, error_um)
    counter.error(0, 0.0)

    assert counts_of(shared).errors == (only(0, 0), only(2, 7000, 2))


@pytest.mark.parametrize("error_um", [1e30, -1e13])
def test_an_impossible_error_does_not_end_the_loop(shared: SharedMap, error_um: float) -> None:
    """It counts as one of 1 m."""
    CycleCounter(shared, LATE_NS).error(1, error_um)

    assert counts_of(shared).errors[1] == only(BUCKETS - 1, 10**12)


def test_counts_of_devices(tmp_path_factory: pytest.TempPathFactory) -> None:
    """The counts of each device are those that were published last."""
    layout = Layout(("x",), 64, 1_000_000, ("stage", "sensor"))
    shared = create(tmp_path_factory.mktemp("m") / "loop.map", layout)
    put_device_counts(shared, 1, DeviceCounts(5, 2, 300, (0, 4)))

    assert device_counts_of(shared, 2) == [
        DeviceCounts(0, 0, 0, [0, 0]),
        DeviceCounts(5, 2, 300, [0, 4]),
    ]
