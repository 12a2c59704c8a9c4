"""The fields of an experiment file, without the rules that span several of them."""

from collections.abc import Iterable
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from piezod.config.axes import AxisConfig
from piezod.config.commands import Command, CommandPerAxis
from piezod.config.devices import DeviceConfig
from piezod.config.fields import ConfigModel, raise_rules
from piezod.config.modes import Mode
from piezod.config.play import PlayConfig
from piezod.config.quantities import (
    DurationS,
    ModeName,
    Name,
    OneLine,
    PauseS,
    PercentOfRange,
    RateHz,
    Seed,
)
from piezod.config.scan import ScanConfig
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.waveform import Timed

Metric: TypeAlias = Literal[
    "tracking_max_pct",
    "tracking_rms_pct",
    "nonlinearity_pct",
    "true_tracking_max_pct",
    "true_tracking_rms_pct",
    "true_nonlinearity_pct",
    "noise_rms_pct",
]
Method: TypeAlias = Literal["lms", "least-squares", "surface"]


class IdentificationConfig(ConfigModel):
    """Identification of the model, for axes without a model file."""

    method: Method = Field(description="Method of the fit to the recorded run.")
    settle_s: PauseS = Field(description="Rest before the run, s.")
    run_in_s: PauseS = Field(
        default=0.0,
        description="First part of the run, excluded while the stage settles, s.",
    )
    duration_s: DurationS = Field(description="Length of the run, s.")
    drive_v: WaveformConfig = Field(description="Open-loop drive voltage of these axes, V.")


class CaseConfig(Timed):
    """One command, run in every mode."""

    name: OneLine = Field(min_length=1, max_length=40, description="Name.")
    title: OneLine = Field(default="", max_length=80, description="Description, for people.")
    period_s: DurationS = Field(
        description="First period of the command, excluded from the metrics, s."
    )
    duration_s: DurationS = Field(description="Length, s.")
    command_um: Command = Field(
        description="Commanded position, µm: one for all axes, or `axes:` with one for each axis."
    )
    reference_pct: dict[ModeName, PercentOfRange] = Field(
        default_factory=dict,
        description="Mode: reference for the tracking error and the nonlinearity, %.",
    )

    reference_figure: dict[ModeName, Annotated[OneLine, Field(min_length=1, max_length=40)]] = (
        Field(
            default_factory=dict,
            description="Mode: figure of the reference that shows this run, as in `Fig. 7`.",
        )
    )

    @model_validator(mode="after")
    def _check_duration(self) -> Self:
        if not self.duration_s > self.period_s:
            what = f"must be longer than period_s, {self.period_s:g} s (got {self.duration_s:g} s)"
            raise_rules([(("duration_s",), what)])
        return self

    def commands(self, axes: Iterable[str]) -> dict[str, WaveformConfig]:
        """Return the command of each axis.

        Args:
            axes: Names of the experiment's axes.
        """
        if isinstance(self.command_um, CommandPerAxis):
            return self.command_um.axes
        return dict.fromkeys(axes, self.command_um)


class ExperimentFields(ConfigModel):
    """The fields of an experiment."""

    title: OneLine = Field(default="", max_length=80, description="Title, for people.")
    rate_hz: RateHz = Field(description="Cycles of the loop per second, Hz.")
    seed: Seed = Field(default=1, description="Seed of all random numbers of the devices.")
    devices: dict[Name, DeviceConfig] = Field(min_length=1, description="Name: device.")
    axes: dict[Name, AxisConfig] = Field(min_length=1, description="Name: axis.")
    identification: IdentificationConfig | None = Field(
        default=None, description="Identification; must be absent if every axis has a model file."
    )
    modes: tuple[ModeName, ...] = Field(
        default=(Mode.UNCOMPENSATED, Mode.FEEDFORWARD, Mode.ADAPTIVE),
        min_length=1,
        description="Modes in which each case is run.",
    )
    metrics: tuple[Metric, ...] = Field(
        default=("tracking_max_pct", "tracking_rms_pct", "nonlinearity_pct"),
        min_length=1,
        description="Metrics that are reported for each run.",
    )
    settle_s: PauseS = Field(
        default=2.0, description="Rest before each run, s; the sensor is zeroed at its end."
    )
    reference: OneLine = Field(
        default="reference",
        min_length=1,
        max_length=40,
        description="Source of the errors in `reference_pct` of the cases.",
    )
    cases: tuple[CaseConfig, ...] = Field(
        default=(), description="The cases; must be absent with `play`."
    )
    play: PlayConfig | None = Field(
        default=None, description="Waveforms that a device plays from a table, in place of cases."
    )
    scan: ScanConfig | None = Field(
        default=None, description="A scan that a device plays from a table, in place of cases."
    )
