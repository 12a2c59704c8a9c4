"""Preisach stages with a density of relays, against the relays themselves."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from piezod.plant.laws import ExponentialDensity, GaussianDensity
from piezod.plant.layout import constants
from piezod.plant.preisach import everett, tabulated
from piezod.plant.variants import VARIANTS
from tests.plant.plants import make_plant, run

STATIC = ("hysteresis", "asymmetry")
DENSITIES = ("preisach-exponential", "preisach-gaussian", "preisach-asymmetric")
PLANTS = {name: constants(VARIANTS[name].parameters, 50e-6) for name in DENSITIES}
DRIVE = st.floats(-0.2, 1.2)
LEVEL = st.floats(0, 1)
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(300)
AT, SHARE = (POINTS + 1) / 2, WEIGHTS / 2


def density(variant: str, upper: Any, lower: Any) -> Any:
    """Return the density of relays from its formula, to a constant factor."""
    width, middle = np.maximum(upper - lower, 1e-9), (upper + lower) / 2
    law = VARIANTS[variant].parameters.hysteresis
    if isinstance(law, GaussianDensity):
        coercive = np.exp(-(np.log(width / 0.4) ** 2) / 2) / width
        return coercive * np.exp(-((middle - 0.5) ** 2) / (2 * 0.5**2))
    assert isinstance(law, ExponentialDensity)
    asymmetry = {"preisach-exponential": 0.0, "preisach-asymmetric": 2.15}[variant]
    return np.exp(-width / 0.5 + asymmetry * middle)


def integral(variant: str, lower: float, upper: float) -> float:
    """Integrate the density over the relays that switch between two drives."""
    alpha = lower + (upper - lower) * AT
    beta = lower + np.outer(alpha - lower, AT)
    inner = (alpha - lower) * (density(variant, alpha[:, None], beta) @ SHARE)
    return float((upper - lower) * (inner @ SHARE))


class Relays:
    """A sum of relays that are up or down, with thresholds between the drives of a grid.

    The cells of the grid go from -0.2 to 1.2 nominal drives.
    """

    def __init__(self, variant: str, cells: int = 560) -> None:
        size = 1.4 / cells
        at = -0.2 + size * (np.arange(cells) + 0.5)
        upper, lower = at[:, None], at[None, :]
        self.upper, self.lower = np.broadcast_arrays(upper, lower)
        weight = np.tril(density(variant, np.maximum(upper - lower, size / 3) + lower, lower))
        weight[np.diag_indices(cells)] /= 2
        stage = VARIANTS[variant].parameters.stage
        self.reversible_um = stage.reversible_um
        self.weight_um = weight * stage.irreversible_um / integral(variant, 0.0, 1.0) * size**2
        self.up = lower + 0 * upper < 0.0  # came down from the highest drive to 0
        self.rest_um = float(np.sum(self.weight_um[self.up]))

    def drive(self, unit: float) -> float:
        """Switch the relays at a drive and return the displacement from rest, in µm."""
        self.up = (self.up | (self.upper < unit)) & ~(self.lower > unit)
        part_um = float(np.sum(self.weight_um[self.up])) - self.rest_um
        return self.reversible_um * unit + part_um


@pytest.mark.parametrize("variant", DENSITIES)
@given(ends=st.tuples(DRIVE, DRIVE))
def test_table_is_the_integral_of_the_density(variant: str, ends: tuple[float, float]) -> None:
    """The Everett function equals the direct integral to 1e-6 of its full value."""
    lower, upper = sorted(ends)
    expected = integral(variant, lower, upper) / integral(variant, 0.0, 1.0)

    assert tabulated(upper, lower, PLANTS[variant]) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("variant", DENSITIES)
def test_stage_is_the_sum_of_its_relays(variant: str) -> None:
    """Over 300 random turning points the displacement is that of 157,000 relays, to 1e-4."""
    units = np.random.default_rng(3).integers(-26, 427, 300) / 400  # on the grid of the relays
    relays = Relays(variant)
    expected_um = [relays.drive(unit) for unit in units]
    actual_um = run(make_plant(variant, only=STATIC), 150 * units).position_um

    assert np.ptp(actual_um) > 25
    assert actual_um == pytest.approx(expected_um, abs=1e-4 * 30)


@pytest.mark.parametrize("variant", DENSITIES)
@given(levels=st.lists(LEVEL, min_size=2, max_size=12), inner=st.tuples(LEVEL, LEVEL))
def test_closed_minor_loop_is_wiped_out(
    variant: str, levels: list[float], inner: tuple[float, float]
) -> None:
    """After any history, a loop within the last swing leaves no trace."""
    before, last = levels[-2:]
    one, other = (150 * (before + (last - before) * share) for share in inner)
    history = [150 * level for level in levels]
    plain = run(make_plant(variant, only=STATIC), [*history, 150 * before]).position_um[-2:]
    with_loop = make_plant(variant, only=STATIC)
    run(with_loop, [*history, 150 * before, one, other, one])
    actual = run(with_loop, [150 * last, 150 * before]).position_um

    assert actual == pytest.approx(plain, abs=1e-5 * 30)


@pytest.mark.parametrize("variant", DENSITIES)
@given(levels=st.lists(LEVEL, max_size=8), ends=st.tuples(LEVEL, LEVEL))
def test_minor_loops_are_congruent(
    variant: str, levels: list[float], ends: tuple[float, float]
) -> None:
    """Loops between the same drives have the same shape for any history."""
    low, high = (150 * end for end in sorted(ends))
    path = [low, high, *np.linspace(high, low, 7), *np.linspace(low, high, 7)]
    fresh = run(make_plant(variant, only=STATIC), path).position_um[2:]
    later = run(make_plant(variant, only=STATIC), [*(150 * u for u in levels), *path]).position_um
    later = later[len(levels) + 2 :]

    assert later - later[0] == pytest.approx(fresh - fresh[0], abs=1e-5 * 30)


@pytest.mark.parametrize("variant", DENSITIES)
@given(corners=st.tuples(*4 * (DRIVE,)))
def test_tabulated_density_is_nowhere_negative(
    variant: str, corners: tuple[float, float, float, float]
) -> None:
    """The share of relays in every rectangle is not negative but for the interpolation's error."""
    plant = PLANTS[variant]
    b1, b2, a1, a2 = sorted(corners)
    outer = everett(a2, b1, plant) - everett(a2, b2, plant)

    assert outer - everett(a1, b1, plant) + everett(a1, b2, plant) >= -1e-6


def test_small_loops_tell_the_densities_apart() -> None:
    """A loop of 5 % swing is 0.5 % wide with few narrow relays and 2.9 % with many."""

    def width_pct(variant: str) -> float:
        plant = PLANTS[variant]
        rise, half = everett(0.525, 0.475, plant), everett(0.5, 0.475, plant)
        return 100 * (rise - half - everett(0.525, 0.5, plant)) / rise

    assert width_pct("preisach-gaussian") == pytest.approx(0.5, abs=0.1)
    assert width_pct("preisach-exponential") == pytest.approx(2.9, abs=0.1)
