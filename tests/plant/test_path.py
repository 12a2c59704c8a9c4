"""The stages that forget along the path, Bouc-Wen and Dahl, against their equations."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from piezod.plant.bouc_wen import risen
from piezod.plant.dahl import approached
from piezod.plant.laws import BoucWen, Dahl
from piezod.plant.plant import Plant
from tests.plant.plants import make_plant, run

VARIANTS = ("bouc-wen", "dahl")
STATIC = ("hysteresis", "asymmetry")
ALPHA, BETA, GAMMA = 0.55, 2.0, 0.2  # α = (β+γ)/(2β)
PINNING = 4e-5


Rate: TypeAlias = Callable[[Any, float], Any]  # dh/dt from h and the speed of the drive


def bouc_wen(exponent: float) -> Rate:
    """Return the equation of Bouc and Wen."""

    def rate(h: Any, speed: float) -> Any:
        relaxing = np.abs(h / (ALPHA / (BETA + GAMMA))) ** (exponent - 1)
        return ALPHA * speed - (BETA * abs(speed) * h + GAMMA * speed * np.abs(h)) * relaxing

    return rate


def dahl(h: Any, speed: float) -> Any:
    """Return dh/dt of the equation of Dahl, with a saturation of h/α of 1."""
    return 0.5 * speed * (1 - h / 0.5 * np.sign(speed)) ** 2


def moved(rate: Rate, h: float, start: float, end: float) -> float:
    """Return h after a straight move of the drive, by numerical integration of an equation."""
    solution = solve_ivp(
        lambda _t, at: rate(at, end - start), (0, 1), [h], rtol=1e-10, atol=1e-12, max_step=0.02
    )
    return float(solution.y[0, -1])


def plant_of(variant: str, law: BoucWen | Dahl) -> Plant:
    """Return a plant with its hysteresis only, and with other parameters of that."""
    parameters = make_plant(variant, only=STATIC).parameters
    return Plant(replace(parameters, hysteresis=law), np.random.SeedSequence(1))


@pytest.mark.parametrize(
    ("variant", "law", "rate", "h_saturated", "irreversible_um"),
    [
        ("bouc-wen", BoucWen(), bouc_wen(1), 0.25, 13.9),
        ("bouc-wen", BoucWen(exponent=2.0), bouc_wen(2), 0.25, 13.9),
        ("dahl", Dahl(), dahl, 0.5, 15.4),
    ],
)
def test_stage_follows_the_differential_equation(
    variant: str, law: BoucWen | Dahl, rate: Rate, h_saturated: float, irreversible_um: float
) -> None:
    """Over 60 random turning points the displacement is that of scipy's `solve_ivp`."""
    units = np.random.default_rng(4).uniform(-0.06, 1.06, 60)
    h_at_rest = moved(rate, h_saturated, 1.2 - PINNING, PINNING)
    at_nominal = moved(rate, h_at_rest, PINNING, 1.0 - PINNING)
    scale = irreversible_um / (1.0 - at_nominal + h_at_rest)
    h, v, expected_um = h_at_rest, PINNING, []
    for unit in units:
        end = float(np.clip(v, unit - PINNING, unit + PINNING))
        h, v = moved(rate, h, v, end), end
        expected_um.append((30 - irreversible_um) * unit + scale * (unit - h + h_at_rest))
    actual_um = run(plant_of(variant, law), 150 * units).position_um

    assert np.ptp(actual_um) > 25
    assert actual_um == pytest.approx(expected_um, abs=1e-6)


@pytest.mark.parametrize("variant", VARIANTS)
def test_noise_of_the_amplifier_does_not_erase_the_hysteresis(variant: str) -> None:
    """A stage that holds 75 V with the amplifier's noise moves by less than 5 nm in 10 s."""
    plant = make_plant(variant, only=(*STATIC, "amplifier_noise", "amplifier_bandwidth"))
    plant.command(75.0)
    plant.advance_to(100_000_000)
    before_um = plant.true_displacement_um
    plant.advance_to(10_000_000_000)

    assert plant.true_displacement_um == pytest.approx(before_um, abs=5e-3)


@pytest.mark.parametrize(
    ("after", "rounding"),
    [
        (partial(risen, beta=BETA, gamma=GAMMA, exponent=1.0), 1e-12),
        (partial(risen, beta=BETA, gamma=GAMMA, exponent=2.0), 1e-8),
        (partial(approached, saturated=1.0), 1e-12),
    ],
    ids=["bouc-wen", "bouc-wen, exponent 2", "dahl"],
)
@given(g=st.floats(-0.25, 0.25), rise=st.floats(0, 1.4), share=st.floats(0, 1))
def test_division_of_a_move_changes_nothing(
    after: Callable[..., float], rounding: float, g: float, rise: float, share: float
) -> None:
    """One move equals two that follow each other in the same direction."""
    in_two = after(g=after(g=g, rise=share * rise), rise=(1 - share) * rise)

    assert in_two == pytest.approx(after(g=g, rise=rise), abs=rounding)


@pytest.mark.parametrize("variant", VARIANTS)
def test_stage_has_no_memory_of_turning_points(variant: str) -> None:
    """A minor loop within a rise does not close: no Preisach model describes this stage."""
    plant = make_plant(variant, only=STATIC)
    before, _, after = run(plant, [90.0, 60.0, 90.0]).position_um

    assert abs(after - before) > 0.01 * 30


@pytest.mark.parametrize(
    ("variant", "law"),
    [("bouc-wen", BoucWen()), ("bouc-wen", BoucWen(exponent=2.0)), ("dahl", Dahl())],
)
@given(drives=st.lists(st.floats(0, 1), min_size=2, max_size=10))
def test_displacement_rises_with_the_drive(
    variant: str, law: BoucWen | Dahl, drives: list[float]
) -> None:
    """On every branch the displacement moves in the direction of the drive."""
    units = np.array([0.0, *drives])
    position_um = run(plant_of(variant, law), 150 * units).position_um

    assert np.all(np.diff(position_um) * np.diff(units) >= 0)
