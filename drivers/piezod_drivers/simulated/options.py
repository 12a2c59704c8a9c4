"""Options of a simulated rig.

The models of the switches and of the parameters are made from the tables of `piezod.plant`: only
there a parameter has its unit and bounds.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, get_args

import numpy as np
from pydantic import Field, create_model

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod.config.quantities import Name
from piezod.plant.effects import EFFECTS, without
from piezod.plant.laws import HysteresisLaw, PowerLaw
from piezod.plant.parameters import (
    AmplifierParameters,
    PlantParameters,
    SensorParameters,
    StageParameters,
    quantities,
    specimen,
)
from piezod.plant.variants import VARIANTS
from piezod_drivers.simulated.calibration import MIN_STEPS, check_sensor
from piezod_drivers.simulated.camera import CameraOptions

MIN_TRAVEL_UM = 0.01
"""Smallest travel of a stage, in µm."""
MIN_KNOT_STEP_V = 1e-6
"""Points of a table that are closer than this have no reliable slope."""


class Commissioned(ConfigModel):
    """The sensor's curve was measured against a reference at commissioning."""

    kind: Literal["commissioned"] = "commissioned"
    residual_pct: Annotated[float, Quantity(0, 5, "%")] = Field(
        0.05, description="greatest remaining error, % of travel"
    )


class SensorLine(ConfigModel):
    """Only a straight line is known for the sensor."""

    kind: Literal["line"] = "line"


