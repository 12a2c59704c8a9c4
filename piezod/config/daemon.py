"""The configuration of a daemon: the devices and axes of a stage, and its loop."""

from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from piezod.config.axes import STOPS_DELAY_S, AxisConfig
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
from piezod.config.lines import MOST_LINES, LineConfig
from piezod.config.modes import SENSED, Mode
from piezod.config.quantities import DriveV, ModeName, Name, OneLine, Seed
from piezod.config.transform import TransformConfig, UserAxisConfig
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml


class OnTargetConfig(ConfigModel):
    """Criterion for a reached position."""

    tolerance_um: Annotated[float, Quantity(1e-6, 1000, "µm")] = Field(
        default=0.1, description="Largest error, µm."
    )
    settle_s: Annotated[float, Quantity(0, 60, "s")] = Field(
        default=0.05, description="Time for which the error must stay below the tolerance, s."
    )


class ConditioningConfig(ConfigModel):
    """The swings after which the hysteresis memory is known."""

    on_arm: bool = Field(default=False, description="Whether each `arm` starts it.")
    frequency_hz: Annotated[float, Quantity(0.01, 100, "Hz")] = Field(
        default=1.0, description="Frequency of the swing, Hz."
    )
    cycles: Annotated[int, Quantity(2, 100)] = Field(default=10, description="Number of swings.")


class SafetyConfig(ConfigModel):
    """Reactions of an axis to faults."""

    safe_v: DriveV | None = Field(default=None, description="Safe voltage, V; default: rest_v.")
    ramp_v_per_s: Annotated[float, Quantity(0.1, 1e6, "V/s")] = Field(
        default=50.0, description="Rate of the ramp to the safe voltage, V/s."
    )
    estop: Literal["ramp", "cut"] = Field(
        default="ramp",
        description="Emergency stop: ramp, or make the amplifier cut its output at once.",
    )


class StageAxisConfig(AxisConfig):
    """An axis of a daemon."""

    speed_um_per_s: Annotated[float, Quantity(1e-3, 1e6, "µm/s")] = Field(
        default=100.0, description="Highest speed on the way to a position, µm/s."
    )
    on_target: OnTargetConfig = Field(
        default=OnTargetConfig(), description="Criterion for a reached position."
    )
    conditioning: ConditioningConfig = Field(
        default=ConditioningConfig(), description="Swing after which the memory is known."
    )
    safety: SafetyConfig = Field(default=SafetyConfig(), description="Reactions to faults.")

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
        # The guard limits every voltage to the slew rate; a faster ramp would take longer than set.
        if self.safety.ramp_v_per_s > self.limits.slew_v_per_s:
            what = (
                f"faster than slew_v_per_s (got {self.safety.ramp_v_per_s:g} V/s), "
                f"allowed: at most {self.limits.slew_v_per_s:g} V/s"
            )
            broken.append((("safety", "ramp_v_per_s"), what))
        # With a model file the range of commands follows from the model.
        if self.model is None and self.command_range_um is None:
            broken.append((("command_range_um",), "needed if there is no model file"))
        if self.compensator.has_negative_delay:
            what = f"out of range (got {self.compensator.delay_s} s), {STOPS_DELAY_S}"
            broken.append((("compensator", "delay_s"), what))
        raise_rules(broken)
        return self


class LoopConfig(ConfigModel):
    """Real-time settings of the loop process."""

    spin_us: Annotated[float, Quantity(0, 1000, "µs")] = Field(
        default=40.0,
        description="Time before the deadline at which spinning replaces sleeping, µs.",
    )
    priority: Annotated[int, Quantity(1, 98)] = Field(
        default=60, description="Priority under SCHED_FIFO."
    )
    cpu: Annotated[int, Quantity(0, 4095)] | None = Field(
        default=None,
        description="Processor of the loop; default: the last allowed one without the loop of "
        "another stage, or with the fewest.",
    )
    strict_rt: bool = Field(
        default=False, description="Whether arming is refused if any of these was not obtained."
    )


