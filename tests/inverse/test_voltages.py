"""Voltages of a model without a stage."""

from pathlib import Path

import numpy as np
import pytest

import piezod
from piezod.config.first_mode import FirstModeConfig
from piezod.config.modes import Mode
from piezod.errors import ConfigError, DataError
from piezod.hysteresis.memory import FloatArray
from piezod.messages import requests as rq
from tests.control.rig_stage import RigStage, quick_config
from tests.control.surface_rig import CLASSES, EACH_MODEL, model_path, with_model
from tests.inverse.models import MODELS, RATE_HZ, loaded, signals

STILL = 5
"""Samples at rest before a trajectory moves, so that it does not matter when the loop starts."""
ROWS = 300


def trajectory(seed: int = 3) -> tuple[FloatArray, FloatArray]:
    """Return a random walk at the rate of the simulated stage: times in s, positions in µm."""
    steps_um = np.random.default_rng(seed).normal(0.0, 1.5, ROWS)
    position_um = np.clip(12.0 + np.cumsum(steps_um), 0.0, 25.9)
    position_um[:STILL] = 0.0
    return np.arange(ROWS) / 200.0, position_um


def looped(stage: RigStage, t_s: FloatArray, position_um: FloatArray) -> FloatArray:
    """Return the voltages with which a stage follows a trajectory from rest, in V."""
    stage.armed(rq.SelectMode(mode=Mode.FEEDFORWARD))
    for _ in range(60):  # until the change of mode has faded
        stage.cycle()
    before = len(stage.records)
    points = tuple(zip(t_s.tolist(), position_um.tolist(), strict=True))
    wave = {"kind": "points", "points": points}
    stage.do(rq.Wave.model_validate({"command_um": {"x": wave}, "duration_s": 1.5}))
    for _ in range(ROWS - 10):
        stage.cycle()
    return np.array([record.axes[0].drive_v for record in stage.records[before:]])


@pytest.mark.parametrize("name", EACH_MODEL)
def test_voltages_are_those_of_the_loop(name: str) -> None:
    """A stage in mode `feedforward` writes the same voltages, to the last bit, limits included."""
    config = with_model(quick_config(), name)
    t_s, position_um = trajectory()
    model = piezod.load_model(model_path(name), axis=config.axes["x"])

    plan = model.plan(t_s, position_um, rate_hz=200.0)
    written_v = looped(RigStage(config), t_s, position_um)

    # The first cycle of the movement comes one period after its start.
    assert np.array_equal(plan.drive_v[1 : 1 + written_v.size], written_v)
    assert {*plan.limited} == {"none", "slew rate"}


@pytest.mark.parametrize("name", MODELS)
def test_voltages_lead_to_their_positions(name: str) -> None:
    """The model predicts the positions of the trajectory, from rest and from a voltage."""
    model = loaded(MODELS[name]())
    low_um, high_um = model.position_range_um
    k = np.arange(1500)
    t_s = k / RATE_HZ
    position_um = low_um + (0.5 + 0.4 * np.sin(k / 100.0)) * (high_um - low_um)

    for from_v in (None, 60.0):
        plan = model.plan(t_s, position_um, from_v=from_v)
        asked_um = position_um[k > 10]
        off_um = np.abs(plan.predicted_um[k > 10] - asked_um)
        again_um = model.positions(t_s, plan.drive_v, from_v=from_v)

        assert np.max(off_um) < 1e-3 * (high_um - low_um)
        assert np.max(np.abs(again_um - plan.predicted_um)) < 1e-9


@pytest.mark.parametrize("name", MODELS)
def test_steps_go_on_after_voltages_that_were_applied(name: str) -> None:
    """The memory after voltages is that of the steps that made them."""
    model = loaded(MODELS[name]())
    low_um, high_um = model.position_range_um
    position_um = low_um + signals(600)["sines"] * (high_um - low_um)
    drives_v = np.array([model.step(each_um) for each_um in position_um.tolist()])

    model.reset(after_v=drives_v[:400])
    again_v = np.array([model.step(each_um) for each_um in position_um[400:].tolist()])

    assert np.max(np.abs(again_v - drives_v[400:])) < 1e-7
    model.reset()
    assert model.step(float(position_um[0])) == drives_v[0]


