"""Fixtures: plants with chosen effects, and a way to drive them."""

from collections.abc import Callable, Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from piezod.plant.effects import EFFECTS, without
from piezod.plant.parameters import PlantParameters
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS

Array: TypeAlias = NDArray[np.float64]


class Trace(NamedTuple):
    """Record of a run: displacement of the mechanics and sensor voltage, one value per command."""

    position_um: Array
    sensor_v: Array


def _parameters(
    variant: str = "stack", *, only: Iterable[str] | None = None, off: Iterable[str] = ()
) -> PlantParameters:
    absent = set(off) if only is None else set(EFFECTS) - set(only)
    return without(VARIANTS[variant].parameters, sorted(absent))


def _run(plant: Plant, drive_v: Iterable[float], period_ns: int = 1_000_000) -> Trace:
    rows = []
    t_ns = plant.now_ns
    for command_v in drive_v:
        plant.command(float(command_v))
        t_ns += period_ns
        plant.advance_to(t_ns)
        rows.append((plant.true_displacement_um, plant.sample()))
    position_um, sensor_v = np.array(rows).T
    return Trace(position_um, sensor_v)


@pytest.fixture(scope="session")
def nominal() -> Callable[..., PlantParameters]:
    """Return a function (variant, only=, off=) for nominal parameters with some effects."""
    return _parameters


@pytest.fixture(scope="session")
def make_plant() -> Callable[..., Plant]:
    """Return a function (variant, only=, off=, seed=, sub_step_ns=) that makes a plant."""

    def make(
        variant: str = "stack",
        *,
        only: Iterable[str] | None = None,
        off: Iterable[str] = (),
        seed: int = 1,
        sub_step_ns: int = 50_000,
    ) -> Plant:
        parameters = _parameters(variant, only=only, off=off)
        return Plant(parameters, np.random.SeedSequence(seed), sub_step_ns)

    return make


@pytest.fixture(scope="session")
def run() -> Callable[..., Trace]:
    """Return a function (plant, drive_v, period_ns=1 ms) that drives a plant and records it."""
    return _run
