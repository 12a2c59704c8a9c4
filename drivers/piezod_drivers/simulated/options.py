"""What a configuration may say about a simulated rig.

The models of the switches and of the parameters are made from the tables of `piezod.plant`, which
are the only place where a parameter's unit and bounds are written down.
"""

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from piezod.plant.effects import EFFECTS, without
from piezod.plant.parameters import (
    AmplifierParameters,
    PlantParameters,
    SensorParameters,
    StageParameters,
    quantities,
    specimen,
)
from piezod.plant.variants import VARIANTS

_STRICT = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Commissioned(BaseModel):
    """The sensor's curve was measured against a reference when the stage was commissioned."""

    model_config = _STRICT

    kind: Literal["commissioned"] = "commissioned"
    residual_pct: float = Field(
        0.05, ge=0, le=5, description="greatest error that is left, % of travel"
    )


class Line(BaseModel):
    """Only a straight line is known for the sensor."""

    model_config = _STRICT

    kind: Literal["line"] = "line"


class Table(BaseModel):
    """The curve is given here."""

    model_config = _STRICT

    kind: Literal["table"] = "table"
    sensor_v: tuple[float, ...] = Field(
        min_length=2, description="sensor voltages in V, strictly monotonic"
    )
    position_um: tuple[float, ...] = Field(
        min_length=2, description="displacements in µm at those voltages"
    )

    @model_validator(mode="after")
    def _is_a_curve(self) -> "Table":
        if len(self.sensor_v) != len(self.position_um):
            raise ValueError("sensor_v and position_um must have the same number of values")
        rising = [later > earlier for earlier, later in pairwise(self.sensor_v)]
        falling = [later < earlier for earlier, later in pairwise(self.sensor_v)]
        if not (all(rising) or all(falling)):
            raise ValueError("sensor_v must be strictly rising or strictly falling")
        return self


def _overrides(part: type[Any], name: str, about: str) -> type[BaseModel]:
    """Make the model of a part of the plant: every parameter may be given, none must be."""
    given: dict[str, Any] = {
        parameter: (
            float | None,
            Field(None, ge=q.low, le=q.high, description=f"{q.about} ({q.unit or 'a number'})"),
        )
        for parameter, q in quantities(part).items()
    }
    return create_model(name, __config__=_STRICT, __doc__=about, **given)


def _switches() -> type[BaseModel]:
    """Make the model that has one switch for each effect."""
    fields: dict[str, Any] = {
        effect: (bool, Field(True, description="whether the rig has this effect"))
        for effect in EFFECTS
    }
    return create_model("Effects", __config__=_STRICT, __doc__="Effects of the rig.", **fields)


if TYPE_CHECKING:  # their fields are known at run time only
    Effects: TypeAlias = BaseModel
    Stage: TypeAlias = BaseModel
    Amplifier: TypeAlias = BaseModel
    Sensor: TypeAlias = BaseModel
else:
    Effects = _switches()
    Stage = _overrides(StageParameters, "Stage", "The stage, where it differs from the variant.")
    Amplifier = _overrides(
        AmplifierParameters, "Amplifier", "The amplifier, where it differs from the variant."
    )
    Sensor = _overrides(
        SensorParameters, "Sensor", "The sensor, where it differs from the variant."
    )


class Options(BaseModel):
    """Options of the simulated rig; every axis is a specimen of its own of the same variant."""

    model_config = _STRICT

    variant: Literal["stack", "stack-uncalibrated", "flexure", "afm"] = Field(
        "stack", description="which stage"
    )
    effects: Effects = Field(Effects(), description="switches, all on unless given")
    stage: Stage = Field(Stage(), description="exact values; what is left out varies with the seed")
    amplifier: Amplifier = Field(Amplifier(), description="exact values, as for the stage")
    sensor: Sensor = Field(Sensor(), description="exact values, as for the stage")
    calibration: Annotated[Commissioned | Line | Table, Field(discriminator="kind")] | None = Field(
        None, description="what is known of the sensor's curve; left out: as the variant has it"
    )

    def plant(self, seed: np.random.SeedSequence) -> PlantParameters:
        """Draw a specimen of the variant and apply what was configured.

        Args:
            seed: Of the specimen.
        """
        drawn = specimen(VARIANTS[self.variant].parameters, seed)
        configured = PlantParameters(
            stage=replace(drawn.stage, **self.stage.model_dump(exclude_none=True)),
            amplifier=replace(drawn.amplifier, **self.amplifier.model_dump(exclude_none=True)),
            sensor=replace(drawn.sensor, **self.sensor.model_dump(exclude_none=True)),
        )
        return without(
            configured, [name for name, on in self.effects.model_dump().items() if not on]
        )

    def known_curve(self) -> Commissioned | Line | Table:
        """Tell what is known of the sensor's curve."""
        if self.calibration is not None:
            return self.calibration
        return Commissioned() if VARIANTS[self.variant].calibrated else Line()
