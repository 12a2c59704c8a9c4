"""The simulated fibre sensor: its curve, its noise, its converter."""

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest

from piezod.plant.fibre import line_residual, peak_gap_um
from piezod.plant.layout import constants
from piezod.plant.parameters import PlantParameters, specimen
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from tests.plant.plants import make_plant, parameters_of, run

SEED = np.random.SeedSequence(1)
# Variants with a sensor of their own; the other variants have that of the stack.
SENSORS = ("stack", "flexure", "afm")


def with_sensor(parameters: PlantParameters, **changes: float) -> Plant:
    """Make a plant with some parameters of the sensor changed."""
    return Plant(replace(parameters, sensor=replace(parameters.sensor, **changes)), SEED)


def readings_v(plant: Plant, positions_um: Any) -> Any:
    """Return the sensor's voltage at constant displacements."""
    return np.array([plant.ideal_reading_v(float(x)) for x in positions_um])


@pytest.mark.parametrize("variant", SENSORS)
def test_straight_line_deviates_by_one_percent(variant: str) -> None:
    """Over the travel the curve of every variant deviates from its best line by 1 % of travel."""
    plant = Plant(VARIANTS[variant].parameters, SEED)
    position_um = np.linspace(0, plant.parameters.stage.travel_um, 501)
    sensor_v = readings_v(plant, position_um)
    line = np.polynomial.Polynomial.fit(sensor_v, position_um, 1)
    residual_um = np.max(np.abs(line(sensor_v) - position_um))

    assert residual_um / position_um[-1] == pytest.approx(0.01, rel=0.01)


def test_nonlinearity_of_specimens_is_within_ten_percent_of_nominal() -> None:
    """The curve is defined by its nonlinearity, so travel and light do not add to its variation."""
    for seed in range(50):
        drawn = specimen(VARIANTS["stack"].parameters, np.random.SeedSequence(seed))
        record = constants(drawn, 50e-6)
        peak = float(record["peak_gap_um"][0]) / drawn.stage.travel_um

        assert 0.009 <= line_residual(peak) <= 0.011, f"seed {seed}"


def test_near_side_rises_to_a_maximum_and_the_far_side_falls() -> None:
    """The curve has one maximum, at the peak gap; far beyond it falls with the gap squared."""
    plant = with_sensor(parameters_of())
    peak_um = peak_gap_um(0.01, 30) - 10
    near = readings_v(plant, np.linspace(-10, peak_um, 200))
    far = readings_v(plant, np.linspace(peak_um, 40 * peak_um, 200))

    assert np.all(np.diff(near) > 0)
    assert np.all(np.diff(far) < 0)
    assert near[-1] == pytest.approx(2 / 3 * 0.11 * (peak_um + 10))
    assert plant.ideal_reading_v(1e5) / plant.ideal_reading_v(2e5) == pytest.approx(4, rel=1e-3)


def test_probe_set_back_beyond_the_maximum_sees_the_opposite_slope() -> None:
    """On the far side the voltage falls while the stage moves away."""
    steps_v = [0, 75, 150]
    near = run(with_sensor(parameters_of(only=("nonlinearity",))), steps_v).sensor_v
    far = run(with_sensor(parameters_of(only=("nonlinearity",)), setback_um=150), steps_v).sensor_v

    assert np.all(np.diff(near) > 0)
    assert np.all(np.diff(far) < 0)


def test_near_side_begins_with_the_slope_of_the_parameters() -> None:
    """Close to the probe the voltage is slope times gap; at the probe it is zero."""
    plant = with_sensor(parameters_of())

    assert plant.ideal_reading_v(-9.9) == pytest.approx(0.11 * 0.1, rel=1e-6)
    assert plant.ideal_reading_v(-10.5) == 0.0


def test_light_level_scales_the_voltage() -> None:
    """Half the light gives half the voltage everywhere on the curve."""
    positions_um = [0, 10, 30, 200]
    full = readings_v(with_sensor(parameters_of()), positions_um)
    half = readings_v(with_sensor(parameters_of(), light_level=0.5), positions_um)

    assert half == pytest.approx(full / 2, rel=1e-12)


