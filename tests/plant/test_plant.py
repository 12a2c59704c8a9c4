"""The whole plant: time, seeds, and the switch of every effect."""

from dataclasses import fields, replace
from math import isfinite, isinf
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.errors import DeviceError
from piezod.plant.effects import EFFECTS, without
from piezod.plant.parameters import PlantParameters, quantities, specimen
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from tests.plant.plants import make_plant, parameters_of, run

SWEEP_V = 75 - 75 * np.cos(2 * np.pi * 5 * np.arange(400) * 1e-3)
# Steps beyond every limit, holds for the slow effects, and returns for the memory.
STIMULUS_V = np.concatenate([[175.0, -25.0, 0.0], np.full(300, 90.0), [20.0, 90.0], SWEEP_V])
# One command per sub-step, for effects that are over within a millisecond.
FAST_STIMULUS_V = np.array([90.0, 90.0, 10.0, 90.0])
PARTS = ("stage", "amplifier", "sensor", "hysteresis")


def bright(parameters: PlantParameters) -> PlantParameters:
    """Return the plant with enough light to saturate its sensor."""
    return replace(parameters, sensor=replace(parameters.sensor, light_level=3.0))


def readings(parameters: PlantParameters) -> Any:
    """Return the sensor readings of a plant during the stimulus."""
    plant = Plant(bright(parameters), np.random.SeedSequence(1))
    slow, fast = run(plant, STIMULUS_V), run(plant, FAST_STIMULUS_V, 50_000)
    return np.concatenate([slow.sensor_v, fast.sensor_v])


def test_plant_without_effects_is_a_straight_line() -> None:
    """With every effect off the reading is the drive times a gain plus an offset, without delay."""
    drive_v = np.concatenate([STIMULUS_V, FAST_STIMULUS_V])
    expected_v = 3 * 0.11 * (10 + 30 * drive_v / 150)

    assert readings(parameters_of(only=())) == pytest.approx(expected_v, rel=1e-12)


@pytest.mark.parametrize("effect", sorted(set(EFFECTS) - {"asymmetry"}))
def test_switch_of_an_effect_works_both_ways(effect: str) -> None:
    """A single effect changes the reading; switched off too, it leaves the plain plant."""
    ideal, alone = readings(parameters_of(only=())), readings(parameters_of(only=(effect,)))
    off_again = readings(without(parameters_of(only=(effect,)), [effect]))

    assert np.max(np.abs(alone - ideal)) > 1e-4
    assert np.array_equal(off_again, ideal)


def test_switch_of_the_asymmetry_works() -> None:
    """Without asymmetry the falling branch is the point reflection of the rising branch."""
    drive_v = np.concatenate([np.arange(0, 151), np.arange(149, -1, -1)])
    even, skewed = (
        run(make_plant(only=only), drive_v).position_um
        for only in (["hysteresis"], ["hysteresis", "asymmetry"])
    )

    assert even[:151] == pytest.approx(30 - even[150:], abs=1e-9)
    assert np.max(np.abs(skewed[:151] - (30 - skewed[150:]))) > 0.03 * 30


def test_effect_that_does_not_exist_is_refused() -> None:
    """A misspelt effect raises an error."""
    with pytest.raises(KeyError, match="gravity"):
        without(PlantParameters(), ["gravity"])


def test_same_seed_gives_the_same_result_to_the_bit() -> None:
    """Two plants of one seed agree in every value; another seed has other noise."""
    one, same, other = (run(make_plant(seed=seed), SWEEP_V) for seed in (1, 1, 2))

    assert np.array_equal(one, same)
    assert not np.array_equal(one.sensor_v, other.sensor_v)


def test_dividing_the_time_differently_changes_nothing() -> None:
    """A millisecond in one call or in five gives the same result to the bit."""
    one = run(make_plant(), SWEEP_V)
    five = run(make_plant(), np.repeat(SWEEP_V, 5), 200_000)

    assert np.array_equal(one.sensor_v, five.sensor_v[4::5])
    assert np.array_equal(one.position_um, five.position_um[4::5])


