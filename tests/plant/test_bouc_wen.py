"""The Bouc-Wen stage against its differential equation."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from piezod.plant.bouc_wen import risen
from piezod.plant.laws import BoucWen
from piezod.plant.plant import Plant

STATIC = ("hysteresis", "asymmetry")
ALPHA, BETA, GAMMA = 0.55, 2.0, 0.2  # α = (β+γ)/(2β)
PINNING = 4e-5
REVERSIBLE_UM, IRREVERSIBLE_UM = 16.1, 13.9


def moved(h: float, start: float, end: float, exponent: float) -> float:
    """Return h after a straight move of the drive, by numerical integration of the equation."""
    speed = end - start
    saturated = ALPHA / (BETA + GAMMA)

    def rate(_t: float, at: Any) -> Any:
        relaxing = np.abs(at / saturated) ** (exponent - 1)
        return ALPHA * speed - (BETA * abs(speed) * at + GAMMA * speed * np.abs(at)) * relaxing

    solution = solve_ivp(rate, (0.0, 1.0), [h], rtol=1e-10, atol=1e-12, max_step=0.02)
    return float(solution.y[0, -1])


def with_exponent(plant: Plant, exponent: float) -> Plant:
    """Return the same plant with another exponent n."""
    law = plant.parameters.hysteresis
    assert isinstance(law, BoucWen)
    changed = replace(plant.parameters, hysteresis=replace(law, exponent=exponent))
    return Plant(changed, np.random.SeedSequence(1))


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_stage_follows_the_differential_equation(
    make_plant: Callable[..., Plant], run: Callable[..., Any], exponent: float
) -> None:
    """Over 60 random turning points the displacement is that of scipy's `solve_ivp`."""
    plant = with_exponent(make_plant("bouc-wen", only=STATIC), exponent)
    units = np.random.default_rng(4).uniform(-0.06, 1.06, 60)
    # Saturated at the highest drive.
    h_at_rest = moved(ALPHA / (BETA + GAMMA), 1.2 - PINNING, PINNING, exponent)
    at_nominal = moved(h_at_rest, PINNING, 1.0 - PINNING, exponent)
    scale = IRREVERSIBLE_UM / (1.0 - at_nominal + h_at_rest)
    h, v, expected_um = h_at_rest, PINNING, []
    for unit in units:
        end = float(np.clip(v, unit - PINNING, unit + PINNING))
        h, v = moved(h, v, end, exponent), end
        expected_um.append(REVERSIBLE_UM * unit + scale * (unit - h + h_at_rest))
    actual_um = run(plant, 150 * units).position_um

    assert np.ptp(actual_um) > 25
    assert actual_um == pytest.approx(expected_um, abs=1e-6)


def test_noise_of_the_amplifier_does_not_erase_the_hysteresis(
    make_plant: Callable[..., Plant],
) -> None:
    """A stage that holds 75 V with the amplifier's noise moves by less than 5 nm in 10 s."""
    plant = make_plant("bouc-wen", only=(*STATIC, "amplifier_noise", "amplifier_bandwidth"))
    plant.command(75.0)
    plant.advance_to(100_000_000)
    before_um = plant.true_displacement_um
    plant.advance_to(10_000_000_000)

    assert plant.true_displacement_um == pytest.approx(before_um, abs=5e-3)


@pytest.mark.parametrize(("exponent", "rounding"), [(1.0, 1e-12), (2.0, 1e-8)])
@given(g=st.floats(-0.25, 0.25), rise=st.floats(0, 1.4), share=st.floats(0, 1))
def test_division_of_a_move_changes_nothing(
    exponent: float, rounding: float, g: float, rise: float, share: float
) -> None:
    """One move equals two that follow each other in the same direction."""
    law = (BETA, GAMMA, exponent)
    halfway = risen(g, share * rise, *law)

    assert risen(halfway, (1 - share) * rise, *law) == pytest.approx(
        risen(g, rise, *law), abs=rounding
    )


def test_stage_has_no_memory_of_turning_points(
    make_plant: Callable[..., Plant], run: Callable[..., Any]
) -> None:
    """A minor loop within a rise does not close: no Preisach model describes this stage."""
    plant = make_plant("bouc-wen", only=STATIC)
    before, _, after = run(plant, [90.0, 60.0, 90.0]).position_um

    assert abs(after - before) > 0.01 * 30


@pytest.mark.parametrize("exponent", [1.0, 2.0])
@given(drives=st.lists(st.floats(0, 1), min_size=2, max_size=10))
def test_displacement_rises_with_the_drive(
    make_plant: Callable[..., Plant],
    run: Callable[..., Any],
    exponent: float,
    drives: list[float],
) -> None:
    """On every branch the displacement moves in the direction of the drive."""
    units = np.array([0.0, *drives])
    plant = with_exponent(make_plant("bouc-wen", only=STATIC), exponent)
    position_um = run(plant, 150 * units).position_um

    assert np.all(np.diff(position_um) * np.diff(units) >= 0)
