"""What a record leaves untold of a stage, and a drive that would tell it.

A weight of the model is known from swings longer than its threshold, creep from motion on several
time scales, and the delay from several frequencies. Swings below a tenth of the range are not asked
for: little hysteresis is left in them.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from piezod.experiment.fit.delay import has_one_frequency
from piezod.experiment.fit.record import Record
from piezod.hysteresis.memory import FloatArray

DEADBAND = 0.01
"""Part of the range by which a displacement must come back to have turned."""
SIZES = (0.1, 0.2, 0.4, 0.7, 1.0)
"""Ends of the classes of swings, as parts of the range."""
FEWEST = 2
"""Swings that a class needs: one up, one down."""
PARTIAL = 0.7
"""Swings up to this part of the range tell what depends on the height."""
HEIGHTS = ("lower", "middle", "upper")
SPAN = 5.0
"""Times as long as the fastest swing that some motion or hold has to last."""


class Swings(NamedTuple):
    """Ways from one turning point to the next; arrays of shape (k,).

    Attributes:
        sizes: Their lengths, as parts of the range.
        middles: Where their middles are, from 0 at the lowest displacement to 1 at the highest.
        durations_s: How long they take, holds on the way among them, in s.
    """

    sizes: FloatArray
    middles: FloatArray
    durations_s: FloatArray


def missing(record: Record) -> tuple[str, ...]:
    """Return what a record does not tell, a sentence each.

    Args:
        record: Drive and displacement; the displacement without noise, since that turns too.
    """
    counted = record.counted()
    t_s, position_um = record.t_s[counted], record.position_um[counted]
    range_um = float(np.ptp(position_um))
    if not range_um:
        return ("The displacement does not move.",)
    swings = swings_of(t_s, (position_um - position_um.min()) / range_um)
    return (
        *_missing_sizes(swings, range_um),
        *_missing_heights(swings, range_um),
        *_missing_times(swings),
        *_missing_frequencies(record.drive_v[counted]),
    )


def swings_of(t_s: FloatArray, positions: FloatArray) -> Swings:
    """Return the swings of a displacement.

    Args:
        t_s: (n,) times, in s.
        positions: (n,) displacement in [0, 1].
    """
    turns = _turning_points(positions)
    ends = positions[turns]
    return Swings(np.abs(np.diff(ends)), 0.5 * (ends[1:] + ends[:-1]), np.diff(t_s[turns]))


def recommended_drive(low_v: float, high_v: float) -> str:
    """Return a drive that tells everything, as the `identification:` of an experiment, in YAML.

    It begins and ends at the lowest voltage, and does not jump.

    Args:
        low_v: Lowest voltage, in V.
        high_v: Highest voltage, in V.
    """
    low_mv, high_mv = ceil(round(1e3 * low_v, 6)), floor(round(1e3 * high_v, 6))
    half_v = (high_mv - low_mv) // 2 / 1e3
    middle = f"{low_mv / 1e3 + half_v:.10g}"

    def at(share: float) -> str:
        return f"{round(low_mv + share * (high_mv - low_mv)) / 1e3:.10g}"

    def sine(duration_s: int, start: float, end: float, frequency_hz: float) -> str:
        waveform = f"kind: sine, low: {at(start)}, high: {at(end)}, frequency_hz: {frequency_hz:g}"
        return f"- {{duration_s: {duration_s}, waveform: {{{waveform}}}}}"

    def hold(duration_s: int, share: float) -> str:
        return f"- {{duration_s: {duration_s}, waveform: {{kind: setpoint, level: {at(share)}}}}}"

    return f"""\
identification:
  method: least-squares
  settle_s: 5
  run_in_s: 8
  duration_s: 80
  drive_v:
    kind: sequence
    parts:
      # run-in, over the full swing
      {sine(8, 0, 1, 0.5)}
      # loops of all sizes
      - duration_s: 20
        waveform:
          kind: sine
          low: {at(0)}
          high: {at(1)}
          frequency_hz: 0.7
          envelope: {{kind: decaying, time_constant_s: 10}}
      # loops within loops, at all heights
      - duration_s: 30
        waveform:
          kind: sum
          parts:
            - {{kind: triangle, low: {at(0)}, high: {middle}, frequency_hz: 0.7}}
            - {{kind: triangle, low: 0, high: {half_v:.10g}, frequency_hz: 0.1}}
      # fast, for the delay
      {sine(2, 0, 0.7, 5)}
      # up in two steps, each with a hold, for the creep, and small loops; then down
      {sine(1, 0, 0.4, 0.5)}
      {hold(5, 0.4)}
      {sine(3, 0.4, 0.55, 1)}
      {sine(1, 0.4, 0.8, 0.5)}
      {hold(5, 0.8)}
      {sine(3, 0.8, 0.95, 1)}
      - duration_s: 2
        waveform:
          kind: multisine
          low: {at(0)}
          components: [{{amplitude: {0.8 * half_v:.10g}, frequency_hz: 0.25, phase_deg: 180}}]
"""


def _turning_points(positions: FloatArray) -> list[int]:
    """Return where a displacement turns, with its first place and its last extreme."""
    values = positions.tolist()
    places, extreme, direction = [0], 0, 0.0
    for place, value in enumerate(values):
        beyond = value - values[extreme]
        if direction == 0.0:
            if abs(beyond) > DEADBAND:
                direction, extreme = (1.0 if beyond > 0.0 else -1.0), place
        elif direction * beyond >= 0.0:
            extreme = place
        elif abs(beyond) > DEADBAND:
            places.append(extreme)
            direction, extreme = -direction, place
    return [*places, extreme]


def _missing_sizes(swings: Swings, range_um: float) -> Iterator[str]:
    for least, most in pairwise(SIZES):
        count = np.count_nonzero((swings.sizes >= least) & (swings.sizes <= most))
        if count < FEWEST:
            yield (
                f"Swings of {_sizes(least, most, range_um)}: {count or 'none'}, "
                f"{FEWEST} are needed."
            )


def _missing_heights(swings: Swings, range_um: float) -> Iterator[str]:
    partial = swings.middles[(swings.sizes >= SIZES[0]) & (swings.sizes <= PARTIAL)]
    thirds = np.minimum((3.0 * partial).astype(int), 2)
    absent = [name for third, name in enumerate(HEIGHTS) if third not in thirds]
    if partial.size and absent:
        yield (
            f"Swings of {_sizes(SIZES[0], PARTIAL, range_um)} around the {' and the '.join(absent)}"
            " third of the range: none."
        )


def _missing_times(swings: Swings) -> Iterator[str]:
    durations_s = swings.durations_s[swings.sizes >= SIZES[0]]
    if not durations_s.size:
        return
    fastest_s, slowest_s = float(durations_s.min()), float(swings.durations_s.max())
    if slowest_s < SPAN * fastest_s:
        yield (
            f"Slow motion or holds, which tell the creep: the longest lasts {slowest_s:.3g} s, the "
            f"fastest swing {fastest_s:.3g} s; {SPAN:g} times as long is needed."
        )


def _missing_frequencies(drive_v: FloatArray) -> Iterator[str]:
    if np.ptp(drive_v) and has_one_frequency(drive_v):
        yield "A second frequency, which tells the delay from the width of the loops: none."


def _sizes(least: float, most: float, range_um: float) -> str:
    return (
        f"{100 * least:.0f} to {100 * most:.0f} % of the range, "
        f"{least * range_um:.3g} to {most * range_um:.3g} µm"
    )
