"""Mode, delay and filters against their formulas, and the effect of the sub-step."""

from dataclasses import replace
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from piezod.plant.discretise import exponential, mode, receiver
from piezod.plant.plant import Plant
from tests.plant.plants import make_plant, parameters_of, run

GRID_NS = 50_000
NOISE = ("amplifier_noise", "sensor_noise")


def mode_step(t_s: Any, frequency_hz: float, damping: float) -> Any:
    """Return the step response of a second-order mode."""
    omega = 2 * np.pi * frequency_hz
    damped = omega * np.sqrt(1 - damping**2)
    envelope = np.exp(-damping * omega * t_s)
    swing = np.cos(damped * t_s) + damping * omega / damped * np.sin(damped * t_s)
    return 1 - envelope * swing


@pytest.mark.parametrize("variant", ["stack", "flexure", "afm"])
def test_step_response_of_the_mode_is_its_formula(variant: str) -> None:
    """The response equals the textbook formula to 1e-9 of the step, over twenty periods."""
    plant = make_plant(variant, only=("mode",))
    stage = plant.parameters.stage
    position_um = run(plant, np.full(1000, stage.drive_v), GRID_NS).position_um
    t_s = np.arange(1, 1001) * 50e-6

    expected = mode_step(t_s, stage.mode_hz, stage.mode_damping)
    assert position_um / stage.travel_um == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("variant", "frequency_hz", "damping"),
    [("stack", 734, 0.03), ("flexure", 734, 0.015), ("light-damping", 400, 0.005)],
)
def test_ring_down_has_frequency_and_damping_of_the_variant(
    variant: str, frequency_hz: float, damping: float
) -> None:
    """Zero crossings of the ring-down give the frequency, its decrement gives the damping ratio."""
    plant = make_plant(variant, only=("mode",))
    ringing = run(plant, np.full(1000, 10.0), GRID_NS).position_um
    ringing = ringing / (plant.parameters.stage.travel_um * 10 / plant.parameters.stage.drive_v) - 1
    crossings = np.flatnonzero((ringing[:-1] < 0) & (ringing[1:] >= 0))
    exact = crossings - ringing[crossings] / (ringing[crossings + 1] - ringing[crossings])
    period_s = np.mean(np.diff(exact)) * 50e-6
    peaks = [ringing[a:b].max() for a, b in pairwise(crossings)]
    decrement = -np.polynomial.Polynomial.fit(range(len(peaks)), np.log(peaks), 1).convert().coef[1]

    assert 1 / period_s == pytest.approx(frequency_hz, rel=2e-3)
    assert decrement / (2 * np.pi) == pytest.approx(damping, rel=0.01)


def test_sample_is_late_by_the_delay() -> None:
    """A sample shows the ringing of 0.11 ms before, also at instants between sub-steps."""
    plant = make_plant(only=("mode", "delay"))
    stage, sensor = plant.parameters.stage, plant.parameters.sensor
    period_ns = 70_001
    sensor_v = run(plant, np.full(500, 150.0), period_ns).sensor_v
    t_s = np.arange(1, 501) * period_ns * 1e-9 - 0.11e-3

    shown = sensor_v / sensor.slope_v_per_um / stage.travel_um - 1 / 3
    expected = np.where(t_s > 0, mode_step(np.maximum(t_s, 0), 734, 0.03), 0)
    assert shown == pytest.approx(expected, abs=2e-5)


def test_longest_delay_that_can_be_configured_is_kept() -> None:
    """A delay of 2.2 ms fits into the buffer of sub-steps; a delay of 20 ms is refused."""
    parameters = parameters_of()
    seed = np.random.SeedSequence(1)
    longest = replace(parameters, sensor=replace(parameters.sensor, delay_s=2.2e-3))
    too_long = replace(parameters, sensor=replace(parameters.sensor, delay_s=20e-3))

    Plant(longest, seed)
    with pytest.raises(ValueError, match="a delay of 400 sub-steps"):
        Plant(too_long, seed)


@pytest.mark.parametrize(("frequency_hz", "gain_db"), [(50, 0), (500, -3.01), (1000, -12.30)])
def test_antialias_filter_is_a_butterworth_of_second_order(
    frequency_hz: float, gain_db: float
) -> None:
    """It attenuates by 3 dB at 500 Hz and by 12 dB per octave above."""
    plant = make_plant(only=("antialias",))
    phase = 2 * np.pi * frequency_hz * np.arange(4000) * 50e-6
    trace = run(plant, 75 + 60 * np.sin(phase), GRID_NS)
    late = slice(2000, None)
    carrier = np.exp(-1j * phase[late])
    light_v = trace.position_um[late] * plant.parameters.sensor.slope_v_per_um
    gain = abs(trace.sensor_v[late] @ carrier) / abs(light_v @ carrier)

    assert 20 * np.log10(gain) == pytest.approx(gain_db, abs=0.1)


