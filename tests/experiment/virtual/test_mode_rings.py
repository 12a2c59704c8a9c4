"""Tests that learning makes no first mode oscillate, at any rate of the loop."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from piezod.config.experiment import ExperimentConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.waveforms.shapes import Sine
from piezod.control.law import compensated
from piezod.control.law.pace import learning_pace
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import COMMAND_UM, TRUE_UM, opened
from piezod.hysteresis.memory import FloatArray
from piezod.plant.variants import VARIANTS
from tests.conftest import Figure
from tests.experiment.beyond import experiment_of, with_stops
from tests.experiment.stress_rig import Identified, StressRig

RATES_HZ = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10_000.0, 20_000.0)
CLASSES = ("surface", "stops")
PROMPT = "prompt"
"""A stage beside the variants, on which learning at full pace does ring."""
_FULL = {"kind": "sine", "low": 0, "high": 140}
RECORD = {
    "settle_s": 1.0,
    "run_in_s": 2.0,
    "duration_s": 12.0,
    "drive_v": {
        "kind": "sequence",
        "parts": (
            {"duration_s": 2.0, "waveform": {**_FULL, "frequency_hz": 0.5}},
            {
                "duration_s": 8.0,
                "waveform": {
                    **_FULL,
                    "frequency_hz": 0.75,
                    "envelope": {"kind": "decaying", "time_constant_s": 4.0},
                },
            },
            {"duration_s": 2.0, "waveform": {**_FULL, "frequency_hz": 5.0}},
        ),
    },
}
"""Short identification: a model with errors of 1 % is good enough here."""
APPROACH_S = 0.4
PARTS = 2
"""The run is judged in parts, so that no oscillation hides in a long time."""
WAVES, SHORTEST_S = 16, 1.2
"""Smallest number of waves of a run, and its shortest duration."""
SAMPLES_PER_WAVE = 200
FASTEST_WAVE_HZ = 50.0
LARGEST_RINGING_PCT = 0.3
"""Largest amplitude of a frequency between the harmonics of the wave, in % of the travel. A stage
that oscillates by itself does not keep to the harmonics; a misfit of the model does."""
FIRST_HARMONIC = 10
"""The frequencies below are not judged: there the model learns."""
LEAST_MARGIN = 1.5
FACTORS = (1.0, LEAST_MARGIN, 2.0, 4.0, 10.0)
"""Factors of the pace that are tried one after the other."""


@cache
def identified(variant: str, kind: str) -> Identified:
    """Return a variant with a model of this class, from a short record at 1 kHz."""
    config = _prompt_stage() if variant == PROMPT else experiment_of(variant)
    if kind == "stops":
        config = with_stops(config)
    assert config.identification is not None
    brief = type(config.identification).model_validate(
        {"method": config.identification.method, **RECORD}
    )
    with opened(config, lambda _cycles: None) as stage:
        axes = identify_axes(stage, config.model_copy(update={"identification": brief}))
    return Identified(config, axes["x"].model)


def _prompt_stage() -> ExperimentConfig:
    """Return the stack with a sharp mode, and a sensor without filter and delay."""
    config = experiment_of(
        "stack",
        effects={"antialias": False, "delay": False},
        stage={"mode_hz": 700.0, "mode_damping": 0.015},
    )
    axis = config.axes["x"]
    mode = FirstModeConfig(frequency_hz=700.0, damping=0.015)
    return config.model_copy(update={"axes": {"x": axis.model_copy(update={"first_mode": mode})}})


def at_rate(stage: Identified, rate_hz: float) -> Identified:
    """Return a stage at another rate; a voltage is held for a shorter or longer time."""
    held_s = 0.5 / rate_hz - 0.5 / stage.config.rate_hz
    model = stage.model
    delay_s = max(model.delay_s + held_s, 0.0)
    return stage._replace(model=type(model)(**{**vars(model), "delay_s": delay_s})).at(rate_hz)


class Ringing(NamedTuple):
    """The largest vibration between the harmonics of the wave that a stage learns from."""

    amplitude_pct: float  #: Its amplitude, in % of the travel.
    frequency_hz: float  #: Its frequency, in Hz.
    learned: bool  #: Whether the stage has kept what it learned: it did not follow badly.


def ringing(stage: Identified) -> Ringing:
    """Return the vibration of a stage that learns."""
    rate_hz, width_um = stage.config.rate_hz, stage.model.position_um.width
    wave_hz = min(rate_hz / SAMPLES_PER_WAVE, FASTEST_WAVE_HZ)
    wave = Sine(kind="sine", low=0.3 * width_um, high=0.5 * width_um, frequency_hz=wave_hz)
    waves = max(round(SHORTEST_S * wave_hz), WAVES) // PARTS
    part_s = waves / wave_hz
    reference = wave.built(PARTS * part_s + 1.0).value
    rig = StressRig(stage, reference, approach_s=APPROACH_S)
    rig.run(0.2)  # in which the start of the wave decays
    before = rig.learned
    traces = [rig.run(part_s) for _ in range(PARTS)]
    dropped = rig.axis.proof.take_verdict() is not None
    learned = not dropped and not np.array_equal(rig.learned, before)
    errors_um = [trace[:, TRUE_UM] - trace[:, COMMAND_UM] for trace in traces]
    amplitude_um, line = max(_largest_between(each, waves) for each in errors_um)
    return Ringing(100.0 / width_um * amplitude_um, line / part_s, learned)


def _largest_between(error: FloatArray, waves: int) -> tuple[float, int]:
    """Return the largest amplitude between the harmonics of a wave, and its number of cycles.

    Args:
        error: (n,) errors over time.
        waves: How often the wave repeats in this time.
    """
    window = np.hanning(error.size)
    amplitudes = np.abs(np.fft.rfft(window * (error - error.mean()))) * (2.0 / window.sum())
    lines = np.arange(amplitudes.size)
    off_harmonic = np.abs((lines + waves // 2) % waves - waves // 2)
    amplitudes[(lines <= FIRST_HARMONIC * waves) | (off_harmonic <= 2)] = 0.0
    largest = int(np.argmax(amplitudes))
    return float(amplitudes[largest]), largest


def change_pace(patch: pytest.MonkeyPatch, factor: float) -> None:
    """Let all stages learn faster by a factor."""

    def pace(period_s: float, mode: FirstModeConfig | None, learned_share: float) -> float:
        return factor * learning_pace(period_s, mode, learned_share)

    patch.setattr(compensated, "learning_pace", pace)


def pace_margin(stage: Identified, patch: pytest.MonkeyPatch, *, whole: bool) -> float:
    """Return the largest factor of those tried with which nothing rings, 0 if the first one rings.

    Args:
        stage: The stage.
        patch: Changes the pace.
        whole: Whether all factors are tried, or only the least margin.
    """
    steady = 0.0
    for factor in FACTORS if whole else (LEAST_MARGIN,):
        change_pace(patch, factor)
        found = ringing(stage)
        if not found.learned or found.amplitude_pct > LARGEST_RINGING_PCT:
            break
        steady = factor
    return steady


PAIRS = [
    pytest.param(
        *(variant, rate_hz, kind),
        id=f"{variant}-{rate_hz:g} Hz-{kind}",
    )
    for variant in (*VARIANTS, PROMPT)
    for rate_hz in RATES_HZ
    for kind in CLASSES
]


@pytest.mark.stress  # `make test` has test_response_rings.py and test_stage_mode_rings.py
@pytest.mark.parametrize(("variant", "rate_hz", "kind"), PAIRS)
def test_learning_does_not_ring_a_mode(
    variant: str,
    rate_hz: float,
    kind: str,
    monkeypatch: pytest.MonkeyPatch,
    figure: Figure,
) -> None:
    """Nothing oscillates, not even if the stage learns 1.5 times as fast."""
    stage = at_rate(identified(variant, kind), rate_hz)
    margin = pace_margin(stage, monkeypatch, whole=True)
    figure(f"{variant}, {kind}, {rate_hz:g} Hz: learning may be {margin:g} times as fast")

    assert margin >= LEAST_MARGIN
