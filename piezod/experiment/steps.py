"""Commands that go in steps: how fast each step settles, and which samples show its level.

In the cycle of a step every stage is wrong by the whole step, whatever its mode. Steps are judged
by their settling time instead, and errors are taken from the second half of each level.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import inf

import numpy as np

from piezod.hysteresis.memory import FloatArray

SETTLED_SHARE = 0.02
"""A step has settled when the position stays within this share of the step from its final value."""
NOISES = 4.0
"""Within this many standard deviations of the noise of the sensor nothing is told apart."""
MIN_LEVEL_SAMPLES = 20
"""Shortest level of a command in steps, in samples."""


def levels_of(command_um: FloatArray) -> list[slice]:
    """Return the levels of a command that goes in steps, [] for any other command.

    Args:
        command_um: (n,) command over time, in µm.
    """
    edges = np.flatnonzero(np.diff(command_um)) + 1
    places = [0, *edges.tolist(), command_um.size]
    levels = [slice(begin, end) for begin, end in pairwise(places)]
    # The first and the last level may be cut short by the part that is judged.
    if not edges.size or any(each.stop - each.start < MIN_LEVEL_SAMPLES for each in levels[1:-1]):
        return []
    return levels


def held(command_um: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the samples that errors are taken from, shape (n,).

    These are the second halves of the levels of a command that goes in steps, and else all samples.
    """
    levels = levels_of(command_um)
    counted = np.full(command_um.size, not levels)
    for level in levels:
        counted[(level.start + level.stop) // 2 : level.stop] = True
    return counted


def settling_times_s(
    command_um: FloatArray, position_um: FloatArray, period_s: float
) -> list[float]:
    """Return the settling time of each step, in s; inf if it does not settle on its level.

    Args:
        command_um: (n,) command, in µm.
        position_um: (n,) measured position, in µm; NaN if it was invalid.
        period_s: Sample period, in s.
    """
    return list(_settling_times_s(command_um, position_um, period_s))


def step_metrics(
    command_um: FloatArray, position_um: FloatArray, period_s: float
) -> dict[str, float]:
    """Return the longest and the median settling time by name, nothing without steps.

    Arguments are those of `settling_times_s`.
    """
    times_s = settling_times_s(command_um, position_um, period_s)
    if not times_s:
        return {}
    return {"settling_max_s": max(times_s), "settling_median_s": float(np.median(times_s))}


def _settling_times_s(
    command_um: FloatArray, position_um: FloatArray, period_s: float
) -> Iterator[float]:
    levels = levels_of(command_um)
    for before, level in pairwise(levels):
        step_um = abs(float(command_um[level.start] - command_um[before.start]))
        reached_um = position_um[level]
        reached_um = reached_um[np.isfinite(reached_um)]
        if level is levels[-1] and reached_um.size < MIN_LEVEL_SAMPLES:
            continue
        last_quarter_um = reached_um[-max(reached_um.size // 4, 1) :]
        # Neighbouring samples of a settled stage differ by the noise.
        noise_um = float(np.std(np.diff(last_quarter_um))) / np.sqrt(2.0)
        tolerance_um = max(SETTLED_SHARE * step_um, NOISES * noise_um)
        outside = np.flatnonzero(np.abs(reached_um - np.mean(last_quarter_um)) > tolerance_um)
        cycles = int(outside[-1]) + 1 if outside.size else 0
        settled = cycles <= reached_um.size - last_quarter_um.size
        yield cycles * period_s if settled else inf
