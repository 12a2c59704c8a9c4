"""The verdict of the measurement with a page and a recording."""

from math import isnan

import pytest

from benchmarks.page_and_recording import difference, failures


def test_difference_has_the_standard_error_over_the_spans() -> None:
    """Spans are compared with their neighbours; one pair tells nothing about the error."""
    more, error = difference([10, 20, 30], [11, 23, 35])

    assert more == pytest.approx(3.0)
    assert error == pytest.approx(2.0 / 3.0**0.5)
    assert isnan(difference([1], [2])[1])


def test_a_missing_cycle_and_a_busy_core_fail() -> None:
    """No cycle may be missing, and 15 % of a core is too much."""
    assert failures(0, 0.149) == []
    assert failures(1, 0.149) == ["cycles missing in the recordings: 1"]
    assert len(failures(2, 0.15)) == 2
