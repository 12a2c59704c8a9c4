"""The simulated stages of the distribution, by name."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final, NamedTuple

from piezod.plant.parameters import (
    AmplifierParameters,
    PlantParameters,
    SensorParameters,
    StageParameters,
)


class Variant(NamedTuple):
    """A named stage.

    Attributes:
        summary: One line that distinguishes it from the others.
        parameters: Nominal parameters, before the seed varies them.
        calibrated: Whether the sensor's curve was measured at commissioning. If not, only a
            straight line is known.
    """

    summary: str
    parameters: PlantParameters
    calibrated: bool = True


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

VARIANTS: Final[Mapping[str, Variant]] = {
    "stack": Variant("30 µm stack stage, 0 to 150 V", _STACK),
    "stack-uncalibrated": Variant(
        "the stack stage with a sensor calibrated by a straight line only", _STACK, calibrated=False
    ),
    "flexure": Variant(
        "34 µm flexure stage, 0 to 180 V, return point drifts by 3.7 % of travel", _FLEXURE
    ),
    "afm": Variant("90 µm AFM scanner, 0 to 150 V, with loops of 14 % asymmetry", _AFM),
}
