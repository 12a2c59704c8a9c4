"""Tests of the factories that choose by the form of a model."""

from collections.abc import Callable
from typing import cast

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.control.law.compensated import Start, check_identifier, compensated_axis
from piezod.control.law.creep import AT_REST
from piezod.control.law.kernel import POSITION
from piezod.control.law.kernels import new_kernel
from piezod.control.law.model import StageModel, unidentified_form
from piezod.hysteresis import AffineRange, ModelForm, StopForm
from piezod.hysteresis.memory import FloatArray
from tests.control.made_up import FORM, WEIGHTS
from tests.control.rig_stage import shipped_config

AXIS = shipped_config().axes["x"]


class _OtherForm:
    """A form that control does not know."""

    size = 5

    def straight_line(self) -> FloatArray:
        """Return weights that the refusal comes before."""
        return np.zeros(5)

    def sampled(self, _period_s: float) -> "_OtherForm":
        """Return the form."""
        return self


OTHER = cast("ModelForm", _OtherForm())
MODEL = StageModel(OTHER, np.zeros(5), AffineRange(0.0, 150.0), AffineRange(0.0, 10.0), 0.0)
START = Start(0, 1_000_000, 0.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: new_kernel(OTHER, np.zeros(5), AT_REST), "no compensator for a _OtherForm"),
        (lambda: check_identifier(AXIS, OTHER), "no identifier for a _OtherForm"),
        (
            lambda: compensated_axis(AXIS, MODEL, AT_REST, Mode.FEEDFORWARD, float, START),
            "no identifier for a _OtherForm",
        ),
    ],
)
def test_form_that_control_does_not_know_is_refused(call: Callable[[], object], said: str) -> None:
    """No axis runs with parts of another form."""
    with pytest.raises(TypeError, match=said):
        call()


def test_kernel_changes_weights_and_lags_in_place() -> None:
    """The compensator reads them after the step."""
    weights, lags = WEIGHTS.copy(), np.zeros(1)
    law = AT_REST.creep._replace(weights=np.array([0.1]), gains=np.array([0.5]))
    kernel = new_kernel(FORM, weights, AT_REST._replace(creep=law, lags=lags, quick=0.4))

    kernel.step(2.0 * WEIGHTS, 0.5, 1.0, 0.6, 1.0, 0.0, 0.0, 1.0)

    assert weights == pytest.approx(1.5 * WEIGHTS)
    assert lags == pytest.approx([0.2])


def test_kernel_forgets_a_drive_that_was_not_applied() -> None:
    """Its position is then the one before, and the next drive the same again."""
    kernel = new_kernel(FORM, WEIGHTS.copy(), AT_REST)
    arguments = (0.0, 1.0, 0.6, 1.0, 0.0, 0.0, 1.0)

    first = kernel.step(WEIGHTS, *arguments)
    assert kernel.carried[POSITION] == 0.6
    kernel.discard_last()

    assert kernel.carried[POSITION] == 0.0
    assert kernel.step(WEIGHTS, *arguments) == first


def test_weights_that_are_not_finite_leave_the_displacement() -> None:
    """The compensator expects the displacement before them."""
    kernel = new_kernel(FORM, WEIGHTS.copy(), AT_REST._replace(quick=0.4))
    kernel.step(WEIGHTS, 0.0, 1.0, 0.4, 1.0, 0.0, 0.0, 1.0)

    kernel.step(np.full(8, np.nan), 1.0, 1.0, 0.6, 1.0, 0.0, 0.0, 1.0)

    assert kernel.carried[POSITION] == 0.4


def test_axis_without_a_model_has_even_stops() -> None:
    """Their number is the one in the configuration."""
    form = unidentified_form(AXIS)

    assert isinstance(form, StopForm)
    assert np.array_equal(form.bank, StopForm.even(AXIS.compensator.operators).bank)
