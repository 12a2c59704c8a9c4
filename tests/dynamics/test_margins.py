"""Tests of the margins of the trim, against a simulation in small time steps."""

from functools import cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from piezod.dynamics import Resonance, ResponseModel, margins
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import (
    LEAST_GAIN_MARGIN,
    LEAST_LATE_GAIN_MARGIN,
    LEAST_MODULUS_MARGIN,
    LEAST_PHASE_MARGIN_DEG,
    TrimMargins,
    margins_of,
    refuse_unstable,
)
from piezod.errors import ModelError

FloatArray = npt.NDArray[np.float64]
SUB_STEPS = 100


class Loop(NamedTuple):
    """Period, delay and first mode of a loop."""

    period_s: float
    delay_s: float
    mode_hz: float | None = None
    mode_damping: float | None = None

    @property
    def stage(self) -> ResponseModel:
        """From a voltage at the output to the sample."""
        if self.mode_hz is None or self.mode_damping is None:
            return ResponseModel(self.delay_s)
        return ResponseModel(self.delay_s, (Resonance(self.mode_hz, self.mode_damping),))

    def margins(self, gain_per_s: float) -> TrimMargins:
        """Return the margins of an integral with this gain."""
        return margins_of(TrimLaw(gain_per_s), self.period_s, self.stage)

    def checked(self, gain_per_s: float) -> TrimMargins:
        """Return the margins of an integral with this gain, unless they are too small."""
        return refuse_unstable(TrimLaw(gain_per_s), self.period_s, self.stage)

    def later(self, delay_s: float) -> "Loop":
        """Return the loop with more delay."""
        return self._replace(delay_s=self.delay_s + delay_s)


STACK = Loop(1e-3, 0.65e-3, 734.0, 0.03)
FLEXURE = Loop(1e-3, 0.65e-3, 734.0, 0.015)
AFM = Loop(1e-3, 0.65e-3, 358.0, 0.03)
DELAY_ONLY = Loop(1e-3, 0.65e-3)

PERIODS_S = st.floats(5e-5, 1e-2)
GAINS_PER_S = st.floats(0.01, 5000.0)


@st.composite
def loops(draw: st.DrawFn) -> Loop:
    """Draw a loop whose delay is a whole number of steps of the simulation."""
    period_s = draw(PERIODS_S)
    delay_s = draw(st.integers(0, 4 * SUB_STEPS)) * period_s / SUB_STEPS
    if draw(st.booleans()):
        return Loop(period_s, delay_s)
    return Loop(
        period_s,
        delay_s,
        # With more than a few turns per cycle the steps of the simulation are too long.
        draw(st.floats(0.02, 1.5)) / period_s,
        draw(st.floats(0.005, 1.0)),
    )


def largest_stable(loop: Loop) -> float:
    """Return the gain at which the gain margin is 1."""
    return loop.margins(1.0).gain_margin


def rate_of_change(loop: Loop, mode: FloatArray, drive: FloatArray) -> FloatArray:
    """Return the derivative of displacement and scaled speed of the mode."""
    assert loop.mode_hz is not None
    assert loop.mode_damping is not None
    turn = 2.0 * np.pi * loop.mode_hz
    position, speed = mode
    return turn * np.array([speed, drive - position - 2.0 * loop.mode_damping * speed])


def advanced(loop: Loop, mode: FloatArray, drive: FloatArray) -> FloatArray:
    """Return the mode one small step later, by the method of Runge and Kutta."""
    step_s = loop.period_s / SUB_STEPS
    first = rate_of_change(loop, mode, drive)
    second = rate_of_change(loop, mode + step_s / 2 * first, drive)
    third = rate_of_change(loop, mode + step_s / 2 * second, drive)
    fourth = rate_of_change(loop, mode + step_s * third, drive)
    return mode + step_s / 6 * (first + 2 * second + 2 * third + fourth)


