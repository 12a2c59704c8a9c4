"""A model whose delay is negative: its record told the samples too early."""

from dataclasses import replace

import numpy as np
import pytest

from piezod.config.modes import Mode
from piezod.control.law.compensated import Start, compensated_axis, in_loop
from piezod.control.law.creep import AT_REST
from piezod.control.law.model_files import read_model
from piezod.devices.interface import Sample
from piezod.hysteresis import LearnedModel
from tests.control.rig_stage import shipped_config

PERIOD_NS = 1_000_000


@pytest.mark.parametrize("delay_s", [-4e-4, -3e-3, -0.1])
def test_axis_with_a_negative_delay_follows_its_command(delay_s: float) -> None:
    """Samples are then paired with the newest voltage, and the axis learns from them."""
    config = shipped_config().axes["x"]
    assert config.model is not None
    model = replace(read_model(config.model)[0], delay_s=delay_s)
    law = compensated_axis(
        config, model, AT_REST, Mode.ADAPTIVE, lambda _t_s: 8.0, Start(0, PERIOD_NS, 0.0)
    )

    drives_v = []
    for cycle in range(50):
        t_ns = cycle * PERIOD_NS
        drives_v.append(law.update(t_ns, Sample(t_ns, 7.9, True)).drive_v)
        law.applied(drives_v[-1])

    assert np.all(np.isfinite(drives_v))
    assert drives_v[-1] > 10.0


@pytest.mark.parametrize("delay_s", [3e-3, -3e-3, -0.02])
def test_worse_model_is_found_with_any_delay(delay_s: float) -> None:
    """The motion within the delay excuses an error, and no more."""
    config = shipped_config().axes["x"]
    assert config.model is not None
    model = replace(read_model(config.model)[0], delay_s=delay_s, held_s=None)
    start = Start(0, PERIOD_NS, 0.0)
    proof = compensated_axis(config, model, AT_REST, Mode.ADAPTIVE, lambda _t_s: 8.0, start).proof

    learned = LearnedModel(model.weights.copy())
    commands = 0.5 + 0.3 * np.sin(2 * np.pi * np.arange(3000) / 1000)
    errors = [0.05, -0.05] * 1500
    worse = [
        proof.add(float(command), error, 0.001, learned)
        for command, error in zip(commands, errors, strict=True)
    ]

    assert any(worse)


@pytest.mark.parametrize("found_s", [-4e-4, -1e-3])
def test_a_sensor_is_not_early_in_a_faster_loop(found_s: float) -> None:
    """A mode that rang from cycle to cycle hid its delay; without a data sheet it stays hidden."""
    axis = shipped_config().axes["x"]
    assert axis.model is not None
    model = replace(read_model(axis.model)[0], delay_s=found_s, held_s=1e-3)
    sensor = {"sensor_delay_s": 1.3e-4}
    known = axis.model_copy(update={"compensator": axis.compensator.model_copy(update=sensor)})
    unknown = axis.model_copy(
        update={"compensator": axis.compensator.model_copy(update={"sensor_delay_s": 0.0})}
    )

    assert 0.5e-4 < in_loop(known, model, None, 1e-4).delay_s < 1.3e-4
    assert in_loop(unknown, model, None, 1e-4).delay_s == model.at(1e-4).delay_s
    assert in_loop(known, model, None, 1e-3).delay_s == found_s
