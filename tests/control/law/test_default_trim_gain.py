"""Tests of the gain of a trim whose configuration gives none, and of the mode that it is for."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.config.axes import AxisConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.modes import Mode
from piezod.control.law.first_mode import FirstMode
from piezod.control.law.model import StageModel, with_found_mode
from piezod.control.law.trim_gains import USUAL_GAIN_PER_S, check_feedback, feedback_law
from piezod.errors import ModelError
from piezod.hysteresis import AffineRange, StopForm
from tests.control.law.test_dynamics import MODE, axis_of, response_of

SHARP = FirstModeConfig(frequency_hz=400.0, damping=0.005)
PERIOD_S, DELAY_S = 1e-3, 0.6e-3

trim_law, check_trim = partial(feedback_law, Mode.TRIMMED), partial(check_feedback, Mode.TRIMMED)


def axis_with(mode: FirstModeConfig | None, **trim: object) -> AxisConfig:
    """Return the configuration of an axis without a response."""
    return axis_of(None, **trim).model_copy(update={"first_mode": mode})


def model_with(mode: FirstMode | None) -> StageModel:
    """Return a straight line whose record has shown a mode, or none."""
    form = StopForm.even(3)
    ranges = AffineRange(0.0, 150.0), AffineRange(0.0, 30.0)
    return StageModel(form, np.zeros(form.size), *ranges, delay_s=DELAY_S, mode=mode)


def test_gain_is_the_usual_one_if_it_has_enough_margin() -> None:
    """A stage without a known mode, or with a fast one, has it."""
    fast = FirstModeConfig(frequency_hz=734.0, damping=0.03)

    assert trim_law(axis_with(None), PERIOD_S, DELAY_S).gain_per_s == USUAL_GAIN_PER_S
    assert trim_law(axis_with(fast), PERIOD_S, DELAY_S).gain_per_s == USUAL_GAIN_PER_S


def test_sharp_mode_lowers_the_gain_that_nobody_gave() -> None:
    """The same gain is refused if somebody gives it, with the gain that is used as the largest."""
    lowered = trim_law(axis_with(SHARP), PERIOD_S, DELAY_S).gain_per_s

    assert 1.0 < lowered < 0.5 * USUAL_GAIN_PER_S
    with pytest.raises(ModelError, match=f"gain of 50 1/s is not safe.*at most {lowered:g} 1/s"):
        check_trim(axis_with(SHARP, gain_per_s=USUAL_GAIN_PER_S), PERIOD_S, DELAY_S)


@given(
    frequency_hz=st.floats(5, 5000),
    damping=st.floats(0.001, 0.5),
    rate_hz=st.floats(100, 20_000),
    delay_s=st.floats(-1e-3, 5e-3),
)
def test_default_gain_is_never_refused(
    frequency_hz: float, damping: float, rate_hz: float, delay_s: float
) -> None:
    """For any mode, rate and delay it has all required margins, and is at most the usual one."""
    axis = axis_with(FirstModeConfig(frequency_hz=frequency_hz, damping=damping))

    check_trim(axis, 1.0 / rate_hz, delay_s)

    assert 0.0 < trim_law(axis, 1.0 / rate_hz, delay_s).gain_per_s <= USUAL_GAIN_PER_S


def test_given_gains_are_not_changed() -> None:
    """Neither that of the integral nor the proportional one: they are refused."""
    given_both = trim_law(axis_with(SHARP, gain_per_s=80.0), PERIOD_S, DELAY_S)

    assert given_both.gain_per_s == 80.0
    with pytest.raises(ModelError, match=r"proportional gain of 0\.9 is not safe"):
        check_trim(axis_with(SHARP, proportional=0.9), PERIOD_S, DELAY_S)


def test_axis_has_the_mode_of_its_model_if_it_has_none() -> None:
    """Its own mode, and a response with or without modes, are better known."""
    model = model_with(FirstMode(400.0, 0.005, lag_s=1e-4))
    own, stiff = FirstModeConfig(frequency_hz=500.0, damping=0.01), axis_of(response_of())

    assert with_found_mode(axis_with(None), model).first_mode == SHARP
    assert with_found_mode(axis_with(own), model).first_mode == own
    assert with_found_mode(stiff, model) == stiff
    assert with_found_mode(axis_of(response_of(MODE)), model).first_mode != SHARP
    assert with_found_mode(axis_with(None), model_with(None)).first_mode is None
    assert with_found_mode(axis_with(None), None).first_mode is None
