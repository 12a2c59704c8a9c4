"""Switches for single effects of the plant."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import inf
from typing import Any, Final

from piezod.plant.laws import ExponentialDensity
from piezod.plant.parameters import PlantParameters

# Parameter values at which each effect is absent, by part of the plant. Switching an effect off
# replaces parameters only, so the kernel needs no switches.
_ABSENT: Final[Mapping[str, Mapping[str, Mapping[str, float]]]] = {
    "hysteresis": {"stage": {"irreversible_um": 0.0, "skew": 0.0}},
    "asymmetry": {"stage": {"skew": 0.0}},
    "creep": {"stage": {"creep_per_decade": 0.0}},
    "drift": {"stage": {"drift": 0.0, "gain_growth_per_s": 0.0}},
    "mode": {"stage": {"mode_hz": inf}},
    "gain_error": {"amplifier": {"gain_error": 0.0}},
    "amplifier_bandwidth": {"amplifier": {"bandwidth_hz": inf}},
    "slew": {"amplifier": {"slew_v_per_s": inf}},
    "current_limit": {"amplifier": {"current_limit_a": inf}},
    "voltage_limits": {"amplifier": {"output_min_v": -inf, "output_max_v": inf}},
    "amplifier_noise": {"amplifier": {"noise_v": 0.0}},
    "dac": {"amplifier": {"dac_bits": inf, "dac_range_v": inf}},
    "nonlinearity": {"sensor": {"nonlinearity": 0.0}},
    "sensor_noise": {"sensor": {"noise_nm_per_rthz": 0.0}},
    "sensor_bandwidth": {"sensor": {"bandwidth_hz": inf}},
    "antialias": {"sensor": {"antialias_hz": inf}},
    "delay": {"sensor": {"delay_s": 0.0}},
    "adc": {"sensor": {"adc_bits": inf}},
    "saturation": {"sensor": {"saturation_v": inf}},
}

EFFECTS: Final = tuple(_ABSENT)
"""Names of all effects; each effect is on by default."""


def without(parameters: PlantParameters, effects: Iterable[str]) -> PlantParameters:
    """Return the same plant with some of its effects switched off.

    Without hysteresis the stage keeps its travel and becomes linear. Without nonlinearity the curve
    of the sensor is a straight line without a far side.

    Args:
        parameters: The plant.
        effects: Names from `EFFECTS`.

    Raises:
        KeyError: If a name is not in `EFFECTS`.
    """
    for effect in effects:
        changes: dict[str, Any] = {
            part: replace(getattr(parameters, part), **absent)
            for part, absent in _ABSENT[effect].items()
        }
        if effect == "hysteresis":  # the reversible part takes over the whole travel
            changes["stage"] = replace(changes["stage"], reversible_um=parameters.stage.travel_um)
        if effect == "asymmetry" and isinstance(parameters.hysteresis, ExponentialDensity):
            changes["hysteresis"] = replace(parameters.hysteresis, asymmetry=0.0)
        parameters = replace(parameters, **changes)
    return parameters
