"""The configuration of a daemon: the devices and axes of a stage, and how its loop runs."""

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from piezod.config.axes import AxisConfig
from piezod.config.channel_rules import broken_devices
from piezod.config.devices import DeviceConfig
from piezod.config.fields import (
    BrokenRule,
    ConfigModel,
    Context,
    Drivers,
    Quantity,
    context_of,
    raise_rules,
)
from piezod.config.modes import Mode
from piezod.config.quantities import DriveV, Name, OneLine, Seed
from piezod.config.requests import ModeName
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml


class OnTargetConfig(ConfigModel):
    """When a position counts as reached."""

    tolerance_um: Annotated[float, Quantity(1e-6, 1000, "µm")] = Field(
        default=0.1, description="Largest error, µm."
    )
    settle_s: Annotated[float, Quantity(0, 60, "s")] = Field(
        default=0.05, description="For how long the error stays below that, s."
    )


class ConditioningConfig(ConfigModel):
    """The decaying swing after which the hysteresis' memory is known."""

    on_arm: bool = Field(default=False, description="Whether it follows each `arm`.")
    frequency_hz: Annotated[float, Quantity(0.01, 100, "Hz")] = Field(
        default=1.0, description="Frequency of the swing, Hz."
    )
    cycles: Annotated[int, Quantity(2, 100)] = Field(default=10, description="Number of swings.")


class SafetyConfig(ConfigModel):
    """What is done with an axis when something is wrong."""

    safe_v: DriveV | None = Field(default=None, description="Safe voltage, V; left out: rest_v.")
    ramp_v_per_s: Annotated[float, Quantity(0.1, 1e6, "V/s")] = Field(
        default=50.0, description="How fast the voltage goes there, V/s."
    )
    estop: Literal["ramp", "cut"] = Field(
        default="ramp",
        description="Emergency stop: ramp, or have the amplifier cut its output at once.",
    )


class StageAxisConfig(AxisConfig):
    """An axis that a daemon owns."""

    speed_um_per_s: Annotated[float, Quantity(1e-3, 1e6, "µm/s")] = Field(
        default=100.0, description="Highest speed on the way to a position, µm/s."
    )
    on_target: OnTargetConfig = Field(
        default=OnTargetConfig(), description="When a position counts as reached."
    )
    conditioning: ConditioningConfig = Field(
        default=ConditioningConfig(), description="The swing that makes the memory known."
    )
    safety: SafetyConfig = Field(default=SafetyConfig(), description="When something is wrong.")

    @property
    def safe_v(self) -> float:
        """The safe voltage, in V."""
        return self.limits.rest_v if self.safety.safe_v is None else self.safety.safe_v

    @model_validator(mode="after")
    def _check_stage(self) -> Self:
        low, high = self.limits.drive_min_v, self.limits.drive_max_v
        broken: list[BrokenRule] = []
        if not low <= self.safe_v <= high:
            what = f"out of range (got {self.safe_v:g} V), allowed range {low:g} to {high:g} V"
            broken.append((("safety", "safe_v"), what))
        if self.safety.ramp_v_per_s > self.limits.slew_v_per_s:
            what = (
                f"faster than slew_v_per_s (got {self.safety.ramp_v_per_s:g} V/s), "
                f"allowed: at most {self.limits.slew_v_per_s:g} V/s"
            )
            broken.append((("safety", "ramp_v_per_s"), what))
        if self.model is None and self.command_range_um is None:
            broken.append((("command_range_um",), "needed where there is no model file"))
        raise_rules(broken)
        return self


class LoopConfig(ConfigModel):
    """How the loop process asks the operating system for punctuality."""

    spin_us: Annotated[float, Quantity(0, 1000, "µs")] = Field(
        default=40.0, description="How long before the deadline sleeping ends and spinning begins."
    )
    priority: Annotated[int, Quantity(1, 98)] = Field(
        default=60, description="Priority under SCHED_FIFO."
    )
    cpu: Annotated[int, Quantity(0, 4095)] | None = Field(
        default=None, description="Processor to stay on; left out: the last one allowed."
    )
    strict_rt: bool = Field(
        default=False, description="Whether arming is refused where any of it was not obtained."
    )


class DaemonConfig(ConfigModel):
    """A stage, and the loop that owns it."""

    title: OneLine = Field(default="", max_length=80, description="What it is, for people.")
    rate_hz: Annotated[float, Quantity(1, 20_000, "Hz")] = Field(
        description="Cycles of the loop per second, Hz."
    )
    seed: Seed = Field(default=1, description="Decides about everything random in the devices.")
    devices: dict[Name, DeviceConfig] = Field(min_length=1, description="Name: device.")
    axes: dict[Name, StageAxisConfig] = Field(
        min_length=1, max_length=16, description="Name: axis."
    )
    mode: ModeName = Field(
        default=Mode.FEEDFORWARD, description="Mode after `arm`, until another is chosen."
    )
    loop: LoopConfig = Field(default=LoopConfig(), description="Punctuality.")

    @model_validator(mode="after")
    def _check_rules(self, info: ValidationInfo) -> Self:
        raise_rules(broken_devices(self.devices, self.axes, context_of(info).drivers))
        return self


def load_daemon(path: Path, drivers: Drivers) -> DaemonConfig:
    """Read the configuration of a daemon.

    Args:
        path: The YAML file; paths in it are relative to its folder.
        drivers: The drivers there are, `piezod.devices.registry`; only those that the file names
            are loaded.

    Raises:
        ConfigError: If it is no valid configuration; the text lists every problem with its place.
    """
    return validate(load_yaml(path), DaemonConfig, Context(path.parent, drivers))
