"""The stage of thermally activated relays: its rate dependence, against relays solved exactly."""

from typing import Any

import numpy as np
import pytest

from piezod.plant.layout import constants
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from tests.plant.plants import make_plant, run

STATIC = ("hysteresis", "asymmetry")
LAW: Any = VARIANTS["thermal-relays"].parameters.hysteresis


def loop(plant: Plant, frequency_hz: float) -> tuple[Any, Any]:
    """Return drives and displacements of the second of two triangles over the whole range."""
    samples = 1000
    phase = np.arange(1, 2 * samples + 1) / samples
    drive_v = 150 * (1 - np.abs(phase % 1 * 2 - 1))
    trace = run(plant, drive_v, round(1e9 / frequency_hz / samples)).position_um
    return drive_v[samples:], trace[samples:]


def width_pct(plant: Plant, frequency_hz: float) -> float:
    """Return the width of the loop at a frequency, in % of its displacement."""
    drive_v, position_um = loop(plant, frequency_hz)
    half = len(drive_v) // 2
    at_v = np.linspace(2, 148, 147)
    rising = np.interp(at_v, drive_v[:half], position_um[:half])
    falling = np.interp(at_v, drive_v[half:][::-1], position_um[half:][::-1])
    return float(100 * np.max(falling - rising) / np.ptp(position_um))


def test_loop_widens_with_the_rate() -> None:
    """From 0.1 to 1 to 10 Hz the loop widens by 1 to 2 % of the swing each, and is 15 % at 1 Hz."""
    slow, middle, fast = (
        width_pct(make_plant("thermal-relays", only=STATIC, sub_step_ns=sub_step_ns), frequency_hz)
        for frequency_hz, sub_step_ns in ((0.1, 200_000), (1.0, 50_000), (10.0, 50_000))
    )

    assert middle == pytest.approx(15.0, abs=1.0)
    assert 1.0 < middle - slow < 2.0
    assert 1.0 < fast - middle < 2.0


def test_loop_of_a_static_class_does_not_depend_on_the_rate() -> None:
    """The Preisach stage of the same density has one loop at all rates."""
    slow, fast = (
        width_pct(make_plant("preisach-exponential", only=STATIC), frequency_hz)
        for frequency_hz in (0.1, 10.0)
    )

    assert slow == pytest.approx(fast, abs=1e-6)


def test_relays_follow_their_rate_equation() -> None:
    """In loops of 10 Hz the displacement is that of an exact solution, to 1e-3 of the travel.

    A command is constant for 1 ms, so the exact solution is one exponential for each relay.
    """
    record: Any = constants(VARIANTS["thermal-relays"].parameters, 50e-6)[0]
    cell, offset = record["cell"], -np.log(record["spread"]) * LAW.activation
    alpha, beta = cell[:, None] + offset[None, :], cell[None, :] + offset[:, None]
    up, weight = record["relays_at_rest"].copy(), record["relay_weight"]
    rest = np.sum(weight * up)
    turns_s, turns = [0.0, 0.05, 0.1, 0.13, 0.16, 0.24, 0.3], [0, 1, 0.2, 0.7, 0.3, 1, 0]
    units = np.interp(np.arange(1, 301) * 1e-3, turns_s, turns)
    expected_um = []
    for unit in units:
        to_up = LAW.attempts_hz * np.exp((unit - alpha) / LAW.activation)
        rate = to_up + LAW.attempts_hz * np.exp((beta - unit) / LAW.activation)
        up = to_up / rate + (up - to_up / rate) * np.exp(-rate * 1e-3)
        expected_um.append(15.7 * unit + 14.3 * (np.sum(weight * up) - rest))
    actual_um = run(make_plant("thermal-relays", only=STATIC), 150 * units).position_um

    assert np.ptp(actual_um) > 25
    assert actual_um == pytest.approx(expected_um, abs=1e-3 * 30)


def test_no_relay_is_below_the_diagonal() -> None:
    """The 820 relays have weights that fall with their width; the others have none."""
    weight: Any = constants(VARIANTS["thermal-relays"].parameters, 50e-6)["relay_weight"][0]

    assert np.all(np.triu(weight, 1) == 0)
    assert np.count_nonzero(weight) == 820
    assert np.all(np.diff(weight[-1, :-1]) > 0)
