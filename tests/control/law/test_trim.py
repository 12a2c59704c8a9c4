"""Tests of the trim: what it adds, when it holds, and that it never jumps."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.control.law.trim import Trim

GAIN_PER_S, PERIOD_S = 50.0, 1e-3
AUTHORITY, FADE_CYCLES = 0.05, 20
FADE = AUTHORITY / FADE_CYCLES

ERRORS = st.floats(-1.0, 1.0)
LIMITED = st.sampled_from([-1, 0, 1])


def enabled() -> Trim:
    """Return a trim that integrates."""
    trim = Trim(GAIN_PER_S, PERIOD_S, AUTHORITY, FADE_CYCLES)
    trim.enable()
    return trim


def at_authority(sign: float) -> Trim:
    """Return a trim at its authority."""
    trim = enabled()
    for _ in range(100):
        trim.step(sign, True, 0)
    return trim


def test_error_decays_with_the_time_constant_of_the_gain() -> None:
    """After 1/50 s an offset of the stage has decayed to 1/e, up to the steps of the cycles."""
    trim, offset = enabled(), 0.04

    for _ in range(20):
        trim.step(offset - trim.value, True, 0)

    assert offset - trim.value == pytest.approx(offset * (1 - 0.05) ** 20)
    assert offset - trim.value == pytest.approx(offset / math.e, rel=0.03)


def test_trim_stays_zero_until_it_is_enabled() -> None:
    """Errors before `enable` do not count; then it starts from zero."""
    trim = Trim(GAIN_PER_S, PERIOD_S, AUTHORITY, FADE_CYCLES)

    before = [trim.step(1.0, True, 0) for _ in range(100)]
    trim.enable()

    assert before == [0.0] * 100
    assert trim.step(0.001, True, 0) == pytest.approx(0.00005)


@given(steps=st.lists(st.tuples(st.floats(), st.booleans(), LIMITED), max_size=300))
def test_trim_never_exceeds_its_authority(steps: list[tuple[float, bool, int]]) -> None:
    """This holds for any errors, NaN and infinity included."""
    trim = enabled()

    assert all(abs(trim.step(*step)) <= AUTHORITY for step in steps)


@pytest.mark.parametrize(
    ("error", "valid"), [(math.nan, True), (math.inf, True), (-math.inf, True), (0.7, False)]
)
def test_sample_that_is_not_usable_holds_the_trim(error: float, valid: bool) -> None:
    """The trim stays, whatever the value of an invalid sample is, and continues with the next."""
    trim = enabled()
    before = trim.step(0.1, True, 0)

    assert trim.step(error, valid, 0) == before
    assert trim.step(0.1, True, 0) == 2 * before


@given(error=ERRORS, limited=LIMITED)
def test_trim_does_not_push_into_a_limit(error: float, limited: int) -> None:
    """At a limit the trim integrates only errors that lead away from it."""
    trim = enabled()

    value = trim.step(error, True, limited)

    assert value == (0.0 if error * limited > 0 else min(max(0.05 * error, -0.05), 0.05))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_trim_does_not_wind_up(sign: float) -> None:
    """After any time at its authority the trim follows the first error of the other sign."""
    trim = at_authority(sign)

    assert trim.value == sign * AUTHORITY
    assert trim.step(-sign * 0.01, True, 0) == pytest.approx(sign * (AUTHORITY - 0.0005))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_disabled_trim_fades_to_zero_and_stays(sign: float) -> None:
    """From the full authority the fade takes its cycles; errors no longer count."""
    trim = at_authority(sign)

    trim.disable()
    values = [trim.step(1.0, True, 0) for _ in range(FADE_CYCLES + 2)]

    assert values[FADE_CYCLES - 2] * sign > 0.0
    assert values[FADE_CYCLES:] == [0.0, 0.0]


def test_trim_enabled_during_its_fade_continues_from_its_value() -> None:
    """The trim does not pass through zero first."""
    trim = at_authority(1.0)
    trim.disable()
    for _ in range(5):
        faded = trim.step(0.0, True, 0)
    trim.enable()

    assert trim.step(0.0, True, 0) == faded == pytest.approx(AUTHORITY - 5 * FADE)


@given(
    steps=st.lists(st.tuples(st.floats(-0.01, 0.01), st.booleans()), min_size=2, max_size=300),
)
def test_enabling_and_disabling_never_jumps(steps: list[tuple[float, bool]]) -> None:
    """In one cycle the trim changes by at most one step of the fade or of the integral."""
    trim = at_authority(1.0)
    values = [trim.value]
    for error, on in steps:
        trim.enable() if on else trim.disable()
        values.append(trim.step(error, True, 0))

    most = max(FADE, 0.05 * 0.01) * (1 + 1e-12)
    assert all(abs(after - before) <= most for before, after in pairwise(values))


@pytest.mark.fault("D6")
def test_trim_with_halved_gain_integrates_half_as_fast() -> None:
    """The change of the gain acts from one cycle to the next."""
    trim = enabled()
    steps = []
    for trim.gain_halved in (False, True, False):
        before = trim.value
        steps.append(trim.step(0.01, True, 0) - before)

    assert steps == pytest.approx([0.0005, 0.00025, 0.0005])
