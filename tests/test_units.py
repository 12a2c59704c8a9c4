"""Conversions of units."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.units import NS_PER_S, s_to_ns


@pytest.mark.parametrize(
    ("t_s", "expected_ns"), [(0.0, 0), (1.0, 1_000_000_000), (1e-9, 1), (-2.5, -2_500_000_000)]
)
def test_seconds_become_nanoseconds(t_s: float, expected_ns: int) -> None:
    """Round values convert exactly."""
    assert s_to_ns(t_s) == expected_ns


@given(st.integers(-(2**50), 2**50))
def test_whole_nanoseconds_survive(t_ns: int) -> None:
    """Within a fortnight of zero a whole number of nanoseconds converts to s and back."""
    assert s_to_ns(t_ns / NS_PER_S) == t_ns
