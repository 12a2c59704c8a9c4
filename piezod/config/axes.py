"""Axes: their devices, drive limits and compensation."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self, TypeAlias

from pydantic import (
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from piezod.config.channels import Input, InputConfig, Output, OutputConfig, SensorInput
from piezod.config.fields import (
    BrokenRule,
    ConfigModel,
    Quantity,
    context_of,
    raise_rules,
)
from piezod.config.files import ExistingFile
from piezod.config.first_mode import FirstModeConfig
from piezod.config.model_file import FILE_DELAY_S, load_model
from piezod.config.plausible import Sheet, Span, misfits_of_axis, misfits_of_model
from piezod.config.quantities import DriveV, PositionUm
from piezod.config.response_file import LoadedResponse
from piezod.config.trim import ClosedConfig, TrimConfig
from piezod.errors import ConfigError


def _auto_or_number(value: object) -> str:
    return "auto" if isinstance(value, str) else "number"


# "auto": from the recorded data. The tags make pydantic report one error and not one per member.
DelayS: TypeAlias = Annotated[
    Annotated[Literal["auto"], Tag("auto")] | Annotated[float, FILE_DELAY_S, Tag("number")],
    Discriminator(_auto_or_number),
]

# Keys of the compensator that a model file replaces, and their names in messages.
_SET_BY_MODEL: Final = {
    "operators": "operators",
    "thresholds": "thresholds",
    "creep": "creep",
    "delay_s": "delay",
}


class LimitsConfig(ConfigModel):
    """Drive limits of an axis."""

    drive_min_v: DriveV = Field(description="Lowest drive voltage, V.")
    drive_max_v: DriveV = Field(description="Highest drive voltage, V.")
    slew_v_per_s: Annotated[float, Quantity(1, 1e9, "V/s")] = Field(
        description="Fastest change of the drive voltage, V/s."
    )
    rest_v: DriveV = Field(description="Drive voltage at rest, V.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        low, high = self.drive_min_v, self.drive_max_v
        if not low < high:
            what = f"must be above drive_min_v (got {high:g} V, drive_min_v is {low:g} V)"
            raise_rules([(("drive_max_v",), what)])
        if not low <= self.rest_v <= high:
            what = f"out of range (got {self.rest_v:g} V), allowed range {low:g} to {high:g} V"
            raise_rules([(("rest_v",), what)])
        return self


STOPS_DELAY_S: Final = Quantity(0, FILE_DELAY_S.high, "s")
"""Delays with which stop operators are fitted; a surface also takes negative ones."""


class CompensatorConfig(ConfigModel):
    """The inverse model of an axis, and its identification."""

    operators: Annotated[int, Quantity(1, 200)] = Field(
        default=19, description="Number of stop operators on each side."
    )
    thresholds: Literal["even", "graded", "placed"] = Field(
        default="even",
        description="Spacing of their thresholds: even, denser at both ends, or from the data.",
    )
    creep: bool = Field(
        default=False, description="Whether creep is identified and compensated too."
    )
    identifier: Literal["lms", "nlms", "rls"] = Field(
        default="rls",
        description="Online identifier: the paper's LMS, normalised LMS, or least squares; "
        "default: rls, or lms if lms_gain is given.",
    )
    lms_gain: Annotated[float, Quantity(0, 1)] = Field(
        default=0.1, description="Gain of an LMS identifier: γ of the paper, μ if normalised."
    )
    deadband_pct: Annotated[float, Quantity(0, 5, "%")] = Field(
        default=0.1,
        description="Dead-band of the memory: smaller reversals are ignored, % of the range.",
    )
    learned_pct: Annotated[float, Quantity(1, 30, "%")] = Field(
        default=5.0,
        description="How far the learned model may be from the identified one: largest difference "
        "of their drives, % of the range.",
    )
    delay_s: DelayS = Field(
        default="auto", description="Delay from drive to sensor, s; auto: from the recorded data."
    )
    sensor_delay_s: Annotated[float, Quantity(0, 0.1, "s")] = Field(
        default=0.0, description="Part of that delay that is due to the sensor and its filter, s."
    )

    @property
    def has_negative_delay(self) -> bool:
        """Whether a negative delay is given, which only a surface can have."""
        return self.delay_s != "auto" and self.delay_s < STOPS_DELAY_S.low

    @model_validator(mode="before")
    @classmethod
    def _lms_if_it_has_a_gain(cls, data: Any, info: ValidationInfo) -> Any:
        # Files that give a gain without an identifier are from a time when LMS was the default.
        if isinstance(data, dict) and "lms_gain" in data and "identifier" not in data:
            # Messages look up the mapping of the file, not the copy.
            context_of(info).known_keys[id(data)] = tuple(cls.model_fields)
            return {**data, "identifier": "lms"}
        return data

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.identifier == "rls" and "lms_gain" in self.model_fields_set:
            yield ("lms_gain",), "not used, identifier rls has no gain, leave it out"
        if self.identifier != "rls" and self.thresholds != "even":
            # With thresholds close to 0, LMS amplifies the noise of the sensor and diverges.
            what = f"{self.thresholds} needs identifier rls (identifier is {self.identifier})"
            yield ("thresholds",), what


class AxisConfig(ConfigModel):
    """An axis of the stage."""

    amplifier: Output = Field(
        description="Amplifier: name of a device, or a channel of it with its calibration."
    )
    sensor: SensorInput | None = Field(
        default=None,
        description="Sensor: name of a device, or a channel of it with its calibration; default: "
        "the axis has none, and only the modes uncompensated and feedforward.",
    )
    command_input: Input | None = Field(
        default=None, description="Input that commands the axis in `piezod follow`."
    )
    limits: LimitsConfig = Field(description="Drive limits.")
    command_range_um: tuple[PositionUm, PositionUm] | None = Field(
        default=None, description="Lowest and highest allowed command, µm."
    )
    expected_travel_um: Annotated[float, Quantity(1e-3, 100_000, "µm")] | None = Field(
        default=None,
        description="Travel of the stage by its data sheet, µm: a model far from it is refused.",
    )
    expected_volts: Annotated[float, Quantity(0.01, 4000, "V")] | None = Field(
        default=None,
        description="Range of the voltage for that travel, V; default: that of the limits.",
    )
    response: LoadedResponse | None = Field(
        default=None, description="Response file: the linear dynamics; default: not known."
    )
    first_mode: FirstModeConfig | None = Field(
        default=None,
        validate_default=True,
        description="First mechanical mode; default: that of the response, if there is one.",
    )
    compensator: CompensatorConfig = Field(
        default=CompensatorConfig(), description="Inverse model."
    )
    trim: TrimConfig = Field(default=TrimConfig(), description="Trim of mode `trimmed`.")
    closed: ClosedConfig = Field(default=ClosedConfig(), description="Feedback of mode `closed`.")
    model: ExistingFile | None = Field(
        default=None, description="Model file; replaces the identification."
    )

    def channels(self) -> Iterator[tuple[str, OutputConfig | InputConfig]]:
        """Yield every channel of the axis, with its key."""
        yield "amplifier", self.amplifier
        if self.sensor is not None:
            yield "sensor", self.sensor
        if self.command_input is not None:
            yield "command_input", self.command_input

    @field_validator("first_mode")
    @classmethod
    def _first_mode_of_response(
        cls, given: FirstModeConfig | None, info: ValidationInfo
    ) -> FirstModeConfig | None:
        response = info.data.get("response")  # absent if it is not valid
        if given is not None or response is None or response.first_mode is None:
            return given
        mode = response.first_mode
        return FirstModeConfig(frequency_hz=mode.frequency_hz, damping=mode.damping)

    def misfits(self, span: Span) -> Iterator[str]:
        """Yield why a model, or the record of one, is not that of this axis, each with a remedy."""
        limits_v = (self.limits.drive_min_v, self.limits.drive_max_v)
        yield from misfits_of_model(span, limits_v, self.command_range_um, self._sheet())

    def _sheet(self) -> Sheet | None:
        """Return what the data sheet says, None if it is not given."""
        if self.expected_travel_um is None:
            return None
        volts = self.expected_volts or self.limits.drive_max_v - self.limits.drive_min_v
        return Sheet(self.expected_travel_um, volts)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        if self.model is not None:
            yield from self._broken_model(self.model)
        if sheet := self._sheet():
            limits_v = (self.limits.drive_min_v, self.limits.drive_max_v)
            for what in misfits_of_axis(limits_v, self.command_range_um, sheet):
                yield ("expected_travel_um",), what
        elif self.expected_volts is not None:
            yield ("expected_volts",), "needs expected_travel_um, the travel for these volts"
        if self.command_range_um and not self.command_range_um[0] < self.command_range_um[1]:
            yield ("command_range_um", 1), "must be above the first of the two"
        low_v, high_v = self.amplifier.calibration.physical_range()
        # Beyond its calibration an amplifier refuses every write.
        for key in ("drive_min_v", "drive_max_v"):
            limit_v = getattr(self.limits, key)
            if not low_v <= limit_v <= high_v:
                what = f"outside the calibration of the amplifier (got {limit_v:g} V)"
                yield ("limits", key), f"{what}, allowed range {low_v:g} to {high_v:g} V"

    def _broken_model(self, model: Path) -> Iterator[BrokenRule]:
        try:
            yield from ((("model",), what) for what in self.misfits(load_model(model).span))
        except ConfigError as error:
            yield ("model",), str(error.problems[0])  # with file and line of the model file
        for key, own in _SET_BY_MODEL.items():
            if key in self.compensator.model_fields_set:
                what = f"not used, the model file has its own {own}, leave it out"
                yield ("compensator", key), what
