"""The simulated stages of the distribution, by name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from piezod.plant.effects import without
from piezod.plant.foreign_laws import (
    ColemanHodgdon,
    Duhem,
    MaxwellSlip,
    RatePlays,
)
from piezod.plant.laws import (
    BoucWen,
    Dahl,
    ExponentialDensity,
    GaussianDensity,
    HysteresisLaw,
    ThermalRelays,
)
from piezod.plant.parameters import (
    AmplifierParameters,
    PlantParameters,
    SensorParameters,
    StageParameters,
)


class Variant(NamedTuple):
    """A named stage."""

    summary: str  #: One line that distinguishes it from the others.
    parameters: PlantParameters  #: Nominal parameters, before the seed varies them.
    #: Whether the sensor's curve was measured at commissioning. If not, only a straight line is
    #: known.
    calibrated: bool = True
    residual_pct: float = 0.05  #: Greatest error of that curve, in % of the travel.
    lowest_v: float = 0.0  #: Lowest voltage that it is made for; it rests at 0 V.


_STACK = PlantParameters()

_FLEXURE = PlantParameters(
    stage=StageParameters(
        drive_v=180.0,
        reversible_um=13.06,
        irreversible_um=20.94,
        skew=0.21,
        drift=0.037,
        mode_damping=0.015,
    ),
    amplifier=AmplifierParameters(output_max_v=190.0),
    sensor=SensorParameters(slope_v_per_um=0.097, noise_nm_per_rthz=0.845),
)

_AFM = PlantParameters(
    stage=replace(
        _STACK.stage,
        reversible_um=34.9,
        irreversible_um=55.1,
        skew=0.66,
        mode_hz=358.0,
    ),
    sensor=SensorParameters(slope_v_per_um=0.0367, noise_nm_per_rthz=2.235),
)

# The stack with a hysteresis of another class. The share of the hysteretic part gives loops of 15 %
# of the travel, see `laws.py`; nothing here was chosen after a result of any compensation. The skew
# is not used.

_EXPONENTIAL = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=17.21, irreversible_um=12.79, skew=0.0),
    hysteresis=ExponentialDensity(),
)

_GAUSSIAN = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=19.86, irreversible_um=10.14, skew=0.0),
    hysteresis=GaussianDensity(),
)

_ASYMMETRIC = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=17.64, irreversible_um=12.36, skew=0.0),
    hysteresis=ExponentialDensity(asymmetry=2.15),
)

_RELAYS = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=15.7, irreversible_um=14.3, skew=0.0),
    hysteresis=ThermalRelays(),
)

_BOUC_WEN = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=16.1, irreversible_um=13.9, skew=0.0),
    hysteresis=BoucWen(),
)

_DAHL = replace(
    _STACK,
    stage=replace(_STACK.stage, reversible_um=14.6, irreversible_um=15.4, skew=0.0),
    hysteresis=Dahl(),
)

# Classes of hysteresis that no model of piezod has, and parts that are worse than a model assumes.


def _foreign(irreversible_um: float, law: HysteresisLaw) -> PlantParameters:
    stage = replace(
        _STACK.stage,
        reversible_um=_STACK.stage.travel_um - irreversible_um,
        irreversible_um=irreversible_um,
        skew=0.0,
    )
    return replace(_STACK, stage=stage, hysteresis=law)


_SATURATED = _foreign(9.99, RatePlays(growth=0.0, saturation=1.0, steeper=0.1))
_BIPOLAR = replace(
    _SATURATED,
    stage=replace(_SATURATED.stage, drive_v=120.0),
    amplifier=AmplifierParameters(output_min_v=-40.0),
)
_SLIGHTLY = _foreign(12.41, RatePlays(growth=0.05))
_SEVERAL = replace(
    _SLIGHTLY,
    stage=replace(
        _SLIGHTLY.stage,
        creep_per_decade=0.015,
        drift=0.01,
        gain_growth_per_s=2e-5,
        mode_hz=500.0,
        mode_damping=0.015,
    ),
    amplifier=AmplifierParameters(slew_v_per_s=3000.0, dac_bits=14),
    sensor=SensorParameters(hum_nm=10.0, adc_bits=14),
)

VARIANTS: Final[Mapping[str, Variant]] = {
    "stack": Variant("30 µm stack stage, 0 to 150 V", _STACK),
    "stack-uncalibrated": Variant(
        "the stack stage with a sensor calibrated by a straight line only", _STACK, calibrated=False
    ),
    "flexure": Variant(
        "34 µm flexure stage, 0 to 180 V, return point drifts by 3.7 % of travel", _FLEXURE
    ),
    "afm": Variant("90 µm AFM scanner, 0 to 150 V, with loops of 14 % asymmetry", _AFM),
    "preisach-exponential": Variant(
        "the stack stage as a symmetric Preisach model of exponential density", _EXPONENTIAL
    ),
    "preisach-gaussian": Variant(
        "the stack stage as a Preisach model of log-normal and Gaussian density", _GAUSSIAN
    ),
    "preisach-asymmetric": Variant(
        "the stack stage as a Preisach model of exponential density, 15 % asymmetry", _ASYMMETRIC
    ),
    "thermal-relays": Variant(
        "the stack stage as thermally activated relays: loops widen with the speed", _RELAYS
    ),
    "bouc-wen": Variant("the stack stage as a Bouc-Wen model", _BOUC_WEN),
    "dahl": Variant("the stack stage as a Dahl model", _DAHL),
    "light-damping": Variant(
        "the stack stage with a first mode at 400 Hz and a damping ratio of 0.005",
        replace(_STACK, stage=replace(_STACK.stage, mode_hz=400.0, mode_damping=0.005)),
    ),
    "no-antialias": Variant(
        "the stack stage without an anti-alias filter", without(_STACK, ["antialias"])
    ),
    "gain-drift": Variant(
        "the stack stage with a gain that grows by 10 % in 10 minutes",
        # 0.1 / 600 s
        replace(_STACK, stage=replace(_STACK.stage, gain_growth_per_s=1.667e-4)),
    ),
    "coleman-hodgdon": Variant(
        "the stack stage as a Coleman-Hodgdon model", _foreign(19.34, ColemanHodgdon())
    ),
    "duhem": Variant("the stack stage as a semilinear Duhem model", _foreign(27.29, Duhem())),
    "maxwell-slip": Variant(
        "the stack stage as ten elements of generalised Maxwell slip",
        _foreign(10.43, MaxwellSlip()),
    ),
    "bouc-wen-2": Variant(
        "the stack stage as a Bouc-Wen model of exponent 2", _foreign(14.73, BoucWen(exponent=2.0))
    ),
    "rate-plays": Variant(
        "the stack stage as plays whose thresholds grow by 15 % per decade of rate",
        _foreign(11.76, RatePlays()),
    ),
    "bipolar": Variant(
        "a stage for -20 to 120 V that saturates, with 8 % asymmetry", _BIPOLAR, lowest_v=-20.0
    ),
    "bent-sensor": Variant(
        "the stack stage with a sensor that is bent by 0.3 %, hum and 12 bits",
        replace(_STACK, sensor=SensorParameters(hum_nm=20.0, adc_bits=12, adc_range_v=5.0)),
        residual_pct=0.3,
    ),
    "slow-amplifier": Variant(
        "the stack stage with an amplifier of 1000 V/s and 12 bits",
        replace(_STACK, amplifier=AmplifierParameters(slew_v_per_s=1000.0, dac_bits=12)),
    ),
    "several-small": Variant(
        "the stack stage with a little of all: plays with rate, creep, drift, hum, 14 bits, slew",
        _SEVERAL,
        residual_pct=0.1,
    ),
}
