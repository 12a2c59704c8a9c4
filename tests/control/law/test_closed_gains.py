"""Tests of the gains of mode `closed`, whose margins a frequency sweep finds independently."""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezod.config.axes import AxisConfig
from piezod.config.modes import Mode
from piezod.config.trim import ClosedConfig
from piezod.control.law.response_files import response_model
from piezod.control.law.trim_gains import (
    USUAL_CLOSED_GAIN_PER_S,
    check_feedback,
    feedback_law,
)
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import propose
from piezod.errors import ModelError
from tests.control.law.test_dynamics import MODE, PERIOD_S, axis_of, response_of


class Plant(NamedTuple):
    """A stage with two equal lags, as of a filter of its sensor, behind a held drive."""

    period_s: float
    delay_s: float  #: Without the lags, in s.
    lag_s: float  #: Time constant of each lag, in s.
    mode_hz: float
    damping: float

    @property
    def axis(self) -> AxisConfig:
        """Configuration whose response has the mode, and the lags as a delay."""
        mode = {"frequency_hz": self.mode_hz, "damping": self.damping}
        return axis_of(response_of(mode, delay_s=self.delay_s + 2.0 * self.lag_s))

    def margins(self, law: TrimLaw) -> tuple[float, float]:
        """Return the gain margin, and the phase margin in degrees, of a loop with this law."""
        period_s = self.period_s
        high_hz = 0.5 / period_s
        around = self.mode_hz * (1.0 + np.linspace(-0.2, 0.2, 1001))
        sweep = np.concatenate((np.geomspace(1e-3, 1.0, 4000) * high_hz, around))
        hz = np.unique(sweep[sweep <= high_hz])
        z = np.exp(2j * np.pi * hz * period_s)
        control = law.gain_per_s * period_s / (z - 1.0) + law.proportional / z
        for each in law.notches:
            control = control * _notch(z, each.frequency_hz * period_s, each.damping)
        images_hz = hz + np.arange(-6, 7)[:, np.newaxis] / period_s
        s = 2j * np.pi * images_hz
        held = -np.expm1(-s * period_s) / (s * period_s)
        mode = 1.0 / (
            1.0 - (images_hz / self.mode_hz) ** 2 + 2j * self.damping * images_hz / self.mode_hz
        )
        lags = (1.0 + s * self.lag_s) ** -2
        loop = control * np.sum(held * mode * lags * np.exp(-s * self.delay_s), axis=0)
        turns = np.flatnonzero((loop.imag[:-1] * loop.imag[1:] <= 0.0) & (loop.real[:-1] < 0.0))
        within = np.abs(loop) >= 1.0
        return 1.0 / np.abs(loop[turns]).max(), np.abs(np.angle(-loop[within], deg=True)).min()


def _notch(z: np.ndarray, turns: float, damping: float) -> np.ndarray:
    """Return a notch with a static gain of one: zeros at the sampled mode, two real poles."""
    pole = 2.0 * np.pi * turns * (-damping + 1j * np.sqrt(1.0 - damping**2))
    zero, real = np.exp(pole), np.exp(-2.0 * np.pi * turns)
    gain = (1.0 - real) ** 2 / abs(1.0 - zero) ** 2
    return np.asarray(
        gain * (1.0 - zero / z) * (1.0 - zero.conjugate() / z) / (1.0 - real / z) ** 2
    )


@st.composite
def plants(draw: st.DrawFn) -> Plant:
    """Draw a stage whose mode can have a notch."""
    period_s = draw(st.floats(5e-5, 1e-3))
    return Plant(
        period_s,
        draw(st.floats(0.3, 5.0)) * period_s,
        draw(st.floats(0.0, 3.0)) * period_s,
        draw(st.floats(0.01, 0.4)) / period_s,
        draw(st.floats(0.002, 0.3)),
    )


@settings(max_examples=10, deadline=None)
@given(plant=plants())
def test_fastest_and_usual_gains_have_6_db_and_45_degrees(plant: Plant) -> None:
    """On any stage of a delay, two lags and a mode: those that are proposed, and those in use."""
    used = feedback_law(Mode.CLOSED, plant.axis, plant.period_s, 0.0)
    response = plant.axis.response
    assert response is not None
    fastest = propose(plant.period_s, response_model(response), used.notches)
    for law in (used, fastest):
        gain_margin, phase_margin_deg = plant.margins(law)

        assert gain_margin >= 1.98
        assert phase_margin_deg >= 44.5
    assert used.gain_per_s <= USUAL_CLOSED_GAIN_PER_S


def test_fastest_gains_are_not_timid() -> None:
    """With a third more, a margin is too small."""
    plant = Plant(1e-4, 2.3e-4, 0.0, 734.0, 0.03)
    mode = Resonance(plant.mode_hz, plant.damping)
    law = propose(plant.period_s, ResponseModel(plant.delay_s, (mode,)), (mode,))
    gain_margin, phase_margin_deg = plant.margins(
        law._replace(gain_per_s=1.3 * law.gain_per_s, proportional=1.3 * law.proportional)
    )

    assert gain_margin < 2.0 or phase_margin_deg < 45.0
    assert law.gain_per_s > 1000.0


@pytest.mark.parametrize("gain_per_s", [3000.0, 20_000.0])
def test_given_gains_without_margin_are_refused(gain_per_s: float) -> None:
    """The text has the numbers, and the gain that is allowed."""
    closed = ClosedConfig(gain_per_s=gain_per_s)
    axis = axis_of(response_of(MODE)).model_copy(update={"closed": closed})

    with pytest.raises(ModelError, match=r"closed gain of .* is not safe: .*; use at most \d+ 1/s"):
        check_feedback(Mode.CLOSED, axis, PERIOD_S, 0.0)


def test_unknown_mode_is_refused() -> None:
    """The remedy is to measure it; a response without any mode is a known one."""
    with pytest.raises(ModelError, match="piezod response"):
        check_feedback(Mode.CLOSED, axis_of(None), PERIOD_S, 1e-4)

    check_feedback(Mode.CLOSED, axis_of(response_of()), PERIOD_S, 0.0)
