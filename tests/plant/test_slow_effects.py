"""Creep, and the drift of the return point."""

import numpy as np
import pytest

from tests.plant.plants import make_plant, run

STATIC = ("hysteresis", "asymmetry")


def test_creep_is_one_percent_per_decade_over_four_decades() -> None:
    """After a step the displacement follows 1 + 0.01·log10(t / 0.1 s) from 0.1 s to 1000 s."""
    plant = make_plant(only=("hysteresis", "creep"), sub_step_ns=1_000_000)
    plant.command(100.0)
    t_s = 10.0 ** np.arange(-1, 3.1, 0.25)
    position_um = []
    for instant_s in t_s:
        plant.advance_to(round(instant_s * 1000) * 1_000_000)
        position_um.append(plant.true_displacement_um)

    expected = 1 + 0.01 * np.log10(t_s / 0.1)
    assert np.array(position_um) / position_um[0] == pytest.approx(expected, abs=3e-4)


def test_creep_leaves_the_travel_as_it_is_after_a_tenth_of_a_second() -> None:
    """The static displacement is the displacement 0.1 s after a step."""
    static, creeping = make_plant(only=STATIC), make_plant(only=(*STATIC, "creep"))
    for plant in (static, creeping):
        plant.command(100.0)
        plant.advance_to(100_000_000)

    assert creeping.true_displacement_um == pytest.approx(static.true_displacement_um, rel=1e-6)


@pytest.mark.parametrize(("variant", "drift_pct"), [("stack", 0.5), ("flexure", 3.7), ("afm", 0.5)])
def test_bottom_turning_point_drifts_while_the_swing_grows(variant: str, drift_pct: float) -> None:
    """Swings that grow for 2.5 s and all return to 0 V end at a drifting displacement."""
    plant = make_plant(variant, only=(*STATIC, "drift"))
    stage = plant.parameters.stage
    t_s = np.arange(1, 15_001) * 1e-3
    swing_v = stage.drive_v * np.minimum(t_s / 2.5, 1)
    trace = run(plant, swing_v * (1 - np.cos(2 * np.pi * 2 * t_s)) / 2)
    bottoms_pct = 100 * trace.position_um[499::500] / stage.travel_um

    assert bottoms_pct[0] < 0.15 * drift_pct
    assert np.all(np.diff(bottoms_pct)[:12] > 0)
    assert bottoms_pct[-1] == pytest.approx(drift_pct, rel=0.03)


def test_drift_breaks_return_point_memory() -> None:
    """After a closed minor loop the flexure stage has moved; without drift it has not."""
    path = [90, *np.full(1000, 170), 90]
    still = run(make_plant("flexure", only=STATIC), [170, 90, *path]).position_um
    drifting = run(make_plant("flexure", only=(*STATIC, "drift")), [170, 90, *path]).position_um

    assert still[-1] == pytest.approx(still[1], abs=1e-12)
    assert drifting[-1] - drifting[1] > 0.2


def test_drift_is_forgotten_at_rest() -> None:
    """Ten minutes at 0 V bring the return point back."""
    plant = make_plant("flexure", only=(*STATIC, "drift"), sub_step_ns=1_000_000)
    plant.command(180.0)
    plant.advance_to(20_000_000_000)
    plant.command(0.0)
    plant.advance_to(620_000_000_000)

    assert plant.true_displacement_um == pytest.approx(0, abs=1e-3)
