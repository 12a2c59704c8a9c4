"""A path between random turning points."""

import random
from math import inf

from piezod.config.waveforms import Reversals


def random_path(
    config: Reversals, duration_s: float, *, most_points: float = inf
) -> tuple[tuple[float, float], ...]:
    """Draw the turning points of a path that starts at its lowest level and rises.

    A longer path continues a shorter one of the same seed.

    Args:
        config: Range, shortest swing, speeds and seed.
        duration_s: The path ends at the first turning point at or after this time, in s.
        most_points: The path ends after this many turning points at the latest.

    Returns:
        Times in s, increasing, each with its level.
    """
    # `random` draws the same values on every machine and in every version of Python; numpy does not
    # promise that.
    draws = random.Random(config.seed)  # noqa: S311 - reproducible, not secret
    t_s, level, rising = 0.0, config.low, True
    points = [(t_s, level)]
    while t_s < duration_s and len(points) < most_points:
        # After a swing of at least min_swing there is room for one in the other direction.
        room = config.high - level if rising else level - config.low
        swing = config.min_swing + (room - config.min_swing) * draws.random()
        speed = config.min_speed + (config.max_speed - config.min_speed) * draws.random()
        level += swing if rising else -swing
        level = min(max(level, config.low), config.high)
        t_s += swing / speed
        rising = not rising
        points.append((t_s, level))
    return tuple(points)
