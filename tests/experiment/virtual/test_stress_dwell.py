"""Tests that long adaptation to tiny loops keeps the model of large ones."""

import numpy as np
import pytest

from tests.conftest import Figure
from tests.experiment.stress_rig import (
    CYCLE_S,
    MIDDLE_UM,
    SWING_UM,
    Identified,
    StressRig,
    listed,
    swing_um,
    worst_by_cycle_pct,
    worst_pct,
)

DWELL_PERIOD_S = 1.0
SWINGS = 6


def dwell_then_swing(
    stage: Identified, identifier: str, dwell_s: float, figure: Figure
) -> tuple[float, list[float]]:
    """Return the worst error of a dwell at 1 % amplitude, and of each full swing after it."""

    def reference_um(t_s: float) -> float:
        if t_s < dwell_s:
            return MIDDLE_UM + 0.01 * SWING_UM * float(np.sin(2.0 * np.pi * t_s / DWELL_PERIOD_S))
        return swing_um(t_s - dwell_s)

    rig = StressRig(stage.learning_by(identifier), reference_um)
    before = rig.learned
    dwelling = worst_pct(rig.run(dwell_s))
    moved = rig.moved_pct(before, rig.learned)
    after = worst_by_cycle_pct(rig.run(SWINGS * CYCLE_S), stage.config.rate_hz)
    figure(
        f"dwell of {dwell_s:g} s at 1 % amplitude, {identifier:4}: worst true error "
        f"{dwelling:.2f} %, then in full swings {listed(after)} %; "
        f"drives predicted over the range moved by {moved:.1f} %"
    )
    return dwelling, after.tolist()


@pytest.mark.parametrize("dwell_s", [10.0, pytest.param(600.0, marks=pytest.mark.stress)])
def test_dwell_does_not_spoil_the_full_swing(
    beyond_stage: Identified, figure: Figure, dwell_s: float
) -> None:
    """RLS stays below 1 % during the dwell, and is back there after one full swing."""
    dwelling, after = dwell_then_swing(beyond_stage, "rls", dwell_s, figure)

    assert dwelling < 1.0
    assert after[0] < 3.0
    assert max(after[1:]) < 1.0


@pytest.mark.stress
@pytest.mark.parametrize(
    ("identifier", "most_pct", "most_later_pct"), [("nlms", 5, 1), ("lms", 15, 5)]
)
def test_dwell_does_not_make_gradients_diverge(
    even_stage: Identified,
    figure: Figure,
    identifier: str,
    most_pct: float,
    most_later_pct: float,
) -> None:
    """NLMS forgets more than RLS but is back as soon; the paper's LMS stays bounded."""
    dwelling, after = dwell_then_swing(even_stage, identifier, 600.0, figure)

    assert max(dwelling, after[0]) < most_pct
    assert max(after[1:]) < most_later_pct
