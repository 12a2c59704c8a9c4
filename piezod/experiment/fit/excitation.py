"""Finds the excitation that a record lacks, and recommends a drive that has all of it.

A swing determines the weights of thresholds below its length, motion on several time scales
determines the creep, and several frequencies determine the delay. Swings below a tenth of the range
are not required: they contain little hysteresis.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, floor, inf, pi
from typing import NamedTuple

import numpy as np

from piezod.experiment.fit.delay import has_one_frequency
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

DEADBAND = 0.01
"""Smallest return of the displacement that is a turn, as a share of the range."""
SIZE_BOUNDS = (0.1, 0.2, 0.4, 0.7, 1.0)
"""Bounds of the classes of swings, as shares of the range."""
MIN_SWINGS = 2
"""Smallest number of swings in a class: one up, one down."""
PARTIAL_SWING = 0.7
"""Swings up to this share of the range show how the hysteresis depends on the height."""
HEIGHTS = ("lower", "middle", "upper")
CREEP_S = 10.0
"""A shorter record does not show creep: it has seen less than half of the lags, and what it has
looks like wider loops."""
FULL_HZ, FAST_HZ, FAST_SHARE = 0.7, 5.0, 0.7
"""Frequency of the full swings of the recommended drive, and frequency and swing, as a share of the
range, of its fastest part."""
SLEW_SHARE = 0.8
"""The recommended drive uses at most this share of the slew rate, which may be an optimistic
number."""
MIN_TIME_RATIO = 5.0
"""Some motion or hold must last this many times the fastest swing."""


class Swings(NamedTuple):
    """Swings from one turning point to the next; arrays of shape (k,)."""

    sizes: FloatArray  #: Lengths, as shares of the range.
    middles: FloatArray  #: Middles, from 0 at the lowest displacement to 1 at the highest.
    durations_s: FloatArray  #: Durations, with holds on the way, in s.


def missing_excitation(record: Record) -> tuple[str, ...]:
    """Return the excitation that a record lacks, a sentence each.

    Args:
        record: Drive and displacement; the displacement without noise, because noise turns, too.
    """
    counted = record.counted()
    t_s, position_um = record.t_s[counted], record.position_um[counted]
    range_um = float(np.ptp(position_um))
    if not range_um:
        return ("The displacement does not move.",)
    swings = swings_of(t_s, (position_um - position_um.min()) / range_um)
    long_enough = () if shows_creep(record) else (f"Time for the creep: {CREEP_S:g} s are needed.",)
    return (
        *long_enough,
        *_missing_sizes(swings, range_um),
        *_missing_heights(swings, range_um),
        *_missing_times(swings),
        *_missing_frequencies(record.drive_v[counted]),
    )


def has_all_loops(record: Record) -> bool:
    """Return whether drive or displacement have swings of all sizes, at all heights.

    A model without operators, such as a surface, is determined by the loops of its record only. A
    vibration may hide the loops of the displacement; those of the drive are the same.

    Args:
        record: Drive and displacement; the displacement without noise.
    """
    counted = record.counted()
    t_s = record.t_s[counted]
    return any(
        _has_all_swings(t_s, values[counted]) for values in (record.position_um, record.drive_v)
    )


def _has_all_swings(t_s: FloatArray, values: FloatArray) -> bool:
    size = float(np.ptp(values))
    if not size:
        return False
    swings = swings_of(t_s, (values - values.min()) / size)
    return not any((*_missing_sizes(swings, size), *_missing_heights(swings, size)))


def shows_creep(record: Record) -> bool:
    """Return whether a record is long enough to show creep."""
    return float(record.t_s[-1] - record.t_s[0]) >= CREEP_S


def swings_of(t_s: FloatArray, positions: FloatArray) -> Swings:
    """Return the swings of a displacement.

    Args:
        t_s: (n,) times, in s.
        positions: (n,) displacement in [0, 1].
    """
    turns = turning_points(positions)
    ends = positions[turns]
    return Swings(np.abs(np.diff(ends)), 0.5 * (ends[1:] + ends[:-1]), np.diff(t_s[turns]))


def turning_points(positions: FloatArray) -> list[int]:
    """Return the indices of the turns of a displacement, with its first and last extreme."""
    values = positions.tolist()
    indices, extreme, direction = [0], 0, 0.0
    for index, value in enumerate(values):
        beyond = value - values[extreme]
        # The first direction is known after the first motion beyond the dead-band.
        if direction == 0.0:
            if abs(beyond) > DEADBAND:
                direction, extreme = (1.0 if beyond > 0.0 else -1.0), index
        elif direction * beyond >= 0.0:
            extreme = index
        elif abs(beyond) > DEADBAND:
            indices.append(extreme)
            direction, extreme = -direction, index
    return [*indices, extreme]


def recommended_drive(low_v: float, high_v: float, slew_v_per_s: float = inf) -> str:
    """Return a drive with all excitation, as the `identification:` of an experiment, in YAML.

    It starts and ends at the lowest voltage, and does not jump.

    Args:
        low_v: Lowest voltage, in V.
        high_v: Highest voltage, in V.
        slew_v_per_s: Slew rate of the amplifier, in V/s. A drive that would come near it is
            slower by a whole factor, in its fastest part by another one.
    """
    per_hz = pi * (high_v - low_v) / (SLEW_SHARE * slew_v_per_s)
    slower, fast = (max(1, ceil(hz * per_hz)) for hz in (FULL_HZ, FAST_HZ * FAST_SHARE))
    # Rounded inwards to whole millivolts, so that the text has short numbers within the limits.
    part = _PartWriter(ceil(round(1e3 * low_v, 6)), floor(round(1e3 * high_v, 6)), slower)
    fastest = part._replace(slower=fast)
    half_v = (part.high_mv - part.low_mv) // 2 / 1e3
    middle = f"{part.low_mv / 1e3 + half_v:.10g}"
    return f"""\