def test_linear_sensor_has_no_far_side() -> None:
    """Without nonlinearity the maximum is infinitely far."""
    assert peak_gap_um(0.0, 30) == inf


@pytest.mark.parametrize("variant", SENSORS)
def test_noise_in_the_band_of_the_loop_is_0_06_pct_of_range(variant: str) -> None:
    """At rest in mid-travel, samples at 1 kHz have 0.06 % rms noise, hardly correlated.

    The anti-alias filter removes the noise above its band, which leaves a small correlation.
    """
    plant = make_plant(variant, only=("sensor_noise", "sensor_bandwidth", "antialias", "adc"))
    stage = plant.parameters.stage
    noise_v = run(plant, np.full(20_000, stage.drive_v / 2)).sensor_v[100:]
    middle_um = stage.travel_um / 2
    slope_v_per_um = plant.ideal_reading_v(middle_um + 0.5) - plant.ideal_reading_v(middle_um - 0.5)

    noise_pct = 100 * np.std(noise_v) / slope_v_per_um / stage.travel_um
    assert noise_pct == pytest.approx(0.06, rel=0.03)
    assert abs(np.corrcoef(noise_v[:-1], noise_v[1:])[0, 1]) < 0.1


def test_sensor_without_antialias_filter_passes_the_noise_of_its_detector() -> None:
    """The noise is that of 10 kHz through a first-order detector, 4 times that of 500 Hz."""
    plant = make_plant("no-antialias", only=("sensor_noise", "sensor_bandwidth", "antialias"))
    noise_v = run(plant, np.full(20_000, 75.0)).sensor_v[100:]
    slope_v_per_um = plant.ideal_reading_v(15.5) - plant.ideal_reading_v(14.5)

    # White noise up to 10 kHz, the rate of the sub-steps, through a detector of 10 kHz. The
    # detector is exact in time: its variance is that of an autoregression with exp(-π).
    decay = np.exp(-2 * np.pi * 1e4 * 50e-6)
    expected_nm = 0.745 * np.sqrt(1e4 * (1 - decay) / (1 + decay))
    assert 1000 * np.std(noise_v) / slope_v_per_um == pytest.approx(expected_nm, rel=0.03)


def test_noise_density_is_flat_up_to_the_filter() -> None:
    """Without filters the density is 0.745 nm/√Hz up to half the rate of the sub-steps."""
    plant = make_plant(only=("sensor_noise",))
    noise_v = run(plant, np.zeros(50_000), 50_000).sensor_v
    noise_nm = 1e3 * (noise_v - np.mean(noise_v)) / plant.parameters.sensor.slope_v_per_um
    density = np.mean(np.abs(np.fft.rfft(noise_nm.reshape(50, 1000))) ** 2, axis=0) * 2 / 1000 / 2e4

    bands = [np.sqrt(np.mean(density[a:b])) for a, b in [(1, 100), (100, 300), (300, 500)]]
    assert bands == pytest.approx(3 * [0.745], rel=0.05)


def test_reading_has_the_steps_of_the_converter() -> None:
    """With 16 bits over ±10 V, every reading is a multiple of 0.3 mV, and all occur."""
    steps = run(make_plant(only=("adc",)), np.arange(0, 0.2, 0.001)).sensor_v / (20 / 2**16)

    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert set(np.round(np.diff(steps))) == {0, 1}


def test_reading_saturates() -> None:
    """With too much light the reading stops at 10 V, and recovers."""
    plant = with_sensor(parameters_of(only=("saturation", "nonlinearity")), light_level=3.0)
    sensor_v = run(plant, [0, 150, 100, 0]).sensor_v

    assert sensor_v[1] == 10.0
    assert sensor_v[3] == sensor_v[0] < 10


def test_line_residual_falls_with_the_distance_of_the_maximum() -> None:
    """The farther the maximum, the straighter the curve over the travel."""
    residuals = [line_residual(peak) for peak in (1.5, 2, 3, 5, 10, 100)]

    assert sorted(residuals, reverse=True) == residuals
