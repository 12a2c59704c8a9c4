"""Cost of one step of the simulated plant: 1 ms of its time, called from Python.

Run it with `python benchmarks/bench_plant.py`. It prints the median over many steps with every
effect on, with each effect off, of each variant, and of the driver's whole cycle. Two references
are measured in the same run: an empty compiled call with the same arguments, and a compiled chain
of additions and multiplications of known length, which measures the speed of the machine.
"""

from collections.abc import Callable
from math import pi, sin
from statistics import median
from time import perf_counter_ns

import numpy as np

from piezod.devices.interface import Wiring
from piezod.jit import compiled
from piezod.plant.effects import EFFECTS, without
from piezod.plant.kernel import Record
from piezod.plant.layout import at_rest, constants
from piezod.plant.parameters import PlantParameters
from piezod.plant.plant import Plant
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions

STEPS = 10_000
PERIOD_NS = 1_000_000
BUDGET_US = 5.0
CHAIN = 1000
DRIVE_V = [75 + 70 * sin(2 * pi * 0.5 * k * 1e-3) for k in range(STEPS)]


@compiled
def nothing(_steps: int, _drive_v: float, _ago: float, _state: Record, _constants: Record) -> float:
    """Do nothing, with the arguments of the plant's kernel."""
    return 0.0


@compiled
def chain(x: float) -> float:
    """Do `CHAIN` dependent additions and multiplications."""
    for _ in range(CHAIN):
        x = x * 0.999 + 0.001
    return x


def median_us(step: Callable[[int], object]) -> float:
    """Return the median duration of `step(k)` in µs, without the first tenth of the steps."""
    durations_ns = []
    for k in range(STEPS):
        start_ns = perf_counter_ns()
        step(k)
        durations_ns.append(perf_counter_ns() - start_ns)
    return median(durations_ns[STEPS // 10 :]) / 1000


def plant_us(parameters: PlantParameters) -> float:
    """Return the cost of a millisecond of a plant, commanded and sampled, in µs."""
    plant = Plant(parameters, np.random.SeedSequence(1))

    def step(k: int) -> float:
        plant.command(DRIVE_V[k])
        plant.advance_to((k + 1) * PERIOD_NS)
        return plant.sample()

    return median_us(step)


def rig_us(axes: tuple[str, ...]) -> float:
    """Return the cost of a cycle of the driver, reading and writing all axes, in µs."""
    rig = SimulatedRig(SimulatedOptions(), Wiring.both(axes), 1)
    rig.open()
    rig.activate(0)

    def cycle(k: int) -> bool:
        rig.read(k * PERIOD_NS)
        return rig.write([DRIVE_V[k]] * len(axes), k * PERIOD_NS)

    return median_us(cycle)


def main() -> None:
    """Measure and print."""
    parameters = PlantParameters()
    record = constants(parameters, 50e-6)
    state = at_rest(record)
    rows = [
        (
            "reference: empty compiled call",
            median_us(lambda _: nothing(20, 1.0, 2.2, state, record)),
        ),
        (f"reference: chain of {CHAIN} multiply-adds", median_us(lambda _: chain(0.5))),
        (f"plant, every effect on (at most {BUDGET_US:g})", plant_us(parameters)),
        *(
            (f"plant without {effect}", plant_us(without(parameters, [effect])))
            for effect in EFFECTS
        ),
        ("plant without any effect", plant_us(without(parameters, EFFECTS))),
        *((f"variant {name}", plant_us(each.parameters)) for name, each in VARIANTS.items()),
        ("driver, read and write, one axis", rig_us(("x",))),
        ("driver, read and write, two axes", rig_us(("x", "y"))),
    ]
    print("Simulated plant: median cost of 1 ms from Python, in µs")
    for name, cost_us in rows:
        print(f"  {name:<44}{cost_us:8.2f}")


if __name__ == "__main__":
    main()
