"""Tests of a trim with proportional gain and notches, against a simulation of its cycles."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import margins_of, propose, refuse_unstable
from piezod.dynamics.model import FloatArray
from piezod.dynamics.notch import notch, notched
from piezod.errors import ModelError

PERIOD_S = 1e-4
SUB_STEPS = 20
MODE = Resonance(734.0, 0.03)
STACK = ResponseModel(0.235e-3, (MODE,))
SHARP = ResponseModel(0.235e-3, (Resonance(400.0, 0.005),))
TWO = ResponseModel(0.235e-3, (Resonance(734.0, 0.03, 0.8), Resonance(1500.0, 0.02, 0.2)))


@cache
def sub_step(mode: Resonance) -> tuple[FloatArray, FloatArray]:
    """Return the factors of mode and drive in a small step, by the series of the exponential."""
    turn = 2.0 * np.pi * mode.frequency_hz * PERIOD_S / SUB_STEPS
    system = np.array(
        [[0.0, turn, 0.0], [-turn, -2.0 * mode.damping * turn, turn], [0.0, 0.0, 0.0]]
    )
    term, whole = np.eye(3), np.eye(3)
    for order in range(1, 20):
        term = term @ system / order
        whole = whole + term
    return whole[:2, :2], whole[:2, 2]


def one_cycle(law: TrimLaw, stage: ResponseModel, states: FloatArray) -> FloatArray:
    """Return all states one cycle later.

    The states are the modes, the filtered error before, two states for each notch, and the trims,
    the newest first. The sample is taken. Then the trim for the next cycle is made, while the
    present trim is held and passes through the delay.
    """
    late = round(stage.delay_s / PERIOD_S * SUB_STEPS)
    states = states.copy()
    modes = states[: 2 * len(stage.resonances)].reshape(-1, 2)
    before = 2 * len(stage.resonances)
    trims = states[before + 1 + 2 * len(law.notches) :]
    error = -sum(mode.share * modes[k, 0] for k, mode in enumerate(stage.resonances))
    for k, mode in enumerate(law.notches):
        filtered = notch(mode, PERIOD_S)
        first, second = states[before + 1 + 2 * k : before + 3 + 2 * k]
        output = filtered.b0 * error + first
        states[before + 1 + 2 * k] = filtered.b1 * error - filtered.a1 * output + second
        states[before + 2 + 2 * k] = filtered.b2 * error - filtered.a2 * output
        error = output
    following = trims[0] + law.gain_per_s * PERIOD_S * error
    following += law.proportional * (error - states[before])
    states[before] = error
    for k, mode in enumerate(stage.resonances):
        of_mode, of_drive = sub_step(mode)
        for step in range(SUB_STEPS):
            modes[k] = of_mode @ modes[k] + of_drive * trims[-((step - late) // SUB_STEPS)]
    trims[1:] = trims[:-1].copy()
    trims[0] = following
    return states


def growth(law: TrimLaw, stage: ResponseModel) -> float:
    """Return the largest eigenvalue, in size, of the matrix of one simulated cycle."""
    held = round(stage.delay_s / PERIOD_S * SUB_STEPS) // SUB_STEPS + 2
    count = 2 * len(stage.resonances) + 1 + 2 * len(law.notches) + held
    columns = [one_cycle(law, stage, unit) for unit in np.eye(count)]
    return float(np.abs(np.linalg.eigvals(np.stack(columns, axis=1))).max())


@st.composite
def loops(draw: st.DrawFn) -> tuple[TrimLaw, ResponseModel]:
    """Draw a trim with notches, and a stage."""
    share = draw(st.floats(0.3, 1.0))
    modes = [Resonance(draw(st.floats(100.0, 1500.0)), draw(st.floats(0.005, 0.4)), share)]
    if share < 1.0:
        other = Resonance(draw(st.floats(1600.0, 3500.0)), draw(st.floats(0.005, 0.4)), 1.0 - share)
        modes.append(other)
    delay_s = draw(st.integers(0, 4 * SUB_STEPS)) * PERIOD_S / SUB_STEPS
    stage = ResponseModel(delay_s, tuple(modes))
    proportional = draw(st.floats(0.0, 3e-4))
    return TrimLaw(1.0, proportional, notched(modes, PERIOD_S)), stage


@given(loop=loops())
def test_largest_stable_gains_are_those_of_the_closed_loop(
    loop: tuple[TrimLaw, ResponseModel],
) -> None:
    """0.2 % below them all eigenvalues are inside the unit circle; 0.2 % above one is outside."""
    law, stage = loop
    stable = margins_of(law, PERIOD_S, stage).gain_margin

    def at(factor: float) -> TrimLaw:
        return law._replace(
            gain_per_s=factor * stable, proportional=factor * stable * law.proportional
        )

    assert growth(at(0.998), stage) < 1.0
    assert growth(at(1.002), stage) > 1.0


@given(loop=loops())
def test_largest_gains_are_allowed_and_larger_ones_are_not(
    loop: tuple[TrimLaw, ResponseModel],
) -> None:
    """Both gains keep their ratio."""
    law, stage = loop
    largest = margins_of(law, PERIOD_S, stage).largest

    assert largest.proportional == pytest.approx(largest.gain_per_s * law.proportional)
    refuse_unstable(
        largest._replace(
            gain_per_s=0.999 * largest.gain_per_s, proportional=0.999 * largest.proportional
        ),
        PERIOD_S,
        stage,
    )
    beyond = largest._replace(
        gain_per_s=1.01 * largest.gain_per_s, proportional=1.01 * largest.proportional
    )
    with pytest.raises(ModelError, match="use at most"):
        refuse_unstable(beyond, PERIOD_S, stage)


@pytest.mark.parametrize("stage", [STACK, SHARP, TWO])
def test_notch_and_proportional_gain_allow_more(stage: ResponseModel) -> None:
    """A proposal with notches has a larger gain of the integral than one without."""
    plain = propose(PERIOD_S, stage)
    with_notches = propose(PERIOD_S, stage, notched(stage.resonances, PERIOD_S))

    assert with_notches.gain_per_s > 1.5 * plain.gain_per_s
    assert with_notches.proportional > 0.0
    refuse_unstable(with_notches, PERIOD_S, stage)


def test_notch_removes_a_sharp_mode_from_the_loop() -> None:
    """A mode at 400 Hz with a damping of 0.005 allows 16 1/s alone, and 900 1/s with a notch."""
    assert propose(PERIOD_S, SHARP).gain_per_s == pytest.approx(16.0, rel=0.1)
    assert propose(PERIOD_S, SHARP, SHARP.resonances).gain_per_s == pytest.approx(980.0, rel=0.1)


def test_proposal_stays_stable_with_other_modes() -> None:
    """A proposed trim leaves the loop stable with all modes 5 % lower or higher."""
    law = propose(PERIOD_S, SHARP, SHARP.resonances)

    for factor in (0.95, 1.05):
        (mode,) = SHARP.resonances
        other = Resonance(factor * mode.frequency_hz, mode.damping)
        assert growth(law, ResponseModel(0.235e-3, (other,))) < 1.0


def test_refusal_names_both_gains() -> None:
    """It names the gains, the margins, and the largest gains of the same ratio."""
    with pytest.raises(ModelError) as caught:
        refuse_unstable(TrimLaw(2000.0, 0.5, (MODE,)), PERIOD_S, STACK)

    assert str(caught.value) == (
        "a trim gain of 2000 1/s with a proportional gain of 0.5 is not safe: gain margin 1.57, "
        "needed 2; phase margin 30.6°, needed 45°; modulus margin 0.31, needed 0.5 "
        "(period 0.1 ms, delay 0.235 ms, first mode 734 Hz with damping 0.03); "
        "use at most 1300 1/s with a proportional gain of 0.325"
    )


@pytest.mark.parametrize("mode", [MODE, Resonance(100.0, 0.005), Resonance(3900.0, 0.3)])
def test_notch_has_a_static_gain_of_one_and_cancels_the_mode(mode: Resonance) -> None:
    """At the mode its gain is a small part of one: the mode's peak times it is below one."""
    angle = 2.0 * np.pi * mode.frequency_hz * PERIOD_S
    response = notch(mode, PERIOD_S).at(np.exp(1j * np.array([1e-9, angle])))

    assert abs(response[0]) == pytest.approx(1.0)
    assert abs(response[1]) / (2.0 * mode.damping) < 1.0


def test_modes_beyond_the_rate_have_no_notch() -> None:
    """At 1 kHz a mode at 734 Hz is folded to 266 Hz; no notch is made."""
    assert notched([MODE], 1e-3) == ()
    assert notched([MODE], 1e-4) == (MODE,)
