"""The experiments beyond the paper, on any variant of the rig."""

from pathlib import Path
from typing import Any, Final, NamedTuple

from piezod.config.experiment import ExperimentConfig, load_experiment
from piezod.config.modes import Mode
from piezod.config.waveforms.combined import Sequence, Sum
from piezod.devices import registry
from piezod.plant.variants import VARIANTS

EXPERIMENTS = Path(__file__).parents[2] / "config" / "experiments"
OTHER_FILES = {
    "afm": "beyond-afm.yaml",
    "bipolar": "beyond-bipolar.yaml",
    "flexure": "beyond-flexure.yaml",
    "stack-uncalibrated": "beyond-uncalibrated.yaml",
}
"""Variant → its experiment, if it is not that of the stack."""
FOREIGN: Final = (
    "coleman-hodgdon",
    "duhem",
    "maxwell-slip",
    "bouc-wen-2",
    "rate-plays",
    "bipolar",
    "bent-sensor",
    "slow-amplifier",
    "several-small",
)
"""Variants of classes, and with parts, that no model of piezod describes."""
_LIGHTLY_DAMPED = "light-damping"
"""Its first mode is that of its data sheet; the gain of the trim follows from it."""
_UNFILTERED, _UNFILTERED_DELAY_S = "no-antialias", 0.00013
"""Without its filter the sensor has the delays of converter and bandwidth only."""


class Limit(NamedTuple):
    """What limits the errors of a variant."""

    variant: str  #: Name of the variant.
    lifted: str  #: What is different, for people.
    rig: dict[str, Any]  #: Options of the rig with which it is.


_EXACT: Final = {"calibration": {"kind": "commissioned", "residual_pct": 0.0}}
LIMITS: Final = (
    Limit("stack", "exact sensor", _EXACT),
    Limit(
        "stack-uncalibrated",
        "sensor calibrated to 0.05 %",
        {"calibration": {"kind": "commissioned"}},
    ),
    Limit("flexure", "no drift of the return points", {"effects": {"drift": False}}),
    Limit("flexure", "no drift, exact sensor", {"effects": {"drift": False}, **_EXACT}),
    Limit("afm", "exact sensor", _EXACT),
    Limit("preisach-exponential", "exact sensor", _EXACT),
    Limit("preisach-gaussian", "exact sensor", _EXACT),
    Limit("preisach-asymmetric", "exact sensor", _EXACT),
    Limit(
        "thermal-relays",
        "half the part of the relays",
        {"stage": {"reversible_um": 22.85, "irreversible_um": 7.15}},
    ),
    Limit(
        "bouc-wen",
        "half the Bouc-Wen part",
        {"stage": {"reversible_um": 23.05, "irreversible_um": 6.95}},
    ),
    Limit("bouc-wen", "exponent 2", {"hysteresis": {"exponent": 2.0}}),
    Limit("light-damping", "exact sensor", _EXACT),
    Limit("no-antialias", "no noise, no mode", {"effects": {"sensor_noise": False, "mode": False}}),
    Limit("gain-drift", "constant gain", {"stage": {"gain_growth_per_s": 0.0}}),
)
"""The effects without which the errors that miss their target reach it, or show what remains; and a
stage with another equation than the model's."""


def experiment_of(variant: str, seed: int = 1, **rig: Any) -> ExperimentConfig:
    """Return the experiment beyond the paper for a variant.

    Args:
        variant: Name of the variant.
        seed: Seed of the specimen.
        rig: Further options of the rig, as in a configuration.
    """
    path = EXPERIMENTS / OTHER_FILES.get(variant, "beyond.yaml")
    config = load_experiment(path, registry)
    axis, device = config.axes["x"], config.devices["rig"]
    if variant == _LIGHTLY_DAMPED:
        assert axis.first_mode is not None
        stage = VARIANTS[variant].parameters.stage
        known = {"frequency_hz": stage.mode_hz, "damping": stage.mode_damping}
        axis = axis.model_copy(update={"first_mode": axis.first_mode.model_copy(update=known)})
    if variant == _UNFILTERED:
        prompt = {"sensor_delay_s": _UNFILTERED_DELAY_S}
        axis = axis.model_copy(update={"compensator": axis.compensator.model_copy(update=prompt)})
    options = type(device.options).model_validate({"variant": variant, **rig})
    return config.model_copy(
        update={
            "seed": seed,
            "axes": {"x": axis},
            "devices": {"rig": device.model_copy(update={"options": options})},
        }
    )


