"""Measurements of the response of the simulated rig, in virtual time."""

from collections.abc import Callable, Mapping

import numpy as np

from piezod.config.experiment import ExperimentConfig
from piezod.experiment.response.judgement import judged
from piezod.experiment.response.measurement import measured
from piezod.experiment.response.plan import Wanted, plan_response
from piezod.experiment.virtual.stage import IN_FORCE_V, POSITION_UM, opened
from piezod.hysteresis.memory import FloatArray
from piezod.plant.parameters import PlantParameters
from piezod.records.response_record import ResponseRecord
from piezod_drivers.simulated.options import SimulatedOptions
from tests.experiment.conftest import SHORT

RAMP_V_PER_S = 500.0
SEED = 1
Load = Callable[[str], ExperimentConfig]
Change = Callable[[Mapping[str, FloatArray]], Mapping[str, FloatArray]]


def true_parameters(variant: str = "stack") -> PlantParameters:
    """Return the parameters of the specimen that `measure` drives."""
    seed = np.random.SeedSequence(SEED).spawn(1)[0].spawn(3)[0]
    return SimulatedOptions.model_validate({"variant": variant}).plant(seed)


def text_of(rate_hz: float, variant: str = "stack") -> str:
    """Return an experiment on the specimen."""
    text = SHORT.replace("rate_hz: 1000", f"rate_hz: {rate_hz:g}")
    return text.replace("seed: 3", f"seed: {SEED}").replace("stack", variant)


def measure(
    load: Load,
    rate_hz: float,
    wanted: Wanted,
    variant: str = "stack",
    change: Change = lambda columns: columns,
) -> ResponseRecord:
    """Measure the response of a specimen of the simulated rig.

    Args:
        load: Loads an experiment.
        rate_hz: Cycles per second.
        wanted: The drive.
        variant: Variant of the rig.
        change: Changes the record before it is evaluated.
    """
    config = load(text_of(rate_hz, variant))
    plans = plan_response(wanted, config.axes["x"].limits, RAMP_V_PER_S, rate_hz)
    about = []
    with opened(config, lambda _cycles: None) as stage:
        for plan in plans:
            drive_v = plan.drive_v.built(plan.duration_s).value
            # A few cycles more: the voltage in force is that of the cycle before.
            (trace,) = stage.open_loop([drive_v], plan.duration_s + 3.0 / rate_hz)
            columns = {"drive_v": trace[:, IN_FORCE_V], "position_um": trace[:, POSITION_UM]}
            about.append(measured(plan, change(columns)))
            stage.rest(0.5)
    return judged("x", "virtual", "multisine", rate_hz, about, "a remedy")