def test_long_wait_is_the_same_as_many_short_ones() -> None:
    """A second in one call equals a second in milliseconds."""
    one, many = make_plant(), make_plant()
    for plant in (one, many):
        plant.command(60.0)
    one.advance_to(1_000_000_000)
    for t_ns in range(0, 1_000_000_001, 1_000_000):
        many.advance_to(t_ns)

    assert one.sample() == many.sample()


def test_time_does_not_go_back() -> None:
    """A call for an earlier time is refused and changes nothing; the same time is allowed."""
    plant = make_plant()
    plant.advance_to(1_000_000)
    with pytest.raises(DeviceError, match="time went back from 1000000 ns to 999999 ns"):
        plant.advance_to(999_999)
    plant.advance_to(1_000_000)

    assert plant.now_ns == 1_000_000


def test_command_acts_from_the_next_sub_step_on() -> None:
    """A command between two sub-steps acts from the next one, so that nothing happens too early."""
    plant = make_plant(only=())
    plant.advance_to(60_000)
    plant.command(100.0)
    plant.advance_to(100_000)
    before_v = plant.drive_v
    plant.advance_to(100_001)

    assert (before_v, plant.drive_v) == (0.0, 100.0)


def test_plant_begins_at_rest() -> None:
    """Before the first command displacement and output are zero, and the sensor reads its gap."""
    plant = make_plant(off=("sensor_noise", "amplifier_noise"))
    plant.advance_to(10_000_000)

    assert (plant.true_displacement_um, plant.drive_v, plant.dropped_turns) == (0.0, 0.0, 0)
    assert plant.sample() == pytest.approx(plant.ideal_reading_v(0.0), abs=20 / 2**17)


@pytest.mark.parametrize("part", PARTS)
def test_specimens_vary_by_ten_percent(part: str) -> None:
    """Over 300 seeds each varying parameter covers 0.9 to 1.1 of its value; others stay."""
    nominal = getattr(VARIANTS["stack"].parameters, part)
    drawn = [
        getattr(specimen(VARIANTS["stack"].parameters, np.random.SeedSequence(seed)), part)
        for seed in range(300)
    ]
    for name, quantity in quantities(type(nominal)).items():
        value = getattr(nominal, name)
        factors = [getattr(each, name) / value for each in drawn] if value else [1.0]
        if quantity.varies and value:
            assert 0.9 <= min(factors) < 0.91, name
            assert 1.09 < max(factors) <= 1.1, name
        else:
            assert set(factors) == {1.0}, name


def test_specimen_is_determined_by_its_seed() -> None:
    """Equal seeds draw equal specimens."""
    one, same, other = (
        specimen(PlantParameters(), np.random.SeedSequence(seed)) for seed in (7, 7, 8)
    )

    assert one == same
    assert one != other


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("part", PARTS)
def test_parameters_of_variants_are_within_their_bounds(variant: str, part: str) -> None:
    """The parameters of the variants obey the limits; infinity stands for an absent filter."""
    nominal = getattr(VARIANTS[variant].parameters, part)
    for name, quantity in quantities(type(nominal)).items():
        value = getattr(nominal, name)
        absent = (variant, name) == ("no-antialias", "antialias_hz") and isinf(value)
        assert absent or quantity.low <= value <= quantity.high, name
        assert quantity.about, name


def test_every_parameter_is_described() -> None:
    """Each field of each part has a range and a meaning."""
    kinds = {type(getattr(v.parameters, part)) for v in VARIANTS.values() for part in PARTS}
    for kind in kinds:
        assert list(quantities(kind)) == [item.name for item in fields(kind)]


@given(
    drive_v=st.lists(st.floats(-200, 200), min_size=1, max_size=20),
    variant=st.sampled_from(sorted(VARIANTS)),
)
def test_no_drive_breaks_the_plant(drive_v: list[float], variant: str) -> None:
    """For any command, displacement, output and reading stay finite."""
    plant = make_plant(variant)
    for k, command_v in enumerate(drive_v):
        plant.command(command_v)
        plant.advance_to((k + 1) * 777_777)

    assert all(map(isfinite, (plant.true_displacement_um, plant.drive_v, plant.sample())))
