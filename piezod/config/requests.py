"""What the owner of a stage may be asked to do, as clients, the service and the loop write it.

Every request is a small model with a `kind`. `axis` names the axis that is meant; left out, it is
the only one, or all of them where that makes sense.
"""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.combined_waveforms import WaveformConfig
from piezod.config.fields import ConfigModel, Quantity
from piezod.config.model_file import ModelFile
from piezod.config.modes import Mode
from piezod.config.quantities import DurationS, Name, PositionUm

# Files and clients have a mode's name; strict validation would ask for the enumeration's member.
ModeName: TypeAlias = Annotated[Mode, Field(strict=False)]
Waveforms: TypeAlias = Annotated[dict[Name, WaveformConfig], Field(min_length=1)]
AxisName: TypeAlias = Name | None


class Arm(ConfigModel):
    """SAFE to READY: take over the voltage that is read back, hold it."""

    kind: Literal["arm"] = "arm"
    shadow: bool = Field(default=False, description="Compute everything, write nothing.")
    confirm_output: bool = Field(
        default=False,
        description="Somebody has seen that the output is at the safe voltage: for amplifiers that "
        "do not read back.",
    )


class Disarm(ConfigModel):
    """Ramp to the safe voltage, then SAFE."""

    kind: Literal["disarm"] = "disarm"


class SelectMode(ConfigModel):
    """Choose how the drive is made from the command; from READY on this starts RUN."""

    kind: Literal["mode"] = "mode"
    mode: ModeName
    axis: AxisName = None


class Goto(ConfigModel):
    """Move to a position and stay; from READY on this starts RUN in the mode chosen last."""

    kind: Literal["goto"] = "goto"
    axis: AxisName = None
    position_um: PositionUm
    speed_um_per_s: Annotated[float, Quantity(1e-3, 1e6, "µm/s")] | None = None


class Wave(ConfigModel):
    """Follow a waveform, from where the stage is; its last value is held at the end."""

    kind: Literal["wave"] = "wave"
    command_um: Waveforms = Field(description="Axis: position over time, µm.")
    duration_s: DurationS


class Stream(ConfigModel):
    """Follow the setpoints of a stream; HOLD as soon as they stop."""

    kind: Literal["stream"] = "stream"
    axes: tuple[Name, ...] = Field(min_length=1)


class Follow(ConfigModel):
    """Follow what the command inputs of axes tell; HOLD as soon as one tells nothing usable."""

    kind: Literal["follow"] = "follow"
    axis: AxisName = None


class Hold(ConfigModel):
    """Hold the voltage that is in force."""

    kind: Literal["hold"] = "hold"


class Resume(ConfigModel):
    """HOLD to RUN: go on from where the stage is."""

    kind: Literal["resume"] = "resume"


class Stop(ConfigModel):
    """Ramp to the safe voltage, then SAFE."""

    kind: Literal["stop"] = "stop"


class Estop(ConfigModel):
    """Emergency stop."""

    kind: Literal["estop"] = "estop"


class Reset(ConfigModel):
    """FAULT to SAFE, where no fault is present any more."""

    kind: Literal["reset"] = "reset"
    engineer: bool = Field(default=False, description="Whether latches of level 3 may be reset.")


class Condition(ConfigModel):
    """Drive a decaying swing, so that the hysteresis' memory is known; ends at the rest voltage."""

    kind: Literal["condition"] = "condition"
    axis: AxisName = None


class Zero(ConfigModel):
    """Call the displacement at the rest voltage zero."""

    kind: Literal["zero"] = "zero"
    axis: AxisName = None


class Identify(ConfigModel):
    """Drive voltages from rest, for a record to fit a model to; ends at the rest voltage."""

    kind: Literal["identify"] = "identify"
    drive_v: Waveforms = Field(description="Axis: drive over time, V; others rest.")
    duration_s: DurationS


class AdoptModel(ConfigModel):
    """Use another model from now on; only while disarmed."""

    kind: Literal["adopt"] = "adopt"
    axis: AxisName = None
    model: ModelFile
    zero_um: PositionUm | None = Field(default=None, description="Sensor zero to restore, µm.")


class Shutdown(ConfigModel):
    """Ramp to the safe voltage and end."""

    kind: Literal["shutdown"] = "shutdown"


Request: TypeAlias = Annotated[
    Arm
    | Disarm
    | SelectMode
    | Goto
    | Wave
    | Stream
    | Follow
    | Hold
    | Resume
    | Stop
    | Estop
    | Reset
    | Condition
    | Zero
    | Identify
    | AdoptModel
    | Shutdown,
    Field(discriminator="kind"),
]
