"""The model at the lines of responses, and its derivatives."""

import numpy as np
import pytest

from piezod.dynamics.fit_lines import FitLines
from tests.dynamics.made_up import model_of, noisy

HEAD = [np.log(0.1), np.log(0.2), 0.05, 0.02, 0.3]
"""Gains of two responses, phase, creep, delay in ms."""
MODES = [np.log(300.0), np.log(0.6), np.log(800.0), np.log(0.03)]


@pytest.mark.parametrize("rate_hz", [None, 4000.0], ids=["continuous", "held"])
@pytest.mark.parametrize(
    "own", [[], MODES[2:], [*MODES, 1.3]], ids=["no resonance", "a mode", "a filter and a mode"]
)
def test_derivatives_are_those_of_the_residuals(own: list[float], rate_hz: float | None) -> None:
    """The Jacobian is the limit of differences, and no value of an earlier point is kept."""
    used = [noisy(model_of(2e-4), 0.01, seed, np.geomspace(5.0, 1500.0, 30)) for seed in (1, 2)]
    lines, parameters = FitLines(used, rate_hz), np.array([*HEAD, *own])

    first = lines.derivatives(parameters + 0.1)
    found = lines.derivatives(parameters)

    step = 1e-6 * np.eye(parameters.size)
    by_differences = [
        (lines.distance(parameters + each) - lines.distance(parameters - each)) / 2e-6
        for each in step
    ]
    assert found == pytest.approx(np.stack(by_differences, axis=1), rel=1e-5, abs=1e-4)
    assert not np.allclose(first, found)
