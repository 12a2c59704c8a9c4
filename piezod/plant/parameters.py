"""Parameters of a simulated stage, its amplifier and its sensor.

The defaults are the `stack` variant: a 30 µm stack stage. The sources are measurements of
third-party stages (loop width against swing, creep, first mode, delay) and manuals of amplifiers
and sensors. Infinity is allowed inside; it means that an effect is absent (see `effects.py`).
"""

from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, get_type_hints

import numpy as np

from piezod.plant.laws import HysteresisLaw, PowerLaw
from piezod.plant.ranges import ParameterRange

# Largest relative deviation of a parameter from its nominal value, drawn with the seed.
VARIATION = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class StageParameters:
    """The actuator and the mechanics."""

    drive_v: Annotated[
        float, ParameterRange("V", 1, 1000, "drive voltage of the full travel", varies=False)
    ] = 150.0
    reversible_um: Annotated[
        float, ParameterRange("µm", 0, 1000, "reversible part of the travel")
    ] = 11.4
    irreversible_um: Annotated[
        float, ParameterRange("µm", 0, 1000, "hysteretic part of the travel")
    ] = 18.6
    exponent: Annotated[
        float,
        ParameterRange("", 1.05, 2, "exponent of the hysteretic part over the swing", varies=False),
    ] = 1.375
    skew: Annotated[
        float, ParameterRange("", -1.4, 1.4, "slope of the Preisach density along the drive")
    ] = 0.19
    creep_per_decade: Annotated[
        float, ParameterRange("", 0, 0.1, "creep per decade of time, as a fraction of the step")
    ] = 0.01
    drift: Annotated[
        float,
        ParameterRange("", 0, 0.2, "drift of the return point at full swing, fraction of travel"),
    ] = 0.005
    drift_time_s: Annotated[
        float, ParameterRange("s", 0.1, 1000, "time constant of the drift of the return point")
    ] = 2.5
    drift_memory_s: Annotated[
        float, ParameterRange("s", 0.1, 1e5, "time constant of the decay of the drift at rest")
    ] = 60.0
    gain_growth_per_s: Annotated[
        float,
        ParameterRange("1/s", 0, 1e-3, "growth of the gain, relative to its start", varies=False),
    ] = 0.0
    mode_hz: Annotated[float, ParameterRange("Hz", 10, 5000, "first mechanical mode")] = 734.0
    mode_damping: Annotated[float, ParameterRange("", 0.001, 0.9, "damping ratio of the mode")] = (
        0.03
    )

    @property
    def travel_um(self) -> float:
        """Displacement 0.1 s after a step to `drive_v`, in µm."""
        return self.reversible_um + self.irreversible_um


