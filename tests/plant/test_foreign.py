"""The stages of classes that no model has, against their equations."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from piezod.plant.foreign import INNER, foreign_constants, raw_part
from piezod.plant.foreign_laws import ColemanHodgdon, Duhem, ForeignLaw, MaxwellSlip, RatePlays
from piezod.plant.variants import VARIANTS
from tests.plant.plants import make_plant, run

CLASSES = ("coleman-hodgdon", "duhem", "maxwell-slip", "rate-plays", "bipolar")
STATIC = ("hysteresis", "asymmetry")


class Part:
    """A class that is moved from rest, slowly or with a rate."""

    def __init__(self, law: ForeignLaw) -> None:
        known = foreign_constants(law, 1.2)
        self.inner, self.facts = known["inner_at_rest"].copy(), known["facts"]
        self._law, self._at_rest = known["law"], known["part_at_rest"]

    def move(self, unit: float, rate: float = 0.0) -> float:
        """Move the drive within a second; return the displacement since rest, in its own unit."""
        raw = raw_part(unit, 1.0, rate, self._law, self.inner, self.facts)
        return float(raw - self._at_rest)


def test_coleman_hodgdon_follows_its_equation() -> None:
    """Over 30 random turning points the state is that of scipy's `solve_ivp`."""

    def rate(u: float, y: Any, way: float) -> Any:
        s = u - 0.5
        g = np.cosh(0.8 * s) ** -2 * (1.0 - 0.5 * np.exp(-(s**2)))
        return g + np.sign(way) * 4.0 * (np.tanh(0.8 * s) / 0.8 - y)

    part = Part(ColemanHodgdon())
    y, before = part.inner[0], part.inner[INNER - 1]
    for unit in np.random.default_rng(2).uniform(0, 1, 30).tolist():
        after = min(max(before, unit - 4e-5), unit + 4e-5)
        way = after - before
        solution = solve_ivp(rate, (before, after), [y], args=(way,), rtol=1e-10, atol=1e-12)
        y, before = solution.y[0, -1], after
        part.move(unit)

        assert part.inner[0] == pytest.approx(y, abs=1e-7)


def test_states_of_duhem_relax_faster_in_a_fall() -> None:
    """On a rise and on a fall the slow state approaches its own end, with its own length."""
    part = Part(Duhem())
    part.move(0.5)
    for unit, rate in ((0.6, 1.6), (0.5, -2.2)):
        before, at = part.inner[0], part.inner[INNER - 1]
        part.move(unit)
        way = abs(part.inner[INNER - 1] - at)
        expected = 1 / rate + (before - 1 / rate) * np.exp(-abs(rate) * way)

        assert part.inner[0] == pytest.approx(expected, abs=1e-12)


def test_maxwell_slip_at_rest_is_ten_stops() -> None:
    """At rate 0 each force follows the drive within its static limit."""
    part, limits = Part(MaxwellSlip()), 0.5 * (np.arange(1, 11) / 10) ** 1.5 * 1.2
    forces, before = -limits, 0.0
    for unit in np.concatenate((np.linspace(0, 1, 400), np.linspace(1, 0.3, 300))).tolist():
        forces = np.clip(forces + unit - before, -limits, limits)
        before = unit

        assert part.move(unit) == pytest.approx(unit - np.mean(forces) - np.mean(limits), abs=1e-9)


@pytest.mark.parametrize(("rate", "decades"), [(0.9, 1), (99.9, 3), (999.9, 4)])
def test_plays_widen_by_15_pct_per_decade_of_rate(rate: float, decades: int) -> None:
    """Each threshold grows by 15 % of its value at rest per decade above 0.1 per second."""
    part = Part(RatePlays())
    part.move(1.0, rate)
    thresholds = 0.5 * (np.arange(20) + 0.5) / 20

    widened = thresholds * (1 + 0.15 * decades)

    # The widest ones do not move: they stay where the way down has left them.
    assert part.inner[:20] == pytest.approx(np.maximum(1 - widened, thresholds), abs=1e-12)


def test_slip_has_a_smaller_limit_in_fast_motion() -> None:
    """Far above the Stribeck rate forces end at their sliding limit, at rest 20 % above it."""
    limits = 0.5 * (np.arange(1, 11) / 10) ** 1.5 / 10
    for rate, factor in ((0.0, 1.2), (100.0, 1.0)):
        part = Part(MaxwellSlip())
        for unit in np.linspace(0, 1.2, 600).tolist():
            part.move(unit, rate)

        assert part.inner[:10] == pytest.approx(factor * limits, abs=1e-12)


def test_rate_of_the_drive_is_its_mean_over_5_ms() -> None:
    """On the way up a triangle of 10 Hz moves by 20 nominal drives per second."""
    plant = make_plant("rate-plays", only=STATIC)
    run(plant, 150 * np.arange(1, 201) / 250, 200_000)

    assert plant._state["rate"][0] == pytest.approx(20.0, rel=0.05)  # noqa: SLF001 - no reader


@pytest.mark.parametrize("variant", CLASSES)
@given(drives=st.lists(st.floats(0, 1), min_size=2, max_size=8))
def test_displacement_rises_with_the_drive(variant: str, drives: list[float]) -> None:
    """In slow motion the displacement moves in the direction of the drive on every branch."""
    law: Any = VARIANTS[variant].parameters.hysteresis
    part = Part(replace(law, growth=0.0) if isinstance(law, RatePlays) else law)
    moved = [part.move(unit) for unit in (0.0, *drives)]

    assert np.all(np.diff(moved) * np.diff([0.0, *drives]) >= -1e-9)
