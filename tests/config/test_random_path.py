"""Tests of paths between random turning points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.waveforms.paths import Reversals

DURATION_S = 20.0
REVERSALS = {
    "kind": "reversals", "low": 2, "high": 10, "min_swing": 1.5, "min_speed": 3, "max_speed": 9,
}  # fmt: skip


def turning_points(config: Reversals, duration_s: float) -> list[tuple[float, float]]:
    """Return the times in s and the levels of a path."""
    return list(zip(*config.corners(duration_s), strict=True))


@given(seed=st.integers(0, 2**32 - 1), duration_s=st.floats(0.1, 30))
def test_longer_path_continues_the_shorter(seed: int, duration_s: float) -> None:
    """The turning points depend on the seed, not on the duration."""
    config = Reversals.model_validate(REVERSALS | {"seed": seed})
    short, long = turning_points(config, duration_s), turning_points(config, 30.0)

    assert long[: len(short)] == short


def test_seeds_differ() -> None:
    """Two seeds give two paths."""
    one, two = (
        turning_points(Reversals.model_validate(REVERSALS | {"seed": seed}), DURATION_S)
        for seed in (1, 2)
    )

    assert one[1:5] != two[1:5]


def test_path_of_a_seed_never_changes() -> None:
    """The path of a seed stays the same for ever, and with it an experiment."""
    config = Reversals.model_validate(REVERSALS | {"seed": 4})

    assert np.array(turning_points(config, 1.0)) == pytest.approx(
        np.array(
            [[0.0, 2.0], [0.8384403881880, 5.0343125832933], [1.3747677105576, 2.9266354379387]]
        )
    )


def test_reversals_follow_their_turning_points() -> None:
    """The waveform is a straight line from one turning point to the next."""
    config = Reversals.model_validate(REVERSALS | {"seed": 7})
    points = turning_points(config, DURATION_S)
    waveform = config.built(DURATION_S)
    (start_s, start), (end_s, end) = points[3:5]

    assert [waveform.value(t_s) for t_s, _ in points] == pytest.approx([x for _, x in points])
    assert waveform.value((start_s + end_s) / 2) == pytest.approx((start + end) / 2)