def test_detector_is_a_low_pass_of_first_order() -> None:
    """The response to a step is exactly 1 - exp(-t / 15.9 µs)."""
    plant = make_plant(only=("sensor_bandwidth",))
    trace = run(plant, np.full(4, 150.0), GRID_NS)
    slope_v_per_um, t_s = plant.parameters.sensor.slope_v_per_um, np.arange(1, 5) * 50e-6

    # The step lies in the first sub-step, which the detector gets as a parabola that ends there.
    shown = 1 - (trace.sensor_v[1:] / slope_v_per_um - 10) / 30
    assert shown[1:] / shown[:-1] == pytest.approx(np.exp(-2 * np.pi * 1e4 * 50e-6), rel=1e-6)
    assert np.all(shown < np.exp(-2 * np.pi * 1e4 * (t_s[1:] - 50e-6)))


@pytest.mark.parametrize(
    ("drive_v", "name"),
    [
        (np.resize([150.0, 150.0, 150.0, 0.0, 0.0, 40.0], 600), "full steps"),
        (75 + 40 * np.sign(np.sin(2 * np.pi * 123 * np.arange(600) * 1e-3)), "square wave"),
        (75 - 75 * np.cos(2 * np.pi * 0.5 * np.arange(2000) * 1e-3), "slow sine"),
        (75 - 75 * np.cos(2 * np.pi * 50 * np.arange(600) * 1e-3), "fast sine"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("variant", ["stack", "flexure", "afm"])
def test_halving_the_sub_step_changes_nothing_that_matters(
    variant: str, drive_v: NDArray[np.float64], name: str
) -> None:
    """Displacement and reading change by less than 1e-4 of the range."""
    off = (*NOISE, "adc")
    coarse = make_plant(variant, off=off, sub_step_ns=50_000)
    fine = make_plant(variant, off=off, sub_step_ns=25_000)
    one, other = run(coarse, drive_v), run(fine, drive_v)
    range_v = coarse.ideal_reading_v(coarse.parameters.stage.travel_um) - coarse.ideal_reading_v(0)

    travel_um = coarse.parameters.stage.travel_um
    assert np.max(np.abs(one.position_um - other.position_um)) < 1e-4 * travel_um, name
    assert np.max(np.abs(one.sensor_v - other.sensor_v)) < 1e-4 * range_v, name


@pytest.mark.parametrize(
    ("variant", "change"),
    [("preisach-asymmetric", 1e-4), ("bouc-wen", 1e-4), ("dahl", 1e-4), ("thermal-relays", 2e-3)],
)
def test_sub_step_hardly_matters_for_other_classes_of_hysteresis(
    variant: str, change: float
) -> None:
    """Full steps and a fast sine change by 1e-4 of the travel, with thermal relays by 2e-3."""
    fast_sine = 75 - 75 * np.cos(2 * np.pi * 50 * np.arange(300) * 1e-3)
    drive_v = [*np.resize([150.0, 150.0, 0.0, 0.0, 40.0], 200), *fast_sine]
    off = (*NOISE, "adc")
    coarse, fine = (
        run(make_plant(variant, off=off, sub_step_ns=sub_step_ns), drive_v).position_um
        for sub_step_ns in (50_000, 25_000)
    )

    assert np.max(np.abs(coarse - fine)) < change * 30


@given(frequency_hz=st.floats(100, 5000), damping=st.floats(0.005, 0.9), x=st.floats(-1, 1))
def test_resting_mode_rests_and_parabola_is_followed(
    frequency_hz: float, damping: float, x: float
) -> None:
    """A mode at its static displacement stays there, for any frequency."""
    rows = mode(frequency_hz, damping, 50e-6)

    assert rows @ [x, 0, x, x, x] == pytest.approx([x, 0, 0], abs=1e-12)


@pytest.mark.parametrize("bandwidth_hz", [1e4, inf])
@pytest.mark.parametrize("antialias_hz", [500, inf])
def test_receiver_passes_steady_light_unchanged(bandwidth_hz: float, antialias_hz: float) -> None:
    """Detector and filter, each present or absent, have gain 1 and no offset."""
    rows = receiver(bandwidth_hz, antialias_hz, 50e-6)

    assert rows @ [2, 2, 0, 2, 0, 2, 0, 0] == pytest.approx([2, 2, 0], abs=1e-12)


def test_exponential_of_a_rotation_is_a_rotation() -> None:
    """The exponential of the generator rotates by its angle, also by a large one."""
    angle = 40.0
    turned = exponential(np.array([[0, -angle], [angle, 0]]))

    cos, sin = np.cos(angle), np.sin(angle)
    assert turned == pytest.approx(np.array([[cos, -sin], [sin, cos]]), abs=1e-12)
