"""Tests that learning with a known response makes no mode oscillate, at any rate of the loop."""

import numpy as np
import pytest

from piezod.config.response_file import ResponseFile
from piezod.control.law.dynamics import known_dynamics
from piezod.plant.parameters import PlantParameters
from tests.conftest import Figure
from tests.experiment.stress_rig import Identified, StressRig
from tests.experiment.virtual.test_mode_rings import (
    CLASSES,
    LEAST_MARGIN,
    PROMPT,
    RATES_HZ,
    at_rate,
    identified,
    pace_margin,
)

FAST = {(PROMPT, 500.0, "surface")}
"""Tested by `make test`, too."""
FACTORS = (0.95, 1.05)
"""The mode is known within 5 %."""


def response_of(plant: PlantParameters, factor: float) -> ResponseFile:
    """Return the response of a plant, with another frequency of its mode."""
    sensor, stage = plant.sensor, plant.stage
    lags_s = [0.5 / (np.pi * each) for each in (plant.amplifier.bandwidth_hz, sensor.bandwidth_hz)]
    filter_s = np.sqrt(0.5) / (np.pi * sensor.antialias_hz)
    mode = {"frequency_hz": factor * stage.mode_hz, "damping": stage.mode_damping}
    return ResponseFile.model_validate(
        {
            "created_at": "2026-01-01T00:00:00+00:00",
            "created_by": "a test",
            "method": "multisine",
            "rate_hz": 10_000.0,
            "low_hz": 1.0,
            "high_hz": 2000.0,
            "coherence_low": 1.0,
            "coherence_high": 1.0,
            "delay_s": sensor.delay_s + sum(lags_s) + filter_s,
            "resonances": (mode,),
        }
    )


def with_response(stage: Identified, factor: float) -> Identified:
    """Return a stage whose axis knows its response, with an error of the mode."""
    plant = StressRig(stage, lambda _t_s: 0.0, approach_s=0.01).plant.parameters
    axis = stage.config.axes["x"].model_copy(update={"response": response_of(plant, factor)})
    known = stage._replace(config=stage.config.model_copy(update={"axes": {"x": axis}}))
    assert known_dynamics(axis, 1.0 / stage.config.rate_hz) is not None
    return known


PAIRS = [
    pytest.param(
        *(variant, rate_hz, kind, factor),
        marks=() if (variant, rate_hz, kind) in FAST and factor == 1.05 else pytest.mark.stress,
        id=f"{variant}-{rate_hz:g} Hz-{kind}-{factor:g}",
    )
    for variant in ("stack", "light-damping", PROMPT)
    for rate_hz in RATES_HZ
    for kind in CLASSES
    for factor in FACTORS
]


@pytest.mark.parametrize(("variant", "rate_hz", "kind", "factor"), PAIRS)
def test_learning_without_the_modes_does_not_ring_them(
    variant: str,
    rate_hz: float,
    kind: str,
    factor: float,
    monkeypatch: pytest.MonkeyPatch,
    figure: Figure,
    request: pytest.FixtureRequest,
) -> None:
    """Nothing oscillates, not even if the stage learns 1.5 times as fast."""
    stage = with_response(at_rate(identified(variant, kind), rate_hz), factor)
    margin = pace_margin(stage, monkeypatch, whole="stress" in request.keywords)
    figure(
        f"{variant}, {kind}, {rate_hz:g} Hz, response at {factor:g} times the mode: "
        f"learning may be {margin:g} times as fast"
    )

    assert margin >= LEAST_MARGIN
