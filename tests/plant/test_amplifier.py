"""The simulated amplifier: each of its limits alone."""

from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.plant.kernel import output_v
from piezod.plant.layout import constants
from piezod.plant.plant import Plant
from tests.plant.plants import make_plant, parameters_of

GRID_NS = 50_000


def outputs(plant: Plant, drive_v: float, steps: int) -> Any:
    """Command one voltage and return the output after each sub-step, in V."""
    plant.command(drive_v)
    values = []
    for _ in range(steps):
        plant.advance_to(plant.now_ns + GRID_NS)
        values.append(plant.drive_v)
    return np.array(values)


def test_without_effects_the_output_is_the_command() -> None:
    """An amplifier without any effect is instantaneous and exact."""
    assert list(outputs(make_plant(only=()), 123.456, 2)) == pytest.approx(2 * [123.456], rel=1e-15)


def test_bandwidth_is_a_low_pass_of_first_order() -> None:
    """The response to a step is 1 - exp(-2π · 3 kHz · t)."""
    actual = outputs(make_plant(only=("amplifier_bandwidth",)), 100, 20)

    expected = 100 * (1 - np.exp(-2 * np.pi * 3000 * np.arange(1, 21) * 50e-6))
    assert actual == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("effect", "v_per_s"), [("slew", 5e4), ("current_limit", 0.1 / 3e-6)])
def test_output_is_no_faster_than_its_limit(effect: str, v_per_s: float) -> None:
    """Slew rate, and current into the capacitance, turn every step into a ramp, both ways."""
    plant = make_plant(only=(effect,))
    up, down = outputs(plant, 100, 80), outputs(plant, 0, 80)
    ramp = np.minimum(v_per_s * np.arange(1, 81) * 50e-6, 100)

    assert up == pytest.approx(ramp, abs=1e-9)
    assert down == pytest.approx(100 - ramp, abs=1e-9)


@given(start_v=st.floats(-10, 160), goal_v=st.floats(-10, 160))
def test_output_does_not_depend_on_the_sub_step(start_v: float, goal_v: float) -> None:
    """With bandwidth and slew limit, one long step equals many short ones."""
    parameters = parameters_of(only=("amplifier_bandwidth", "slew", "current_limit"))
    long, short = constants(parameters, 1e-3), constants(parameters, 1e-5)
    at_once, bit_by_bit = output_v(start_v, goal_v, long), start_v
    for _ in range(100):
        bit_by_bit = output_v(bit_by_bit, goal_v, short)

    assert bit_by_bit == pytest.approx(at_once, abs=1e-9)


@pytest.mark.parametrize(
    ("variant", "command_v", "expected_v"),
    [("stack", 175, 160), ("stack", -25, -10), ("flexure", 195, 190), ("flexure", 189, 189)],
)
def test_output_stays_within_the_voltage_limits(
    variant: str, command_v: float, expected_v: float
) -> None:
    """A command beyond the limits gives the limit."""
    plant = make_plant(variant, only=("voltage_limits",))

    assert outputs(plant, command_v, 1)[0] == pytest.approx(expected_v, rel=1e-12)


@pytest.mark.parametrize(("command_v", "expected_v"), [(250.0, 200.0), (-250.0, -200.0)])
def test_converter_ends_at_its_range(command_v: float, expected_v: float) -> None:
    """A converter of ±10 V and a gain of 20 give at most ±200 V."""
    actual_v = outputs(make_plant(only=("dac",)), command_v, 1)[0]

    assert actual_v == pytest.approx(expected_v, abs=0.01)


def test_output_has_the_steps_of_the_converter() -> None:
    """With 16 bits over ±10 V, times 20, every output is a multiple of 6.1 mV, and all occur."""
    plant = make_plant(only=("dac",))
    step_v = 20 * 20 / 2**16
    actual = np.array([outputs(plant, 70 + v, 1)[0] for v in np.arange(0, 0.1, step_v / 10)])

    assert actual / step_v == pytest.approx(np.round(actual / step_v), abs=1e-6)
    assert np.unique(np.round(np.diff(actual) / step_v)) == pytest.approx([0, 1])


def test_gain_error_scales_the_output() -> None:
    """A gain that is 0.2 % too high gives 100.2 V for 100 V."""
    assert outputs(make_plant(only=("gain_error",)), 100, 1)[0] == pytest.approx(100.2, rel=1e-12)


def test_noise_of_the_output_is_0_8_mv_rms_in_its_bandwidth() -> None:
    """The noise has the rms value of the parameters and the bandwidth of the amplifier."""
    plant = make_plant(only=("amplifier_noise", "amplifier_bandwidth"))
    noise_v = outputs(plant, 0, 100_000)

    assert np.std(noise_v) == pytest.approx(0.8e-3, rel=0.02)
    correlation = np.corrcoef(noise_v[:-1], noise_v[1:])[0, 1]
    assert correlation == pytest.approx(np.exp(-2 * np.pi * 3000 * 50e-6), abs=0.02)


def test_infinitely_fast_lag_with_a_slew_limit_ends_on_the_goal() -> None:
    """A slew limit without a lag stops exactly at the target."""
    parameters = parameters_of(only=("slew",))
    amplifier = replace(parameters.amplifier, bandwidth_hz=inf, slew_v_per_s=1e6)
    record = constants(replace(parameters, amplifier=amplifier), 50e-6)

    assert output_v(0.0, 10.0, record) == 10.0
