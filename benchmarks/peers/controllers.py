"""Plain controllers on the stages of the rig, beside the modes of piezod.

    python -m benchmarks.peers.controllers [--csv FILE] [STAGE ...]

A plain controller has no model, only the error of the sensor. All follow the cases of the
experiment beyond the paper. Delay and first mode are known, as from a measured response; the gains
are the largest with a gain margin of 6 dB, a phase margin of 45° and a distance of 0.5 from -1.
"""

import argparse
import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.variants import MODES, worst_pct
from piezod.config.experiment import ExperimentConfig
from piezod.control.law.trim import NotchedTrim
from piezod.devices.interface import Wiring
from piezod.dynamics import Resonance, ResponseModel
from piezod.dynamics.loop import TrimLaw
from piezod.dynamics.margins import propose, within_margins
from piezod.dynamics.notch import notch, notched
from piezod.plant.parameters import PlantParameters
from piezod.units import NS_PER_S, s_to_ns
from piezod_drivers.simulated.axis import make_axis
from piezod_drivers.simulated.driver import SimulatedRig
from piezod_drivers.simulated.options import SimulatedOptions
from tests.experiment.beyond import FOREIGN, experiment_of

_ANY: Final = 1e6


@dataclass(frozen=True)
class Controller:
    """A controller without a model."""

    rate_hz: int  #: Rate of its loop.
    proportional: bool  #: Whether it has a proportional part, and a notch at the first mode.

    def law(self, stage: ResponseModel) -> TrimLaw:
        """Return its gains for a stage."""
        period_s = 1.0 / self.rate_hz
        if self.proportional:
            return propose(period_s, stage, notched(stage.resonances, period_s))
        return within_margins(TrimLaw(_ANY, 0.0, ()), period_s, stage)


CONTROLLERS: Final = {
    "integral, 1 kHz": Controller(1_000, proportional=False),
    "PI with notch, 10 kHz": Controller(10_000, proportional=True),
}


def response_of(plant: PlantParameters, period_s: float) -> ResponseModel:
    """Return the linear dynamics of a stage, hold included: lags count as delays."""
    amplifier, sensor = plant.amplifier, plant.sensor
    lags_s = 1.0 / (2.0 * pi * amplifier.bandwidth_hz) + 1.0 / (2.0 * pi * sensor.bandwidth_hz)
    filter_s = sqrt(2.0) / (2.0 * pi * sensor.antialias_hz)
    delay_s = sensor.delay_s + lags_s + filter_s + 0.5 * period_s
    return ResponseModel(delay_s, (Resonance(plant.stage.mode_hz, plant.stage.mode_damping),))


def worst_of_controller(controller: Controller, config: ExperimentConfig) -> float:
    """Return the worst true tracking error of the cases, in % of the range of each."""
    return max(_worst_of_case(controller, config, case) for case in range(len(config.cases)))


def _worst_of_case(controller: Controller, config: ExperimentConfig, number: int) -> float:
    case, limits = config.cases[number], config.axes["x"].limits
    options, period_s = config.devices["rig"].options, 1.0 / controller.rate_hz
    assert isinstance(options, SimulatedOptions)  # noqa: S101 - for the type checker
    plant = make_axis(options, np.random.SeedSequence(config.seed).spawn(1)[0]).plant.parameters
    law = controller.law(response_of(plant, period_s))
    notches = [notch(mode, period_s) for mode in law.notches]
    # The integral of the error is the voltage, in units of the full drive.
    control = NotchedTrim(
        law.gain_per_s, period_s, _ANY, 1, proportional=law.proportional, notches=notches
    )
    control.enable()
    rig = SimulatedRig(options, Wiring.both(("x",)), config.seed)
    rig.open()
    rig.activate(0)
    command = next(iter(case.commands(config.axes).values())).built(case.duration_s).value
    period_ns, range_v, limited = s_to_ns(period_s), plant.stage.drive_v, 0
    count = round(case.duration_s * controller.rate_hz)
    errors_um, truths_um = np.empty(count), np.empty(count)
    for k in range(count):
        t_s = k * period_s
        (sample,) = rig.read(k * period_ns)
        truths_um[k] = rig.true_position_um(k * period_ns)[0]
        errors_um[k] = command(t_s) - truths_um[k]
        error = (command(t_s) - sample.position_um) / plant.stage.travel_um
        wanted_v = control.step(error, sample.valid, limited) * range_v
        drive_v = min(max(wanted_v, limits.drive_min_v), limits.drive_max_v)
        limited = (wanted_v > drive_v) - (wanted_v < drive_v)
        rig.write([drive_v], k * period_ns)
    counted = round(case.period_s * NS_PER_S) // period_ns
    return 100.0 * float(np.max(np.abs(errors_um[counted:])) / np.ptp(truths_um[counted:]))


def rows(stages: Sequence[str]) -> Iterator[list[str]]:
    """Yield the headings, and the worst true errors on each stage, specimen 1."""
    yield ["stage", *CONTROLLERS, *MODES]
    for stage in stages:
        plain = [worst_of_controller(each, experiment_of(stage)) for each in CONTROLLERS.values()]
        yield [stage, *(f"{error:.2f}" for error in (*plain, *worst_pct(stage, 1)))]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser("python -m benchmarks.peers.controllers", description=__doc__)
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there, too")
    parser.add_argument("stages", nargs="*", default=["stack", *FOREIGN], metavar="STAGE")
    arguments = parser.parse_args()
    table = []
    for row in rows(arguments.stages):
        print("  ".join(f"{cell:>21}" for cell in row), flush=True)
        table.append(row)
    if arguments.csv:
        with arguments.csv.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows(table)


if __name__ == "__main__":
    main()
