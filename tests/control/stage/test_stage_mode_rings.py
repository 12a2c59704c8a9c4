"""Tests that learning does not make the first mode of a stage oscillate."""

from math import pi
from pathlib import Path

import numpy as np
import pytest

from piezod.config.daemon import DaemonConfig
from piezod.config.first_mode import FirstModeConfig
from piezod.config.model_file import dump_model, load_model
from piezod.config.modes import Mode
from piezod.config.waveforms.shapes import Sine
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, shipped_config

RATES_AND_MODES = [
    pytest.param(10_000.0, FirstModeConfig(frequency_hz=700.0, damping=0.015), 50.0, id="fast"),
    pytest.param(1000.0, FirstModeConfig(frequency_hz=150.0, damping=0.01), 10.0, id="slow"),
]


def prompt_stage(folder: Path, rate_hz: float, mode: FirstModeConfig) -> DaemonConfig:
    """Return the shipped configuration with this mode, and a sensor without filter and delay."""
    config = shipped_config()
    axis, rig = config.axes["x"], config.devices["rig"]
    assert axis.model is not None
    path = folder / "prompt.yaml"
    prompt = load_model(axis.model).model_copy(update={"delay_s": 0.5 / rate_hz})
    path.write_text(dump_model(prompt), encoding="utf-8")
    options = type(rig.options).model_validate(
        {
            "variant": "stack",
            "effects": {"antialias": False, "delay": False},
            "stage": {"mode_hz": mode.frequency_hz, "mode_damping": mode.damping},
        }
    )
    compensator = axis.compensator.model_copy(update={"sensor_delay_s": 0.0})
    axis = axis.model_copy(update={"model": path, "first_mode": mode, "compensator": compensator})
    return config.model_copy(
        update={
            "rate_hz": rate_hz,
            "axes": {"x": axis},
            "devices": {"rig": rig.model_copy(update={"options": options})},
        }
    )


@pytest.mark.parametrize(("rate_hz", "mode", "wave_hz"), RATES_AND_MODES)
def test_adaptive_stage_does_not_ring_its_mode(
    tmp_path: Path, rate_hz: float, mode: FirstModeConfig, wave_hz: float
) -> None:
    """While it learns from a wave, the position has less than 0.1 µm at the mode."""
    stage = RigStage(prompt_stage(tmp_path, rate_hz, mode)).armed(rq.SelectMode(mode=Mode.ADAPTIVE))
    wave = Sine(kind="sine", low=8, high=14, frequency_hz=wave_hz)
    stage.do(rq.Wave(command_um={"x": wave}, duration_s=2.0))
    stage.run(0.6)
    records = [each.axes[0] for each in stage.run(0.4)]

    error_um = np.array([each.position_um - each.command_um for each in records])
    t_s = np.arange(error_um.size) / rate_hz
    window = np.hanning(error_um.size) / np.hanning(error_um.size).sum()
    ringing_um = max(
        2 * abs(np.sum(window * error_um * np.exp(-2j * pi * frequency_hz * t_s)))
        for frequency_hz in np.linspace(0.96, 1.01, 11) * mode.frequency_hz
    )
    assert ringing_um < 0.1
    assert stage.x.mode is Mode.ADAPTIVE