@pytest.mark.parametrize("name", CLASSES)
def test_stage_that_stands_is_held_by_its_voltage(name: str) -> None:
    """From a voltage at which the stage has stood for long, its own position asks for no move."""
    model = loaded(MODELS[f"{name}-creep"]())
    standing_um = float(model.positions([0.0, 0.001], [60.0, 60.0], from_v=60.0)[0])

    drives_v = model.voltages([0.0, 1.0], [standing_um] * 2, rate_hz=RATE_HZ, from_v=60.0)

    assert np.max(np.abs(drives_v - 60.0)) < 1e-6


@pytest.mark.parametrize("sensor_delay_s", [0.1e-3, 0.6e-3])
def test_stage_that_rings_shows_a_voltage_half_a_cycle_early(sensor_delay_s: float) -> None:
    """Whatever the delay of its sensor, which does not see the stage at its instants."""
    config = quick_config().axes["x"]
    compensator = config.compensator.model_copy(update={"sensor_delay_s": sensor_delay_s})
    mode = FirstModeConfig(frequency_hz=734.0, damping=0.005)
    axis = config.model_copy(update={"compensator": compensator, "first_mode": mode})

    model = piezod.load_model(model_path("surface"), axis=axis)

    assert model.lookahead_s(1000.0) == pytest.approx(0.5e-3, abs=1e-6)


def test_range_that_cuts_is_told() -> None:
    """Positions out of reach are marked, and the voltage stays at the end of the range."""
    model = loaded(MODELS["stops"]())
    plan = model.plan([0.0, 0.5, 1.0], [0.0, 1.2 * model.position_range_um[1], 0.0], rate_hz=100.0)

    assert plan.limited[0] == "none"
    assert plan.limited[50] == "range"
    assert np.max(plan.drive_v) == model.drive_range_v[1]


def test_object_tells_ranges_and_errors() -> None:
    """Ranges and errors are those of the file, in V and µm."""
    model = piezod.load_model(str(model_path("surface")))
    fit, width_v = model.file.fit, model.drive_range_v[1] - model.drive_range_v[0]

    assert model.uncertainty.voltage_rms_v == pytest.approx(
        fit.voltage_error_rms_pct / 100.0 * width_v
    )
    assert model.drive_range_v == (model.file.drive_low_v, model.file.drive_high_v)
    assert "surface" in repr(model)
    assert model.units["position"] == "µm"


@pytest.mark.parametrize(
    ("t_s", "position_um", "text"),
    [
        ([0.0, 1.0], [0.0, np.nan], "row 2 is nan"),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], "row 3 is not later"),
        ([0.0, 1.0, 3.0], [0.0, 1.0, 2.0], "rate_hz"),
        ([0.0], [0.0], "two or more"),
        ([0.0, 1.0], [0.0], "one for each time"),
    ],
)
def test_useless_trajectory_is_refused(
    t_s: list[float], position_um: list[float], text: str
) -> None:
    """The error says what is wrong, and where."""
    with pytest.raises(DataError, match=text):
        loaded(MODELS["stops"]()).voltages(t_s, position_um)


def test_start_beyond_the_limits_is_refused(tmp_path: Path) -> None:
    """A voltage at the start that the limits do not allow is an error; so is no rate."""
    with pytest.raises(DataError, match="from_v"):
        loaded(MODELS["stops"]()).voltages([0.0, 1.0], [0.0, 1.0], from_v=500.0)
    with pytest.raises(DataError, match="rate_hz"):
        piezod.load_model(model_path("stops"), rate_hz=0.0)
    with pytest.raises(ConfigError, match="cannot be read"):
        piezod.load_model(tmp_path / "none.yaml")
