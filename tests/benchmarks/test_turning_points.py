"""Tests of the turning points that methods by others get."""

import numpy as np

from benchmarks.peers.turning_points import turning_points

LOOPS = np.array([0.0, 1.0, 0.4, 0.6, 0.2, 0.9])


def test_the_last_turning_points_are_known_at_each_sample() -> None:
    """The latest comes first; start and present extremum stand for missing ones, in turn."""
    turns = turning_points(LOOPS, 3, 0.0, wipe=False)

    assert turns.last.tolist() == [
        [0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.4, 1.0, 0.0],
        [0.6, 0.4, 1.0],
        [0.2, 0.6, 0.4],
    ]
    assert turns.direction.tolist() == [1, 1, -1, 1, -1, 1]


def test_a_larger_motion_deletes_the_turning_points_of_a_smaller_loop() -> None:
    """Below 0.4 the loop from 0.4 to 0.6 is forgotten; 0.2 and 1 remain."""
    turns = turning_points(LOOPS, 3, 0.0, wipe=True)

    assert turns.last[4].tolist() == [1.0, 0.0, 0.0]
    assert turns.last[5].tolist() == [0.2, 1.0, 0.0]


def test_noise_below_the_threshold_makes_no_turning_points() -> None:
    """A way back of the threshold or less makes no turning point, and the extremum goes on."""
    turns = turning_points(np.array([0.0, 0.5, 0.49, 0.6, 0.4]), 2, 0.02, wipe=False)

    assert turns.last[-2].tolist() == [0.0, 0.6]
    assert turns.last[-1].tolist() == [0.6, 0.0]
