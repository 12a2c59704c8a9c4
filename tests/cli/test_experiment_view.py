import numpy as np
import pytest

from piezod.cli.experiment_view import warnings_of
from piezod.records.recording import ExperimentResult, Identification


def result_with(smallest_slope: float) -> ExperimentResult:
    """A result whose only model has this smallest slope."""
    nothing = np.empty(0)
    identification = Identification(
        axis="x",
        title="made up",
        method="lms",
        t_s=nothing,
        drive_v=nothing,
        position_um=nothing,
        predicted_v=nothing,
        parameters={"smallest_slope": np.array(smallest_slope)},
    )
    return ExperimentResult(
        title="made up",
        recordings=(),
        identifications=(identification,),
        configuration="",
        versions={},
        seed=1,
        rate_hz=1000.0,
    )


@pytest.mark.parametrize("smallest_slope", [0.0, -0.25])
def test_an_inverse_that_is_not_monotone_is_warned_of(smallest_slope: float) -> None:
    """The warning names the axis, the slope and the remedy."""
    (warning,) = warnings_of(result_with(smallest_slope))

    assert "axis x is not monotone" in warning
    assert f"{smallest_slope:.2g}" in warning
    assert "more loops" in warning


def test_a_monotone_inverse_is_not_mentioned() -> None:
    """There is no warning without a reason."""
    assert warnings_of(result_with(0.3)) == []