identification:
  method: surface # with `creep: true` of the compensator
  settle_s: 5
  run_in_s: {8 * slower}
  duration_s: {78 * slower + 2 * fast}
  drive_v:
    kind: sequence
    parts:
      # run-in, over the full swing
      {part.sine(8, 0, 1, 0.5)}
      # loops of all sizes
      - duration_s: {20 * slower}
        waveform:
          kind: sine
          low: {part.at(0)}
          high: {part.at(1)}
          frequency_hz: {part.hz(FULL_HZ)}
          envelope: {{kind: decaying, time_constant_s: {10 * slower}}}
      # loops within loops, at all heights
      - duration_s: {30 * slower}
        waveform:
          kind: sum
          parts:
            - {{kind: triangle, low: {part.at(0)}, high: {middle}, frequency_hz: {part.hz(0.7)}}}
            - {{kind: triangle, low: 0, high: {half_v:.10g}, frequency_hz: {part.hz(0.1)}}}
      # fast, for the delay
      {fastest.sine(2, 0, FAST_SHARE, FAST_HZ)}
      # up in two steps, each with a hold, for the creep, and small loops; then down
      {part.sine(1, 0, 0.4, 0.5)}
      {part.hold(5, 0.4)}
      {part.sine(3, 0.4, 0.55, 1)}
      {part.sine(1, 0.4, 0.8, 0.5)}
      {part.hold(5, 0.8)}
      {part.sine(3, 0.8, 0.95, 1)}
      - duration_s: {2 * slower}
        waveform:
          kind: multisine
          low: {part.at(0)}
          components:
            - {{amplitude: {0.8 * half_v:.10g}, frequency_hz: {part.hz(0.25)}, phase_deg: 180}}
"""


class _PartWriter(NamedTuple):
    """Writes the parts of a sequence in YAML; levels are shares of the range."""

    low_mv: int
    high_mv: int
    slower: int  #: Factor of all times.

    def at(self, share: float) -> str:
        return f"{round(self.low_mv + share * (self.high_mv - self.low_mv)) / 1e3:.10g}"

    def hz(self, frequency_hz: float) -> str:
        return f"{frequency_hz / self.slower:.10g}"

    def sine(self, duration_s: int, start: float, end: float, frequency_hz: float) -> str:
        ends = f"low: {self.at(start)}, high: {self.at(end)}"
        waveform = f"kind: sine, {ends}, frequency_hz: {self.hz(frequency_hz)}"
        return f"- {{duration_s: {duration_s * self.slower}, waveform: {{{waveform}}}}}"

    def hold(self, duration_s: int, share: float) -> str:
        waveform = f"kind: setpoint, level: {self.at(share)}"
        return f"- {{duration_s: {duration_s * self.slower}, waveform: {{{waveform}}}}}"


def _missing_sizes(swings: Swings, range_um: float) -> Iterator[str]:
    for least, most in pairwise(SIZE_BOUNDS):
        count = np.count_nonzero((swings.sizes >= least) & (swings.sizes <= most))
        if count < MIN_SWINGS:
            yield (
                f"Swings of {_sizes(least, most, range_um)}: {count or 'none'}, "
                f"{MIN_SWINGS} are needed."
            )


def _missing_heights(swings: Swings, range_um: float) -> Iterator[str]:
    partial = swings.middles[(swings.sizes >= SIZE_BOUNDS[0]) & (swings.sizes <= PARTIAL_SWING)]
    # A middle at the very top belongs to the upper third.
    thirds = np.minimum((3.0 * partial).astype(int), 2)
    absent = [name for third, name in enumerate(HEIGHTS) if third not in thirds]
    if partial.size and absent:
        yield (
            f"Swings of {_sizes(SIZE_BOUNDS[0], PARTIAL_SWING, range_um)} around the "
            f"{' and the '.join(absent)} third of the range: none."
        )


def _missing_times(swings: Swings) -> Iterator[str]:
    durations_s = swings.durations_s[swings.sizes >= SIZE_BOUNDS[0]]
    if not durations_s.size:
        return
    fastest_s, slowest_s = float(durations_s.min()), float(swings.durations_s.max())
    if slowest_s < MIN_TIME_RATIO * fastest_s:
        yield (
            f"Slow motion or holds, which show the creep: the longest lasts {slowest_s:.3g} s, the "
            f"fastest swing {fastest_s:.3g} s; {MIN_TIME_RATIO:g} times as long is needed."
        )


def _missing_frequencies(drive_v: FloatArray) -> Iterator[str]:
    if np.ptp(drive_v) and has_one_frequency(drive_v):
        yield "A second frequency, which separates the delay from the width of the loops: none."


def _sizes(least: float, most: float, range_um: float) -> str:
    return (
        f"{100 * least:.0f} to {100 * most:.0f} % of the range, "
        f"{least * range_um:.3g} to {most * range_um:.3g} µm"
    )
