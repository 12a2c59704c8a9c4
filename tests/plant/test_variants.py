"""Facts that hold for all simulated stages, and the single difficulty of some of them."""

from dataclasses import replace
from math import isfinite
from typing import Any

import numpy as np
import pytest

from piezod.devices.interface import Wiring
from piezod.plant.effects import EFFECTS, without
from piezod.plant.laws import PowerLaw
from piezod.plant.parameters import specimen
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.plant.plants import make_plant, run

MS = 1_000_000
STATIC = ("hysteresis", "asymmetry")
OTHER_CLASSES = [n for n, v in VARIANTS.items() if v.parameters.hysteresis != PowerLaw()]
STEPS = 500
TRIANGLE = 1 - np.abs(np.arange(1, 2 * STEPS + 1) / STEPS - 1)
INSIDE = np.linspace(0.01, 0.99, 99)


def branches(plant: Plant) -> tuple[Any, Any]:
    """Return the branches of the full loop at 1 Hz over `INSIDE`, in displacements of the loop."""
    drive_v = plant.parameters.stage.drive_v * np.tile(TRIANGLE, 2)
    position_um = run(plant, drive_v).position_um[2 * STEPS :]
    position = (position_um - position_um.min()) / np.ptp(position_um)
    rising = np.interp(INSIDE, TRIANGLE[:STEPS], position[:STEPS])
    falling = np.interp(INSIDE, TRIANGLE[STEPS:][::-1], position[STEPS:][::-1])
    return rising, falling


@pytest.mark.parametrize("variant", OTHER_CLASSES)
def test_loop_of_another_class_is_15_pct_wide(variant: str) -> None:
    """The nominal loop at 1 Hz is 14 to 16 % wide, the maximum of data sheets."""
    rising, falling = branches(make_plant(variant, only=STATIC))

    assert 14 < 100 * np.max(falling - rising) < 16


@pytest.mark.parametrize(
    "variant",
    [
        pytest.param(name, marks=[] if name == "bouc-wen" else [pytest.mark.stress])
        for name in OTHER_CLASSES
    ],
)
def test_loop_of_every_specimen_is_12_to_18_pct_wide(variant: str) -> None:
    """This holds for 50 specimens."""
    for seed in range(50):
        drawn = specimen(VARIANTS[variant].parameters, np.random.SeedSequence(seed))
        static = without(drawn, sorted(set(EFFECTS) - set(STATIC)))
        rising, falling = branches(Plant(static, np.random.SeedSequence(1)))

        assert 12 < 100 * np.max(falling - rising) < 18, f"seed {seed}"


@pytest.mark.parametrize(
    ("variant", "low_pct", "high_pct"),
    [
        ("preisach-exponential", 0, 0.1),
        ("preisach-gaussian", 0, 0.1),
        ("preisach-asymmetric", 14.5, 15.5),
        ("thermal-relays", 0, 1),
        ("bouc-wen", 0, 0.1),
        ("dahl", 0, 0.1),
        ("coleman-hodgdon", 0, 0.1),
        ("duhem", 1.5, 2.5),
        ("maxwell-slip", 0, 0.1),
        ("bouc-wen-2", 0, 0.1),
        ("rate-plays", 0, 0.1),
        ("bipolar", 7, 9),
    ],
)
def test_branches_differ_only_on_asymmetric_stages(
    variant: str, low_pct: float, high_pct: float
) -> None:
    """The rising branch deviates from the mirrored falling branch by 15, 8 and 2 % there."""
    rising, falling = branches(make_plant(variant, only=STATIC))
    difference_pct = 100 * np.max(np.abs(rising - (1 - falling[::-1])))

    assert low_pct <= difference_pct <= high_pct


def test_switch_of_the_asymmetry_makes_the_density_symmetrical() -> None:
    """Without the effect the branches of the asymmetric stage mirror each other."""
    rising, falling = branches(make_plant("preisach-asymmetric", only=("hysteresis",)))

    assert rising == pytest.approx(1 - falling[::-1], abs=1e-3)


@pytest.mark.parametrize("variant", VARIANTS)
def test_rig_rests_at_0_and_knows_its_truth_everywhere(variant: str) -> None:
    """The truth is 0 at rest, rises by the travel, and is finite after any voltages."""
    rig = SimulatedRig(SimulatedOptions.model_validate({"variant": variant}), Wiring.both("x"), 3)
    rig.open()
    rig.activate(0)
    rig.read(100 * MS)
    at_rest_um = rig.true_position_um(100 * MS)[0]
    random_v = np.random.default_rng(1).uniform(-10, 160, 300)
    true_um = []
    for k, drive_v in enumerate([*np.linspace(-10, 160, 100), *random_v], 100):
        assert rig.write([drive_v], 2 * k * MS)
        rig.read(2 * (k + 1) * MS)
        true_um.append(rig.true_position_um(2 * (k + 1) * MS)[0])

    assert at_rest_um == pytest.approx(0.0, abs=2e-3)
    assert all(map(isfinite, true_um))
    assert 24 < np.ptp(true_um[:100]) < 120
    assert np.max(np.abs(true_um)) < 250


@pytest.mark.parametrize("variant", VARIANTS)
def test_full_drive_gives_the_travel(variant: str) -> None:
    """0.1 s after a step to the nominal drive the displacement is the travel."""
    plant = make_plant(variant, only=STATIC)
    plant.command(plant.parameters.stage.drive_v)
    plant.advance_to(100 * MS)

    travel_um = plant.parameters.stage.travel_um
    assert plant.true_displacement_um == pytest.approx(travel_um, rel=1e-3)


@pytest.mark.parametrize("variant", OTHER_CLASSES)
def test_stage_without_hysteresis_is_linear(variant: str) -> None:
    """The switch of the hysteresis leaves a straight line with the whole travel."""
    plant = make_plant(variant, only=())
    trace = run(plant, plant.parameters.stage.drive_v * TRIANGLE)

    assert trace.position_um == pytest.approx(30 * TRIANGLE, abs=1e-9)


def test_gain_grows_by_10_pct_in_10_minutes() -> None:
    """The displacement of `gain-drift` grows by 10 %, that of the stack stays."""
    at_10_min_um = {}
    for variant in ("stack", "gain-drift"):
        parameters = without(
            VARIANTS[variant].parameters, sorted(set(EFFECTS) - {*STATIC, "drift"})
        )
        parameters = replace(parameters, stage=replace(parameters.stage, drift=0.0))
        plant = Plant(parameters, np.random.SeedSequence(1), MS)
        plant.command(150.0)
        plant.advance_to(600_000 * MS)
        at_10_min_um[variant] = plant.true_displacement_um

    assert at_10_min_um["stack"] == pytest.approx(30.0, abs=1e-9)
    assert at_10_min_um["gain-drift"] == pytest.approx(33.0, abs=1e-3)


def test_specimens_of_all_variants_of_the_stack_share_their_other_parts() -> None:
    """Another class of hysteresis does not change the amplifier and the sensor of a seed."""

    def parts(name: str) -> Any:
        return VARIANTS[name].parameters.amplifier, VARIANTS[name].parameters.sensor

    stack = specimen(VARIANTS["stack"].parameters, np.random.SeedSequence(5))
    same = [n for n in OTHER_CLASSES if parts(n) == parts("stack")]
    assert len(same) > len(OTHER_CLASSES) / 2
    for variant in same:
        other = specimen(VARIANTS[variant].parameters, np.random.SeedSequence(5))

        assert (other.amplifier, other.sensor) == (stack.amplifier, stack.sensor), variant
