"""What an experiment file may say: its fields, before the rules that span several of them."""

from collections.abc import Iterable
from typing import Literal, Self, TypeAlias

from pydantic import Field, model_validator

from piezod.config.axes import AxisConfig
from piezod.config.combined_waveforms import WaveformConfig
from piezod.config.commands import Command, CommandPerAxis
from piezod.config.devices import DeviceConfig
from piezod.config.fields import ConfigModel, raise_rules
from piezod.config.modes import Mode
from piezod.config.quantities import (
    DurationS,
    Name,
    OneLine,
    PauseS,
    PercentOfRange,
    RateHz,
    Seed,
)
from piezod.config.requests import ModeName

Metric: TypeAlias = Literal[
    "tracking_max_pct",
    "tracking_rms_pct",
    "nonlinearity_pct",
    "true_tracking_max_pct",
    "true_nonlinearity_pct",
    "noise_rms_pct",
]
Method: TypeAlias = Literal["lms", "least-squares"]


class IdentificationConfig(ConfigModel):
    """How the model of the axes that have none is identified."""

    method: Method = Field(description="Fit of the recorded run.")
    settle_s: PauseS = Field(description="Rest before the run, s.")
    run_in_s: PauseS = Field(
        default=0.0,
        description="First part of the run, which does not count: the stage settles in it, s.",
    )
    duration_s: DurationS = Field(description="Length of the run, s.")
    drive_v: WaveformConfig = Field(description="Open-loop drive of all these axes, V.")


class CaseConfig(ConfigModel):
    """One command, run in every mode."""

    name: OneLine = Field(min_length=1, max_length=40, description="Its name.")
    title: OneLine = Field(default="", max_length=80, description="What it shows.")
    period_s: DurationS = Field(
        description="First period of the command, excluded from the metrics, s."
    )
    duration_s: DurationS = Field(description="Length, s.")
    command_um: Command = Field(
        description="Commanded position, µm: one for all axes, or `axes:` with one for each."
    )
    reference_pct: dict[ModeName, PercentOfRange] = Field(
        default_factory=dict,
        description="Mode: error to compare tracking and nonlinearity with, %.",
    )

    @model_validator(mode="after")
    def _check_duration(self) -> Self:
        if not self.duration_s > self.period_s:
            what = f"must be longer than period_s, {self.period_s:g} s (got {self.duration_s:g} s)"
            raise_rules([(("duration_s",), what)])
        return self

    def commands(self, axes: Iterable[str]) -> dict[str, WaveformConfig]:
        """Give the command of each axis.

        Args:
            axes: Names of the experiment's axes.
        """
        if isinstance(self.command_um, CommandPerAxis):
            return self.command_um.axes
        return dict.fromkeys(axes, self.command_um)


class ExperimentFields(ConfigModel):
    """The fields of an experiment."""

    title: OneLine = Field(default="", max_length=80, description="What it is, for people.")
    rate_hz: RateHz = Field(description="Cycles of the loop per second, Hz.")
    seed: Seed = Field(default=1, description="Decides about everything random in the devices.")
    devices: dict[Name, DeviceConfig] = Field(min_length=1, description="Name: device.")
    axes: dict[Name, AxisConfig] = Field(min_length=1, description="Name: axis.")
    identification: IdentificationConfig | None = Field(
        default=None, description="Left out if every axis starts from a model file."
    )
    modes: tuple[ModeName, ...] = Field(
        default=(Mode.UNCOMPENSATED, Mode.FEEDFORWARD, Mode.ADAPTIVE),
        min_length=1,
        description="How each case is run.",
    )
    metrics: tuple[Metric, ...] = Field(
        default=("tracking_max_pct", "tracking_rms_pct", "nonlinearity_pct"),
        min_length=1,
        description="What is reported of each run.",
    )
    settle_s: PauseS = Field(
        default=2.0, description="Rest before each run, s; the sensor is zeroed at its end."
    )
    reference: OneLine = Field(
        default="reference",
        min_length=1,
        max_length=40,
        description="Whose errors `reference_pct` of the cases are.",
    )
    cases: tuple[CaseConfig, ...] = Field(min_length=1, description="The cases.")
