"""Plants with chosen effects, and a way to drive them."""

from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

import numpy as np
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


def parameters_of(
    variant: str = "stack", *, only: Iterable[str] | None = None, off: Iterable[str] = ()
) -> PlantParameters:
    """Return the nominal parameters of a variant with some effects."""
    absent = set(off) if only is None else set(EFFECTS) - set(only)
    return without(VARIANTS[variant].parameters, sorted(absent))


def make_plant(
    variant: str = "stack",
    *,
    only: Iterable[str] | None = None,
    off: Iterable[str] = (),
    seed: int = 1,
    sub_step_ns: int = 50_000,
) -> Plant:
    """Return a nominal plant with some effects."""
    parameters = parameters_of(variant, only=only, off=off)
    return Plant(parameters, np.random.SeedSequence(seed), sub_step_ns)


def run(plant: Plant, drive_v: Iterable[float], period_ns: int = 1_000_000) -> Trace:
    """Drive a plant with one command a period, and record it."""
    rows = []
    t_ns = plant.now_ns
    for command_v in drive_v:
        plant.command(float(command_v))
        t_ns += period_ns
        plant.advance_to(t_ns)
        rows.append((plant.true_displacement_um, plant.sample()))
    position_um, sensor_v = np.array(rows).T
    return Trace(position_um, sensor_v)