@dataclass(frozen=True, slots=True, kw_only=True)
class AmplifierParameters:
    """The path from the commanded voltage to the voltage across the actuator."""

    gain: Annotated[float, ParameterRange("V/V", 0.1, 1000, "nominal gain", varies=False)] = 20.0
    gain_error: Annotated[float, ParameterRange("", -0.1, 0.1, "relative error of the gain")] = (
        0.002
    )
    bandwidth_hz: Annotated[
        float, ParameterRange("Hz", 10, 1e5, "-3 dB bandwidth into the actuator")
    ] = 3000.0
    slew_v_per_s: Annotated[float, ParameterRange("V/s", 10, 1e9, "slew rate of the output")] = 5e4
    current_limit_a: Annotated[float, ParameterRange("A", 1e-4, 100, "largest output current")] = (
        0.1
    )
    capacitance_uf: Annotated[
        float, ParameterRange("µF", 1e-3, 1000, "capacitance of the actuator")
    ] = 3.0
    output_min_v: Annotated[
        float, ParameterRange("V", -1000, 0, "lowest output voltage", varies=False)
    ] = -10.0
    output_max_v: Annotated[
        float, ParameterRange("V", 1, 1000, "highest output voltage", varies=False)
    ] = 160.0
    noise_v: Annotated[float, ParameterRange("V rms", 0, 1, "noise of the output")] = 0.8e-3
    dac_bits: Annotated[
        float, ParameterRange("bit", 4, 24, "resolution of the converter", varies=False)
    ] = 16
    dac_range_v: Annotated[
        float,
        ParameterRange("V", 0.1, 100, "range of the converter, plus and minus", varies=False),
    ] = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorParameters:
    """The path from the displacement to the voltage that the converter reports."""

    slope_v_per_um: Annotated[
        float, ParameterRange("V/µm", 1e-4, 1000, "slope of the near side at small gaps")
    ] = 0.11
    light_level: Annotated[float, ParameterRange("", 0, 10, "light, relative to nominal")] = 1.0
    nonlinearity: Annotated[
        float,
        ParameterRange(
            "", 0, 0.04, "deviation from the best line over the travel, as a fraction of it"
        ),
    ] = 0.01
    setback_um: Annotated[
        float,
        ParameterRange("µm", 0, 1e4, "gap at rest beyond its best value, a third of the travel"),
    ] = 0.0
    noise_nm_per_rthz: Annotated[
        float, ParameterRange("nm/√Hz", 0, 1000, "noise density at nominal light, near side")
    ] = 0.745
    hum_nm: Annotated[
        float, ParameterRange("nm", 0, 1000, "amplitude of the hum of the mains", varies=False)
    ] = 0.0
    hum_hz: Annotated[
        float, ParameterRange("Hz", 1, 1000, "frequency of the hum", varies=False)
    ] = 50.0
    bandwidth_hz: Annotated[float, ParameterRange("Hz", 100, 1e6, "-3 dB bandwidth")] = 1e4
    antialias_hz: Annotated[
        float, ParameterRange("Hz", 10, 1e5, "-3 dB frequency of the second-order low-pass filter")
    ] = 500.0
    delay_s: Annotated[float, ParameterRange("s", 0, 2e-3, "pure delay from drive to sample")] = (
        0.11e-3
    )
    adc_bits: Annotated[
        float, ParameterRange("bit", 4, 24, "resolution of the converter", varies=False)
    ] = 16
    adc_range_v: Annotated[
        float,
        ParameterRange("V", 0.1, 100, "range of the converter, plus and minus", varies=False),
    ] = 10.0
    saturation_v: Annotated[
        float, ParameterRange("V", 0.1, 100, "largest reported voltage", varies=False)
    ] = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantParameters:
    """One axis: stage, amplifier and sensor."""

    #: The actuator and the mechanics.
    stage: StageParameters = field(default_factory=StageParameters)
    #: From the commanded voltage to the drive.
    amplifier: AmplifierParameters = field(default_factory=AmplifierParameters)
    #: From the displacement to the reported voltage.
    sensor: SensorParameters = field(default_factory=SensorParameters)
    #: Class of the hysteretic part of the stage, with its parameters.
    hysteresis: HysteresisLaw = field(default_factory=PowerLaw)


def quantities(part: type[Any]) -> dict[str, ParameterRange]:
    """Return name and range of each parameter of a part, in the order of declaration."""
    hints = get_type_hints(part, include_extras=True)
    return {item.name: hints[item.name].__metadata__[0] for item in fields(part)}


def specimen(nominal: PlantParameters, seed: np.random.SeedSequence) -> PlantParameters:
    """Draw one specimen: a uniform factor from 0.9 to 1.1 for each varying parameter."""
    rng = np.random.default_rng(seed)

    # The order of the parts and of their fields determines the numbers of a seed.
    def varied(part: Any) -> Any:
        names = [name for name, quantity in quantities(type(part)).items() if quantity.varies]
        factors = rng.uniform(1 - VARIATION, 1 + VARIATION, len(names))
        changed = {n: getattr(part, n) * float(f) for n, f in zip(names, factors, strict=True)}
        return replace(part, **changed)

    return PlantParameters(
        stage=varied(nominal.stage),
        amplifier=varied(nominal.amplifier),
        sensor=varied(nominal.sensor),
        hysteresis=varied(nominal.hysteresis),
    )
