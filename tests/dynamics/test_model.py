"""The frequency response of a stage."""

import numpy as np
import pytest

from piezod.dynamics import Resonance, ResponseModel
from piezod.errors import ModelError


def test_static_gain_is_one() -> None:
    """At frequency zero the response is one, however many modes there are."""
    model = ResponseModel(1e-3, (Resonance(700.0, 0.03, 0.8), Resonance(2000.0, 0.02, 0.2)))

    assert model.at(np.zeros(1))[0] == pytest.approx(1.0)


def test_resonance_amplifies_and_turns_by_a_quarter() -> None:
    """At its frequency a mode amplifies by 1/(2ζ) and lags by 90°."""
    value = ResponseModel(0.0, (Resonance(700.0, 0.03),)).at(np.array([700.0]))[0]

    assert abs(value) == pytest.approx(1.0 / 0.06)
    assert np.angle(value, deg=True) == pytest.approx(-90.0)


def test_delay_turns_in_proportion_to_the_frequency() -> None:
    """A stage without modes only delays."""
    value = ResponseModel(1e-3).at(np.array([100.0, 200.0]))

    assert np.abs(value) == pytest.approx([1.0, 1.0])
    assert np.angle(value, deg=True) == pytest.approx([-36.0, -72.0])


@pytest.mark.parametrize(
    ("delay_s", "resonances", "message"),
    [
        (-1e-3, (), "delay_s must be at least 0"),
        (float("nan"), (), "delay_s must be at least 0"),
        (0.0, (Resonance(0.0, 0.1),), "above 0 Hz"),
        (0.0, (Resonance(700.0, 0.0),), "damping"),
        (0.0, (Resonance(700.0, 0.1, 0.5),), "add up to 1"),
    ],
)
def test_values_out_of_range_are_refused(
    delay_s: float, resonances: tuple[Resonance, ...], message: str
) -> None:
    """A model with an impossible value is refused, and the message names it."""
    with pytest.raises(ModelError, match=message):
        ResponseModel(delay_s, resonances)
