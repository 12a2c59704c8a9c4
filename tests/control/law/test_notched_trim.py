"""Tests of the trim with proportional gain and notches: it never jumps, and never winds up."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.law.trim import NotchedTrim, Trim
from piezod.dynamics import Resonance
from piezod.dynamics.notch import notch

GAIN_PER_S, PERIOD_S, PROPORTIONAL = 500.0, 1e-4, 0.2
AUTHORITY, FADE_CYCLES = 0.05, 20
FADE = AUTHORITY / FADE_CYCLES
NOTCH = notch(Resonance(734.0, 0.03), PERIOD_S)

ERRORS = st.floats(-1.0, 1.0)
LIMITED = st.sampled_from([-1, 0, 1])


def trim_of(proportional: float = PROPORTIONAL, *, notched: bool = True) -> NotchedTrim:
    """Return an enabled trim."""
    trim = NotchedTrim(
        GAIN_PER_S,
        PERIOD_S,
        AUTHORITY,
        FADE_CYCLES,
        proportional=proportional,
        notches=[NOTCH] if notched else [],
    )
    trim.enable()
    return trim


@given(errors=st.lists(st.floats(-1e-3, 1e-3), max_size=100))
def test_without_proportional_gain_and_notches_it_is_the_plain_trim(errors: list[float]) -> None:
    """Both integrate alike."""
    plain = Trim(GAIN_PER_S, PERIOD_S, AUTHORITY, FADE_CYCLES)
    plain.enable()
    trim = trim_of(0.0, notched=False)

    assert [trim.step(each, True, 0) for each in errors] == pytest.approx(
        [plain.step(each, True, 0) for each in errors]
    )


@given(errors=st.lists(st.floats(-1e-3, 1e-3), min_size=1, max_size=100))
def test_trim_is_its_law(errors: list[float]) -> None:
    """It is the integral of the filtered error plus a share of it, from the first error on."""
    trim = trim_of()
    values = [trim.step(each, True, 0) for each in errors]

    # The first error has been the same for long: the filter is settled.
    padded = np.array([errors[0]] * 500 + errors)
    filtered = np.zeros_like(padded)
    b0, b1, b2, a1, a2 = NOTCH
    filtered[:2] = errors[0]
    for k in range(2, padded.size):
        inputs = b0 * padded[k] + b1 * padded[k - 1] + b2 * padded[k - 2]
        filtered[k] = inputs - a1 * filtered[k - 1] - a2 * filtered[k - 2]
    filtered = filtered[500:]
    integral = GAIN_PER_S * PERIOD_S * np.cumsum(filtered)
    assert values == pytest.approx(integral + PROPORTIONAL * (filtered - errors[0]), abs=1e-12)


@given(steps=st.lists(st.tuples(st.floats(), st.booleans(), LIMITED), max_size=300))
def test_trim_never_exceeds_its_authority(steps: list[tuple[float, bool, int]]) -> None:
    """This holds for any errors, NaN and infinity included."""
    trim = trim_of()

    assert all(abs(trim.step(*step)) <= AUTHORITY for step in steps)


@pytest.mark.parametrize("absurd", [1e308, -1e308])
def test_absurd_error_counts_as_the_whole_range(absurd: float) -> None:
    """It would stay in the filters for long."""
    trim, other = trim_of(), trim_of()
    for each in (trim, other):
        each.step(0.01, True, 0)
    trim.step(absurd, True, 0)
    other.step(math.copysign(1.0, absurd), True, 0)

    assert trim.step(0.01, True, 0) == other.step(0.01, True, 0)


@given(error=ERRORS)
def test_first_error_makes_no_jump(error: float) -> None:
    """After `enable`, and after an invalid sample, an error counts by its integral only."""
    trim = trim_of()

    first = trim.step(error, True, 0)
    trim.step(math.nan, True, 0)
    again = trim.step(-error, True, 0)

    most = GAIN_PER_S * PERIOD_S * abs(error) * (1 + 1e-9)
    assert abs(first) <= min(most, AUTHORITY)
    assert abs(again - first) <= most


@given(
    steps=st.lists(
        st.tuples(st.floats(-1e-3, 1e-3), st.booleans(), st.booleans()), min_size=2, max_size=300
    )
)
def test_switching_never_jumps(steps: list[tuple[float, bool, bool]]) -> None:
    """Modes and gains may change in any cycle: the trim moves no more than its law allows."""
    trim = trim_of()
    values = [trim.value]
    for error, on, trim.gain_halved in steps:
        trim.enable() if on else trim.disable()
        values.append(trim.step(error, True, 0))

    # The notch amplifies a change by at most the sum of the sizes of its answer to an impulse.
    gain = _largest_gain()
    most = max(FADE, gain * (2e-3 * PROPORTIONAL + 1e-3 * GAIN_PER_S * PERIOD_S)) * (1 + 1e-9)
    assert all(abs(after - before) <= most for before, after in pairwise(values))


def _largest_gain() -> float:
    trim = trim_of()
    trim.step(0.0, True, 0)
    answer = [trim._filtered(1.0), *(trim._filtered(0.0) for _ in range(500))]  # noqa: SLF001
    return float(np.sum(np.abs(answer)))


def test_notch_keeps_the_mode_out() -> None:
    """An error at 734 Hz moves the trim by 3 % of what the same error at 100 Hz does."""

    def swing(frequency_hz: float) -> float:
        trim = trim_of()
        values = [
            trim.step(1e-3 * math.sin(math.tau * frequency_hz * PERIOD_S * k), True, 0)
            for k in range(4000)
        ]
        return max(values[-1000:]) - min(values[-1000:])

    assert swing(734.0) < 0.05 * swing(100.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_trim_does_not_wind_up(sign: float) -> None:
    """After any time at its authority the trim leaves it with the first smaller error."""
    trim = trim_of()
    for _ in range(1000):
        trim.step(sign * 0.1, True, 0)

    assert trim.value == sign * AUTHORITY
    assert sign * trim.step(-sign * 0.01, True, 0) < AUTHORITY


@given(error=st.floats(0.0, 1.0), limited=st.sampled_from([-1, 1]))
def test_trim_does_not_push_into_a_limit(error: float, limited: int) -> None:
    """A constant error that leads further into a limit is not integrated."""
    trim = trim_of()
    for _ in range(10):
        trim.step(limited * error, True, limited)

    assert trim.value == pytest.approx(0.0, abs=1e-12)


def test_disabled_trim_fades_to_exactly_zero() -> None:
    """The fade is that of the plain trim; errors no longer count."""
    trim = trim_of()
    for _ in range(1000):
        trim.step(0.1, True, 0)
    trim.disable()
    values = [trim.step(1.0, True, 0) for _ in range(FADE_CYCLES + 1)]

    assert values[0] == pytest.approx(AUTHORITY - FADE)
    assert values[-1] == 0.0
    assert not trim.active


@pytest.mark.fault("D6")
def test_halved_gains_halve_both_parts() -> None:
    """A change of the error counts half, and so does the error."""
    steps = []
    for halved in (False, True):
        trim = trim_of(notched=False)
        trim.step(0.0, True, 0)
        trim.gain_halved = halved
        steps.append(trim.step(1e-3, True, 0))

    assert steps == pytest.approx([1e-3 * (0.2 + 0.05), 0.5e-3 * (0.2 + 0.05)])


@given(value=st.floats(-4.0 * AUTHORITY, 4.0 * AUTHORITY), error=st.floats(-1e-3, 1e-3))
def test_trim_of_another_mode_is_taken_over_without_a_jump(value: float, error: float) -> None:
    """Beyond the own authority it fades into it; the other one is at zero."""
    other = NotchedTrim(
        1e6, PERIOD_S, 4.0 * AUTHORITY, FADE_CYCLES, proportional=0.0, notches=[NOTCH]
    )
    other.enable()
    other.step(value / 100.0, True, 0)
    before, trim = other.value, Trim(GAIN_PER_S, PERIOD_S, AUTHORITY, FADE_CYCLES)
    trim.take_over(other)
    trim.enable()
    values = [before, *(trim.step(error, True, 0) for _ in range(5 * FADE_CYCLES))]

    assert before == pytest.approx(value)
    assert (other.value, other.active) == (0.0, False)
    most = (FADE + 1e-3 * GAIN_PER_S * PERIOD_S) * (1 + 1e-9)
    assert all(abs(after - earlier) <= most for earlier, after in pairwise(values))
    assert abs(values[-1]) <= AUTHORITY * (1 + 1e-9)