def closed(config: ExperimentConfig) -> ExperimentConfig:
    """Return an experiment with its stage and cases in the loop of `closed.yaml`, at 10 kHz."""
    fast = load_experiment(EXPERIMENTS / "closed.yaml", registry)
    (device,), (of_fast,) = config.devices.values(), fast.devices.values()
    sensor = of_fast.options.model_dump(exclude_unset=True)["sensor"]
    options = {**device.options.model_dump(exclude_unset=True), "sensor": sensor}
    devices = {
        "rig": device.model_copy(update={"options": type(device.options).model_validate(options)})
    }
    update = {"seed": config.seed, "devices": devices, "cases": config.cases}
    return fast.model_copy(update={**update, "modes": (Mode.CLOSED,)})


def small_loops(config: ExperimentConfig) -> ExperimentConfig:
    """Return an experiment whose cases are loops of 2, 5 and 10 % of a travel of 30 µm."""
    (first, *_) = config.cases
    cases = []
    for height_um, swing_um in ((4.0, 0.6), (18.0, 1.5), (10.0, 3.0)):
        parts = (
            {"kind": "points", "points": ((0.0, 0.0), (2.0, height_um))},
            {"kind": "sine", "low": 0.0, "high": swing_um, "frequency_hz": 1.0},
        )
        update = {
            "name": f"{swing_um:g} µm",
            "period_s": 4.0,
            "duration_s": 16.0,
            "command_um": Sum.model_validate({"kind": "sum", "parts": parts}),
            "reference_pct": {},
        }
        cases.append(first.model_copy(update=update))
    return config.model_copy(update={"cases": tuple(cases)})


def brief(config: ExperimentConfig) -> ExperimentConfig:
    """Return an experiment with half the rate and identification, and part of the first case."""
    identification = config.identification
    assert identification is not None
    assert isinstance(identification.drive_v, Sequence)
    parts = tuple(
        part.model_copy(update={"duration_s": duration_s})
        for part, duration_s in zip(
            identification.drive_v.parts, (4.0, 10.0, 14.0, 2.0), strict=True
        )
    )
    shorter = {
        "run_in_s": 4.0,
        "duration_s": 30.0,
        "drive_v": identification.drive_v.model_copy(update={"parts": parts}),
    }
    return config.model_copy(
        update={
            "identification": identification.model_copy(update=shorter),
            "rate_hz": config.rate_hz / 2.0,
            "settle_s": 2.0,
            "cases": (config.cases[0].model_copy(update={"duration_s": 7.0}),),
        }
    )


def with_stops(config: ExperimentConfig, thresholds: str = "graded") -> ExperimentConfig:
    """Return an experiment whose model is a sum of stops in place of a surface.

    Args:
        config: An experiment with one axis, which it identifies.
        thresholds: Where the thresholds are, as in a configuration.
    """
    assert config.identification is not None
    identification = config.identification.model_copy(update={"method": "least-squares"})
    axis = config.axes["x"]
    stops = axis.compensator.model_copy(update={"thresholds": thresholds, "deadband_pct": 0.05})
    axes = {"x": axis.model_copy(update={"compensator": stops})}
    return config.model_copy(update={"identification": identification, "axes": axes})


def without_response(config: ExperimentConfig) -> ExperimentConfig:
    """Return an experiment whose stage has no known response, only its first mode."""
    axis = config.axes["x"]
    trim = axis.trim.model_copy(update={"proportional": 0.0})
    plain = axis.model_copy(update={"response": None, "trim": trim})
    return config.model_copy(update={"axes": {"x": plain}})