@cache
def small_step(loop: Loop) -> tuple[FloatArray, FloatArray]:
    """Return the factors of mode and drive in a small step: the method is linear."""
    of_mode = advanced(loop, np.eye(2), np.zeros(2))
    return of_mode, advanced(loop, np.zeros((2, 1)), np.ones(1))


def one_cycle(
    loop: Loop, mode: FloatArray, trims: FloatArray, gains_per_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return mode and trims one cycle later; the trims are rows, the newest first.

    The sample is taken. Then the trim is integrated for the next cycle, while the present trim is
    held and passes through the delay.
    """
    late = round(loop.delay_s / loop.period_s * SUB_STEPS)
    sample = mode[0] if loop.mode_hz is not None else trims[-(-late // SUB_STEPS)]
    following = trims[0] - gains_per_s * loop.period_s * sample
    if loop.mode_hz is not None:
        of_mode, of_drive = small_step(loop)
        for step in range(SUB_STEPS):
            mode = of_mode @ mode + of_drive * trims[-((step - late) // SUB_STEPS)]
    return mode, np.vstack([following, trims[:-1]])


def trims_held(loop: Loop) -> int:
    """Return the number of trims in the delay, the one in force included."""
    return round(loop.delay_s / loop.period_s * SUB_STEPS) // SUB_STEPS + 2


def growth(loop: Loop, gain_per_s: float) -> float:
    """Return the largest eigenvalue, in size, of the matrix of one simulated cycle."""
    n_mode = 0 if loop.mode_hz is None else 2
    states = np.eye(n_mode + trims_held(loop))
    after = one_cycle(loop, states[:n_mode], states[n_mode:], np.array(gain_per_s))
    return float(np.abs(np.linalg.eigvals(np.vstack(after))).max())


@given(loop=loops())
def test_largest_stable_gain_is_that_of_the_closed_loop(loop: Loop) -> None:
    """0.2 % below it all eigenvalues are inside the unit circle; 0.2 % above it one is outside."""
    gain_per_s = largest_stable(loop)

    assert growth(loop, 0.998 * gain_per_s) < 1.0
    assert growth(loop, 1.002 * gain_per_s) > 1.0


def enough(margins: TrimMargins) -> bool:
    """Return whether all margins are large enough."""
    return (
        margins.gain_margin >= LEAST_GAIN_MARGIN
        and margins.phase_margin_deg >= LEAST_PHASE_MARGIN_DEG
        and margins.modulus_margin >= LEAST_MODULUS_MARGIN
        and margins.late_gain_margin >= LEAST_LATE_GAIN_MARGIN
    )


@given(loop=loops(), quarters=st.integers(0, 4))
def test_late_margin_leaves_the_loop_stable_with_more_delay(loop: Loop, quarters: int) -> None:
    """The gain that it allows is stable with up to one more period of delay."""
    gain_per_s = loop.margins(1.0).late_gain_margin

    assert growth(loop.later(quarters / 4 * loop.period_s), 0.998 * gain_per_s) < 1.0


@given(loop=loops(), part=st.floats(0.01, 0.999), beyond=st.floats(1.001, 1.5))
def test_largest_gain_is_the_bound_of_the_allowed_gains(
    loop: Loop, part: float, beyond: float
) -> None:
    """Every gain below it has all margins; the gain just above it lacks one."""
    largest = loop.margins(1.0).largest.gain_per_s

    assert enough(loop.margins(part * largest))
    assert not enough(loop.margins(1.001 * largest))
    assert loop.margins(beyond * largest).largest.gain_per_s == largest


@given(loop=loops(), low=GAINS_PER_S, high=GAINS_PER_S)
def test_margins_shrink_with_the_gain(loop: Loop, low: float, high: float) -> None:
    """A larger gain has no larger margin."""
    assume(low < high)

    at_low, at_high = loop.margins(low), loop.margins(high)

    assert at_low.gain_margin > at_high.gain_margin
    assert at_low.late_gain_margin > at_high.late_gain_margin
    assert at_low.phase_margin_deg >= at_high.phase_margin_deg


@given(period_s=PERIODS_S, periods=st.floats(0.0, 50.0), more=st.floats(0.0, 5.0))
def test_delay_never_raises_the_limit(period_s: float, periods: float, more: float) -> None:
    """This holds without a mode; the grid of frequencies costs a thousandth."""
    loop = Loop(period_s, periods * period_s)

    before, after = loop.margins(1.0), loop.later(more * period_s).margins(1.0)

    assert after.gain_margin <= 1.001 * before.gain_margin
    assert after.largest.gain_per_s <= 1.001 * before.largest.gain_per_s


@pytest.mark.parametrize(("periods", "largest"), [(0, 2.0), (1, 1.0), (2, (5**0.5 - 1) / 2)])
def test_limits_of_an_integrator_behind_a_delay_are_known(periods: int, largest: float) -> None:
    """The limits are roots of small polynomials: 2, 1 and 0.618 times the sample rate."""
    loop = Loop(1e-3, periods * 1e-3)

    assert 1e-3 * largest_stable(loop) == pytest.approx(largest, rel=1e-4)


def test_stiff_mode_has_no_effect() -> None:
    """A mode that decays within a small part of a cycle makes no difference."""
    with_mode = Loop(1e-3, 0.65e-3, 80_000.0, 1.0).margins(50.0)

    assert with_mode[:4] == pytest.approx(DELAY_ONLY.margins(50.0)[:4], rel=1e-3)


@pytest.mark.parametrize(
    ("loop", "largest"), [(STACK, 186), (FLEXURE, 106), (AFM, 140), (DELAY_ONLY, 453)]
)
def test_default_gain_is_allowed_on_usual_stages(loop: Loop, largest: int) -> None:
    """At 1 kHz and the delay of a filtered sensor, two to nine times the gain is allowed."""
    assert int(loop.checked(50.0).largest.gain_per_s) == largest


@pytest.mark.parametrize(
    ("gain_per_s", "loop", "text"),
    [
        (
            1000.0,
            STACK,
            "a trim gain of 1000 1/s is not safe: the loop would be unstable "
            "(period 1 ms, delay 0.65 ms, first mode 734 Hz with damping 0.03); "
            "use at most 180 1/s",
        ),
        (200.0, STACK, "gain margin 1.93, needed 2; modulus margin 0.465, needed 0.5 (period"),
        (600.0, DELAY_ONLY, "phase margin 37.6°, needed 45°; modulus margin 0.36, needed 0.5"),
        (600.0, DELAY_ONLY, "no first mode known, only the delay counts); use at most 450 1/s"),
        (150.0, AFM, "gain margin with more delay 0.934, needed 1 (period 1 ms"),
    ],
)
def test_refusal_names_the_margins_and_the_largest_gain(
    gain_per_s: float, loop: Loop, text: str
) -> None:
    """It names the margin, its value, its limit, the assumptions and the largest gain."""
    with pytest.raises(ModelError) as caught:
        loop.checked(gain_per_s)

    assert text in str(caught.value)


@given(loop=loops())
def test_proposed_gain_is_allowed(loop: Loop) -> None:
    """The proposed gain is at least nine tenths of the largest one."""
    with pytest.raises(ModelError) as caught:
        loop.checked(1e9)
    proposed = float(str(caught.value).rpartition("at most ")[2].removesuffix(" 1/s"))

    assert proposed >= 0.9 * loop.checked(proposed).largest.gain_per_s


def test_margins_of_a_loop_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that a running loop takes over is checked at once, if its delay is not new."""
    loop = Loop(1.1e-3, 0.65e-3, 700.0, 0.03)
    first = loop.margins(50.0)

    def computed(*_: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(margins, "loop_response", computed)
    assert loop.margins(50.0) is first
