"""Finds how fast a stage must learn to ring by itself, beside the pace that its mode allows.

`test_pace.py` has the short version, for a linear stage.
"""

from typing import Final, NamedTuple

import pytest

from piezod.control.law import pace
from tests.conftest import Figure
from tests.experiment.stress_rig import Identified
from tests.experiment.virtual.test_mode_rings import (
    LARGEST_RINGING_PCT,
    LEAST_MARGIN,
    PROMPT,
    Ringing,
    at_rate,
    change_pace,
    identified,
    ringing,
)

STEP: Final = 1.2
"""Ratio of the paces that are tried one after the other."""
SAME_FREQUENCY: Final = 0.1
"""A stage rings at its first mode within this share of its frequency: learning shifts it."""
EDGES: Final = [
    pytest.param(PROMPT, 5000.0, 3.0, id="prompt-5000 Hz"),
    pytest.param(PROMPT, 10_000.0, 3.6, id="prompt-10000 Hz"),
    pytest.param(PROMPT, 20_000.0, 3.6, id="prompt-20000 Hz"),
    # The filter of the sensor turns the phase at the mode by a quarter of a turn.
    pytest.param("light-damping", 2000.0, 13.0, id="light-damping-2000 Hz"),
]
"""Stages, rates, and how many times as fast as allowed the stage may learn until it rings."""


class Edge(NamedTuple):
    """The edge of self-oscillation."""

    #: Largest factor of the allowed pace with which nothing rings; 0 if the allowed one rings.
    steady: float
    rings: float  #: Smallest factor that was found to ring.
    ringing: Ringing  #: How it rings.


def edge_of(stage: Identified, patch: pytest.MonkeyPatch, most: float) -> Edge:
    """Return the edge of a stage whose first mode alone limits its pace.

    Args:
        stage: The stage.
        patch: Changes the pace.
        most: Largest factor of the allowed pace that is tried.
    """
    patch.setattr(pace, "FULL_PACE_PERIOD_S", 1.0 / stage.config.rate_hz)
    steady, factor = 0.0, 1.0
    while factor <= most:
        change_pace(patch, factor)
        found = ringing(stage)
        if found.amplitude_pct > LARGEST_RINGING_PCT:
            return Edge(steady, factor, found)
        steady, factor = factor, STEP * factor
    pytest.fail(f"nothing rings, not even {steady:.3g} times as fast as allowed")


@pytest.mark.stress
@pytest.mark.parametrize(("variant", "rate_hz", "most"), EDGES)
def test_stage_rings_beyond_what_its_pace_allows_and_not_far_beyond(
    variant: str, rate_hz: float, most: float, monkeypatch: pytest.MonkeyPatch, figure: Figure
) -> None:
    """What rings is the first mode, at 1.5 to this many times the pace that the mode allows."""
    stage = at_rate(identified(variant, "surface"), rate_hz)
    mode = stage.config.axes["x"].first_mode
    assert mode is not None

    edge = edge_of(stage, monkeypatch, most)

    figure(
        f"{variant}, {rate_hz:g} Hz: steady {edge.steady:.2f} times as fast as its mode allows, "
        f"at {edge.rings:.2f} it rings with {edge.ringing.amplitude_pct:.2g} % at "
        f"{edge.ringing.frequency_hz:.0f} Hz"
    )
    assert edge.steady >= LEAST_MARGIN
    assert edge.ringing.frequency_hz == pytest.approx(mode.frequency_hz, rel=SAME_FREQUENCY)