class RecordingsConfig(ConfigModel):
    """Size of recordings; without limits a recording is one file."""

    max_file_s: Annotated[float, Quantity(1, 1e7, "s")] | None = Field(
        default=None, description="Time after which a recording goes on in another file, s."
    )
    max_file_mb: Annotated[float, Quantity(1, 1e6, "MB")] | None = Field(
        default=None, description="Size after which a recording goes on in another file, MB."
    )
    max_total_mb: Annotated[float, Quantity(1, 1e9, "MB")] | None = Field(
        default=None,
        description="Size of all recordings, MB; the oldest finished files are removed, except "
        "those that `piezod record keep` has marked.",
    )


class DaemonConfig(ConfigModel):
    """A stage, and the loop that owns it."""

    title: OneLine = Field(default="", max_length=80, description="Description, for people.")
    rate_hz: Annotated[float, Quantity(1, 20_000, "Hz")] = Field(
        description="Cycles of the loop per second, Hz."
    )
    seed: Seed = Field(default=1, description="Seed of all random numbers of the devices.")
    devices: dict[Name, DeviceConfig] = Field(min_length=1, description="Name: device.")
    axes: dict[Name, StageAxisConfig] = Field(
        min_length=1, max_length=16, description="Name: axis."
    )
    lines: dict[Name, LineConfig] = Field(
        default_factory=dict,
        max_length=MOST_LINES,
        description="Name: digital input that the loop reads, or digital output that it sets.",
    )
    transform: TransformConfig | None = Field(
        default=None, description="User axes that several axes make; default: none."
    )
    mode: ModeName = Field(
        default=Mode.FEEDFORWARD, description="Mode after `arm`, until another one is chosen."
    )
    loop: LoopConfig = Field(default=LoopConfig(), description="Real-time settings.")
    recordings: RecordingsConfig = Field(
        default=RecordingsConfig(), description="Size of recordings."
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_experiment(cls, data: object) -> object:
        if isinstance(data, dict) and "cases" in data:
            what = "this is an experiment, not a stage: run it with `piezod experiment`"
            raise_rules([(("cases",), what)])
        return data

    @model_validator(mode="after")
    def _check_rules(self, info: ValidationInfo) -> Self:
        broken = broken_devices(self.devices, self.axes, context_of(info).drivers, self.lines)
        coordinates = () if self.transform is None else self.transform.broken(self.axes)
        raise_rules(chain(self._broken_mode(), broken, coordinates))
        return self

    @property
    def user_axes(self) -> Mapping[str, UserAxisConfig]:
        """The user axes by name; empty if there are none."""
        return {} if self.transform is None else self.transform.axes

    def moved_by(self, axis: str) -> str:
        """Return the user axes that move an axis, for people; empty if it is moved by itself."""
        moved = self.transform is not None and axis in self.transform.actuators
        return ", ".join(self.user_axes) if moved else ""

    def unit(self, axis: str) -> str:
        """Return the unit of the positions of an axis."""
        user = self.user_axes.get(axis)
        return "µm" if user is None else user.unit

    @property
    def shown_axes(self) -> tuple[str, ...]:
        """Names of all axes in the order of records: the axes, then the user axes."""
        return (*self.axes, *self.user_axes)

    def _broken_mode(self) -> Iterator[BrokenRule]:
        blind = [name for name, axis in self.axes.items() if axis.sensor is None]
        if blind and self.mode in SENSED:
            what = f"{self.mode} needs a sensor on every axis, {', '.join(blind)} has none: "
            yield ("mode",), f"{what}use feedforward or uncompensated"


def load_daemon(
    path: Path, drivers: Drivers, named_files: dict[str, str] | None = None
) -> DaemonConfig:
    """Read the configuration of a daemon.

    Args:
        path: Path of the YAML file; paths in it are relative to its folder.
        drivers: Available drivers, `piezod.devices.registry`; only drivers in the file are loaded.
        named_files: Gets the digest of each file that the configuration names, by its absolute
            path; None to drop them.

    Raises:
        ConfigError: If it is not a valid configuration; the text lists every problem with its
            place.
    """
    context = Context(path.parent, drivers)
    config = validate(load_yaml(path), DaemonConfig, context)
    if named_files is not None:
        named_files.update(context.named_files)
    return config