class SensorTable(ConfigModel):
    """The configuration contains the curve."""

    kind: Literal["table"] = "table"
    sensor_v: tuple[Annotated[float, Quantity(-100, 100, "V")], ...] = Field(
        min_length=2, max_length=10_000, description="sensor voltages in V, strictly monotonic"
    )
    position_um: tuple[Annotated[float, Quantity(-1e5, 1e5, "µm")], ...] = Field(
        min_length=2,
        max_length=10_000,
        description="displacements in µm at those voltages, strictly monotonic",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        n_voltages, n_positions = len(self.sensor_v), len(self.position_um)
        if n_voltages != n_positions:
            what = f"one for each voltage is required (got {n_positions} for {n_voltages})"
            yield ("position_um",), what
        for key, values in (("sensor_v", self.sensor_v), ("position_um", self.position_um)):
            steps = [later - earlier for earlier, later in pairwise(values)]
            if not (all(step > 0 for step in steps) or all(step < 0 for step in steps)):
                yield (key,), "must be strictly rising or strictly falling"
        close_v = min(abs(later - earlier) for earlier, later in pairwise(self.sensor_v))
        if 0 < close_v < MIN_KNOT_STEP_V:
            what = f"two voltages are {close_v:g} V apart, allowed: at least {MIN_KNOT_STEP_V:g} V"
            yield ("sensor_v",), what


def _overrides(name: str, about: str, *parts: type[Any]) -> type[ConfigModel]:
    """Return the model of parts of the plant, in which every parameter is optional."""
    given: dict[str, Any] = {}
    for parameter, q in chain.from_iterable(quantities(part).items() for part in parts):
        number: Any = Annotated[float, Quantity(q.low, q.high, q.unit)]
        description = f"{q.about} ({q.unit or 'a number'})"
        given[parameter] = (number | None, Field(None, description=description))
    return create_model(name, __base__=ConfigModel, __doc__=about, **given)


def _switches() -> type[ConfigModel]:
    """Return the model that has one switch for each effect."""
    fields: dict[str, Any] = {
        effect: (bool, Field(True, description="whether the rig has this effect"))
        for effect in EFFECTS
    }
    return create_model("Effects", __base__=ConfigModel, __doc__="Effects of the rig.", **fields)


if TYPE_CHECKING:  # the fields are known only at run time
    Effects: TypeAlias = ConfigModel
    Stage: TypeAlias = ConfigModel
    Hysteresis: TypeAlias = ConfigModel
    Amplifier: TypeAlias = ConfigModel
    Sensor: TypeAlias = ConfigModel
else:
    Effects = _switches()
    Stage = _overrides("Stage", "Parameters of the stage that differ.", StageParameters)
    Hysteresis = _overrides(
        "Hysteresis",
        "Parameters of the class of hysteresis that differ.",
        *get_args(HysteresisLaw),
    )
    Amplifier = _overrides(
        "Amplifier", "Parameters of the amplifier that differ.", AmplifierParameters
    )
    Sensor = _overrides("Sensor", "Parameters of the sensor that differ.", SensorParameters)


class SimulatedOptions(ConfigModel):
    """Options of the simulated rig; every axis is a specimen of its own of the same variant."""

    variant: Literal[
        "stack",
        "stack-uncalibrated",
        "flexure",
        "afm",
        "preisach-exponential",
        "preisach-gaussian",
        "preisach-asymmetric",
        "thermal-relays",
        "bouc-wen",
        "dahl",
        "light-damping",
        "no-antialias",
        "gain-drift",
        "coleman-hodgdon",
        "duhem",
        "maxwell-slip",
        "bouc-wen-2",
        "rate-plays",
        "bipolar",
        "bent-sensor",
        "slow-amplifier",
        "several-small",
    ] = Field("stack", description="kind of stage")
    effects: Effects = Field(Effects(), description="switches, all on by default")
    stage: Stage = Field(Stage(), description="exact values; the others vary with the seed")
    hysteresis: Hysteresis = Field(
        Hysteresis(), description="exact values for the variant's class of hysteresis"
    )
    amplifier: Amplifier = Field(Amplifier(), description="exact values, as for the stage")
    sensor: Sensor = Field(Sensor(), description="exact values, as for the stage")
    calibration: (
        Annotated[Commissioned | SensorLine | SensorTable, Field(discriminator="kind")] | None
    ) = Field(None, description="known curve of the sensor; left out: that of the variant")

    coupling: dict[Name, dict[Name, Annotated[float, Quantity(-0.5, 0.5)]]] = Field(
        {}, description="axis: how far 1 µm of each other axis moves it, µm"
    )
    coupling_lag_s: Annotated[float, Quantity(0, 1, "s")] = Field(
        0.0, description="time constant with which it follows the other axes, s"
    )

    camera: CameraOptions | None = Field(
        None, description="what pulses the trigger input; left out: nothing"
    )

    sub_step_us: Literal[10, 20, 50] = Field(
        50, description="step of the physics, and shortest interval of a table, µs"
    )

    @property
    def sub_step_ns(self) -> int:
        """Step of the physics, in ns."""
        return self.sub_step_us * 1000

    def _broken_rules(self) -> Iterator[BrokenRule]:
        unused = list(self._unused_parameters())
        yield from unused
        if not unused:
            yield from _broken_rules(self._configured(VARIANTS[self.variant].parameters))

    def plant(self, seed: np.random.SeedSequence) -> PlantParameters:
        """Draw a specimen of the variant and apply the configured values.

        Raises:
            DeviceError: If the specimen's sensor cannot measure the travel.
        """
        # Configured values replace drawn ones, so they do not vary with the seed.
        drawn = self._configured(specimen(VARIANTS[self.variant].parameters, seed))
        check_sensor(drawn)
        return drawn

    def known_curve(self) -> Commissioned | SensorLine | SensorTable:
        """Return the known curve of the sensor."""
        if self.calibration is not None:
            return self.calibration
        variant = VARIANTS[self.variant]
        known = Commissioned(residual_pct=variant.residual_pct)
        return known if variant.calibrated else SensorLine()

    def _unused_parameters(self) -> Iterator[BrokenRule]:
        """Yield given parameters that the variant's class of hysteresis does not have."""
        law = type(VARIANTS[self.variant].parameters.hysteresis)
        of_power_law = () if law is PowerLaw else ("exponent", "skew")
        for part, given, unused in (
            ("stage", self.stage, of_power_law),
            ("hysteresis", self.hysteresis, Hysteresis.model_fields.keys() - quantities(law)),
        ):
            for name in given.model_dump(exclude_none=True):
                if name in unused:
                    what = f"the hysteresis of {self.variant!r} has no {name}; leave it out"
                    yield (part, name), what

    def _configured(self, drawn: PlantParameters) -> PlantParameters:
        configured = PlantParameters(
            stage=replace(drawn.stage, **self.stage.model_dump(exclude_none=True)),
            amplifier=replace(drawn.amplifier, **self.amplifier.model_dump(exclude_none=True)),
            sensor=replace(drawn.sensor, **self.sensor.model_dump(exclude_none=True)),
            hysteresis=replace(drawn.hysteresis, **self.hysteresis.model_dump(exclude_none=True)),
        )
        return without(
            configured, [name for name, on in self.effects.model_dump().items() if not on]
        )


def _broken_rules(plant: PlantParameters) -> Iterator[BrokenRule]:
    """Yield combinations that are impossible although each value is within its bounds."""
    stage, amplifier = plant.stage, plant.amplifier
    # "not >=" instead of "<", so that NaN is refused too.
    if not stage.travel_um >= MIN_TRAVEL_UM:
        what = (
            f"reversible_um and irreversible_um together are the travel "
            f"(got {stage.travel_um:g} µm), allowed: at least {MIN_TRAVEL_UM:g} µm"
        )
        yield ("stage",), what
    # An infinite number of bits is a converter without steps.
    if np.isinf(amplifier.dac_bits):
        return
    # The converter spans minus to plus its range.
    step_v = 2 * amplifier.dac_range_v / 2**amplifier.dac_bits * amplifier.gain
    allowed_v = stage.drive_v / MIN_STEPS
    if not step_v <= allowed_v:
        what = (
            f"dac_range_v, dac_bits and gain make steps of the drive (got {step_v:g} V), "
            f"allowed: at most {allowed_v:g} V, the stage's drive_v / {MIN_STEPS}"
        )
        yield ("amplifier",), what
