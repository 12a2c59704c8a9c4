"""Finds the samples of a displacement that no stage can have made.

An outlier leaves and comes back within a few samples; after a jump, as of an interferometer that
has lost a fringe, the displacement stays elsewhere; a sensor that is stuck or at the end of its
range gives one value while the drive moves. What the drive may have caused is none of these: a
change of the displacement counts by how far it exceeds the median of its neighbours, and only
beyond what the drive changes by at the same time.
"""

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its sizes."""
RESPONSE_S = 0.05
"""Time within which a stage has followed its drive, and has stopped to ring; in s."""
NEIGHBOURS = 7
"""Changes whose median is the usual one, odd."""
LONGEST_OUTLIER = 5
"""Longest outlier, in samples."""
LEVEL = 11
"""Samples before and after a jump that show whether the displacement stays elsewhere."""
STANDS_OUT = 0.5
"""Changes around an outlier or a jump are at most this share of it."""
NOISES, STEPS, LEAST_SHARE = 8.0, 3.0, 0.004
"""A change counts beyond 8 standard deviations of the usual ones, 3 steps of a coarse sensor, and
0.4 % of the range."""
BEND_FACTOR, SHARP_FACTOR = 0.5, 2.0
"""A stage follows smooth and sharp bends of its drive by at most these multiples of its mean gain
more than a line does."""
CLIPPED_SIGMAS, CLIPPED_BAND = 8.0, 0.01
"""A clipped sensor with noise stays within 8 standard deviations of its end; at most 1 % of the
range counts, which a stage leaves while its drive moves by a few percent."""
STUCK_SHARE, FEWEST_STUCK = 0.03, 5
"""A sensor is stuck if it shows one value for this many samples, while the drive moves over this
share of its range."""
CLIPPED_SHARE = 0.1
"""A sensor shows its highest or lowest value while the drive moves over at most this share of its
range; if it moves more, the sensor is at the end of its own range."""


class Kind(StrEnum):
    """What samples are."""

    OUTLIER = "outlier"
    JUMP = "jump"
    STUCK = "stuck"
    CLIPPED = "clipped"


class Bad(NamedTuple):
    """Samples in a row that are not true."""

    kind: Kind
    first: int  #: The first sample; of a jump, the first after it.
    last: int  #: The last sample.
    size: float  #: How far they are off, in µm; of stuck ones, how far the drive moves, in V.


def bad_samples(record: Record) -> list[Bad]:
    """Return the samples of a displacement that are not true, in the order of time."""
    runs = _Runs.of(record.position_um)
    standing = list(_standing(record, runs))
    if not any(bad.kind is Kind.CLIPPED for bad in standing):
        standing += _clipped_in_noise(record)
    moves = np.ones(record.t_s.size, np.bool_)
    for bad in standing:
        moves[bad.first : bad.last + 1] = False
    # The end of a value that was stuck is no jump of its own.
    leaps = (
        bad for bad in _leaps(record, runs.typical) if moves[bad.first - 1 : bad.last + 1].all()
    )
    return sorted((*standing, *leaps), key=lambda bad: bad.first)


class _Runs(NamedTuple):
    """Runs of equal values; arrays of shape (k,)."""

    first: np.ndarray[tuple[int], np.dtype[np.intp]]
    last: np.ndarray[tuple[int], np.dtype[np.intp]]

    @classmethod
    def of(cls, values: FloatArray) -> "_Runs":
        breaks = np.flatnonzero(np.diff(values)) + 1
        return cls(np.append(0, breaks), np.append(breaks, values.size) - 1)

    @property
    def typical(self) -> int:
        """Samples for which a value stands usually: more than one if the sensor is slow."""
        return max(int(np.median(self.last - self.first)) + 1, 1)


def _standing(record: Record, runs: _Runs) -> Iterator[Bad]:
    """Yield the runs in which the sensor stands and the drive moves."""
    x, v = record.position_um, record.drive_v
    range_v, step_um = float(np.ptp(v)), resolution(x)
    ends = (float(x.min()), float(x.max()))
    long = runs.last - runs.first >= max(FEWEST_STUCK, 4 * runs.typical) - 1
    share = max(STUCK_SHARE, 4.0 * step_um / float(np.ptp(x)))
    for first, last in zip(runs.first[long].tolist(), runs.last[long].tolist(), strict=True):
        moved_v = float(np.ptp(v[first : last + 1]))
        at_end = float(x[first]) in ends
        # A drive that only jumps at the end of a hold is followed one delay later.
        early_v = float(np.ptp(v[first : (first + last) // 2 + 1]))
        if at_end and moved_v > CLIPPED_SHARE * range_v:
            yield Bad(Kind.CLIPPED, first, last, moved_v)
        elif not at_end and moved_v > share * range_v and early_v > 0.3 * share * range_v:
            yield Bad(Kind.STUCK, first, last, moved_v)


def _clipped_in_noise(record: Record) -> Iterator[Bad]:
    """Yield the parts in which a noisy sensor stays at its end while the drive moves."""
    x, v = record.position_um, record.drive_v
    # Second differences of white noise have six times its variance; motion adds little.
    noise_um = float(np.median(np.abs(np.diff(x, 2)))) * SIGMA_OF_MEDIAN / 6.0**0.5
    band_um = min(CLIPPED_SIGMAS * noise_um, CLIPPED_BAND * float(np.ptp(x)))
    share_v = CLIPPED_SHARE * float(np.ptp(v))
    for near, at_end in (
        (x >= x.max() - band_um, v >= v.max() - share_v),
        (x <= x.min() + band_um, v <= v.min() + share_v),
    ):
        # A delay moves the time at an end, and does not lengthen it.
        if np.sum(near) <= 1.1 * np.sum(at_end) + FEWEST_STUCK:
            continue
        edges = np.flatnonzero(np.diff(np.concatenate(([False], near, [False]))))
        for first, after in edges.reshape(-1, 2).tolist():
            moved_v = float(np.ptp(v[first:after]))
            if moved_v > share_v:
                yield Bad(Kind.CLIPPED, first, after - 1, moved_v)


def resolution(values: FloatArray) -> float:
    """Return the smallest step between values, which are coarse if it is large."""
    steps = np.diff(np.unique(values))
    return float(np.median(steps)) if steps.size else 0.0


def _leaps(record: Record, every: int) -> Iterator[Bad]:
    """Yield outliers and jumps; one sample in `every` has a new value."""
    x, v = record.position_um[::every], record.drive_v[::every]
    if x.size <= 4 * LEVEL:
        return
    excess, allowed = _excess(x, v, record.period_s * every)
    # At both ends too little is known of the motion.
    large = np.flatnonzero(np.abs(excess[LEVEL:-LEVEL]) > allowed[LEVEL:-LEVEL]) + LEVEL
    breaks = np.flatnonzero(np.diff(large) > LONGEST_OUTLIER) + 1
    for group in np.split(large, breaks) if large.size else ():
        first, last = int(group[0]), int(group[-1])
        size = float(excess[group[np.argmax(np.abs(excess[group]))]])
        around = np.concatenate((excess[first - LEVEL : first], excess[last + 1 : last + LEVEL]))
        if last - first > LONGEST_OUTLIER or np.max(np.abs(around)) > STANDS_OUT * abs(size):
            continue  # ringing, or a disturbance
        left = _lasting(x, first, last + 1)
        if abs(left) > 0.5 * abs(size) and left * size > 0.0:
            yield Bad(Kind.JUMP, every * (first + 1), every * (last + 1), left)
        elif last > first:
            yield Bad(Kind.OUTLIER, every * (first + 1), every * (last + 1) - 1, size)


def _lasting(x: FloatArray, before: int, after: int) -> float:
    """Return by how much a displacement stays changed between two samples."""
    earlier, later = x[max(before - LEVEL + 1, 0) : before + 1], x[after : after + LEVEL]
    usual = float(np.median(np.concatenate((np.diff(earlier), np.diff(later)))))
    apart = 0.5 * (earlier.size + later.size) + after - before - 1
    return float(np.median(later) - np.median(earlier)) - usual * apart


def _excess(x: FloatArray, v: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return by how much each change of a displacement is unusual, and what is allowed."""
    range_um = float(np.ptp(np.percentile(x, (0.5, 99.5))))
    gain = range_um / float(np.ptp(v))
    excess, driven = _unusual(np.diff(x)), np.diff(v)
    noise_um = SIGMA_OF_MEDIAN * float(np.median(np.abs(excess)))
    floor = max(NOISES * noise_um, STEPS * resolution(x), LEAST_SHARE * range_um)
    bends = maximum_filter1d(driven, NEIGHBOURS) - minimum_filter1d(driven, NEIGHBOURS)
    # A sharp bend of the drive counts until the stage has followed. Before the record it may have
    # rested.
    response = max(int(np.ceil(RESPONSE_S / period_s)), NEIGHBOURS)
    sharp = maximum_filter1d(
        np.abs(np.diff(driven, prepend=0.0)),
        response + NEIGHBOURS,
        origin=(response - NEIGHBOURS) // 2,
        mode="constant",
    )
    return excess, floor + gain * (BEND_FACTOR * bends + SHARP_FACTOR * sharp)


def _unusual(changes: FloatArray) -> FloatArray:
    """Return changes without the median of their neighbours."""
    unusual: FloatArray = changes - median_filter(changes, NEIGHBOURS, mode="nearest")
    return unusual
