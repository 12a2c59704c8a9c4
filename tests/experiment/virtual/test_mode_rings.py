"""Tests that learning makes no first mode oscillate, at any rate of the loop."""

from functools import cache

import numpy as np
import pytest

from piezod.config.waveforms import Sine
from piezod.control.law import compensated
from piezod.control.law.pace import learning_pace
from piezod.control.reference.waveforms import build_waveform
from piezod.experiment.virtual.identify import identify_axes
from piezod.experiment.virtual.stage import COMMAND_UM, TRUE_UM, opened
from piezod.hysteresis.memory import FloatArray
from tests.experiment.beyond import experiment_of, with_stops
from tests.experiment.stress_rig import Identified, StressRig

RATES_HZ = (100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0, 10_000.0, 20_000.0)
CLASSES = ("surface", "stops")
FAST = {
    ("stack", 10_000.0, "surface"),
    ("light-damping", 2000.0, "surface"),
    ("stack", 10_000.0, "stops"),
}
"""Tested by `make test`, too: each variant is identified once."""
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
PARTS = 5
"""The run is judged in parts, so that no oscillation hides in a long time."""
WAVES, SHORTEST_S = 10.0, 1.5
SAMPLES_PER_WAVE = 200
FASTEST_WAVE_HZ = 50.0
LARGEST_RINGING_PCT = 0.3
"""Largest amplitude of a single frequency above the harmonics of the wave, in % of the travel."""
LEAST_MARGIN = 1.5
FACTORS = (1.0, LEAST_MARGIN, 2.0, 4.0, 10.0)
"""Factors of the pace that are tried one after the other."""


@cache
def identified(variant: str, kind: str) -> Identified:
    """Return a variant with a model of this class, from a short record at 1 kHz."""
    config = experiment_of(variant)
    if kind == "stops":
        config = with_stops(config)
    assert config.identification is not None
    brief = type(config.identification).model_validate(
        {"method": config.identification.method, **RECORD}
    )
    with opened(config, lambda _cycles: None) as stage:
        axes = identify_axes(stage, config.model_copy(update={"identification": brief}))
    return Identified(config, axes["x"].model)


def at_rate(stage: Identified, rate_hz: float) -> Identified:
    """Return a stage at another rate; a voltage is held for a shorter or longer time."""
    held_s = 0.5 / rate_hz - 0.5 / stage.config.rate_hz
    model = stage.model
    delay_s = max(model.delay_s + held_s, 0.0)
    return stage._replace(model=type(model)(**{**vars(model), "delay_s": delay_s})).at(rate_hz)


def ringing_pct(stage: Identified) -> float:
    """Return the largest amplitude above the harmonics of a wave that is learned from, in %.

    Infinite if the stage followed so badly that what was learned was dropped.
    """
    rate_hz, width_um = stage.config.rate_hz, stage.model.position_um.width
    wave_hz = min(rate_hz / SAMPLES_PER_WAVE, FASTEST_WAVE_HZ)
    wave = Sine(kind="sine", low=0.3 * width_um, high=0.5 * width_um, frequency_hz=wave_hz)
    part_s = max(WAVES / wave_hz, SHORTEST_S) / PARTS
    reference = build_waveform(wave, (PARTS + 1) * part_s).value
    rig = StressRig(stage, reference, approach_s=APPROACH_S)
    rig.run(part_s)  # in which the start of the wave decays
    traces = [rig.run(part_s) for _ in range(PARTS)]
    if rig.axis.proof.take_verdict() is not None:
        return np.inf
    first = round(10.0 * wave_hz * part_s)
    largest_um = max(
        _largest_line(each[:, TRUE_UM] - each[:, COMMAND_UM], first) for each in traces
    )
    return 100.0 * largest_um / width_um


def _largest_line(error: FloatArray, first: int) -> float:
    """Return the largest amplitude of a frequency, from a line of the spectrum on."""
    window = np.hanning(error.size)
    lines = np.abs(np.fft.rfft(window * (error - error.mean()))) * (2.0 / window.sum())
    return float(np.max(lines[first:]))


def pace_margin(stage: Identified, patch: pytest.MonkeyPatch) -> float:
    """Return the largest factor of the pace with which nothing rings, 0 if even one does."""
    steady = 0.0
    for factor in FACTORS:
        patch.setattr(
            compensated,
            "learning_pace",
            lambda *arguments, factor=factor: factor * learning_pace(*arguments),
        )
        if ringing_pct(stage) > LARGEST_RINGING_PCT:
            break
        steady = factor
    return steady
