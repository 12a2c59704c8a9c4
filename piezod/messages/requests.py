"""The requests to the owner of a stage, and the table of commands with their classes.

Clients, the service and the loop use the same classes: each is a small model with a `kind`, which
is the name of its row in `piezod.messages.endpoints`. `axis` names one axis; if it is None, the
request is for the only axis, or for all axes if the request allows several.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Final, Literal, TypeAlias, get_args

from pydantic import Field

from piezod.config.fields import ConfigModel, Quantity
from piezod.config.model_file import ModelFile
from piezod.config.quantities import DriveV, DurationS, ModeName, Name, PositionUm, StartS
from piezod.config.waveforms.combined import WaveformConfig
from piezod.messages.endpoints import ENDPOINTS, REQUEST_ROWS, Endpoint

Waveforms: TypeAlias = Annotated[dict[Name, WaveformConfig], Field(min_length=1)]
AxisName: TypeAlias = Name | None
TableV: TypeAlias = Annotated[tuple[DriveV, ...], Field(max_length=16_000)]


class Arm(ConfigModel):
    """Take over the read-back voltage and hold it."""

    kind: Literal["arm"] = "arm"
    shadow: bool = Field(default=False, description="Compute everything, write nothing.")
    confirm_output: bool = Field(
        default=False,
        description="You have seen that the output is at its read-back, whatever contradicts it; "
        "without a read-back, that it is at the safe voltage.",
    )


class Disarm(ConfigModel):
    """Ramp to the safe voltage, then write nothing more."""

    kind: Literal["disarm"] = "disarm"


class SelectMode(ConfigModel):
    """Select the mode: how piezod computes the drive voltage."""

    kind: Literal["mode"] = "mode"
    mode: ModeName
    axis: AxisName = None


class Goto(ConfigModel):
    """Move to a position and stay there."""

    kind: Literal["goto"] = "goto"
    axis: AxisName = None
    position_um: PositionUm
    speed_um_per_s: Annotated[float, Quantity(1e-3, 1e6, "µm/s")] | None = None


class Wave(ConfigModel):
    """Follow a waveform, then hold its last position."""

    kind: Literal["wave"] = "wave"
    command_um: Waveforms = Field(description="Axis: position over time, µm.")
    duration_s: DurationS
    start_s: StartS = None


class Stream(ConfigModel):
    """Follow the setpoints of a stream; the service sends this when a stream begins."""

    kind: Literal["stream"] = "stream"
    axes: tuple[Name, ...] = Field(min_length=1)


class Follow(ConfigModel):
    """Follow the command input of the axis."""

    kind: Literal["follow"] = "follow"
    axis: AxisName = None


class Hold(ConfigModel):
    """Hold the present voltage."""

    kind: Literal["hold"] = "hold"


class Resume(ConfigModel):
    """Continue after HOLD, from the present position."""

    kind: Literal["resume"] = "resume"


class Stop(ConfigModel):
    """Ramp to the safe voltage, then go to SAFE."""

    kind: Literal["stop"] = "stop"


class Estop(ConfigModel):
    """Stop in an emergency."""

    kind: Literal["estop"] = "estop"


class Reset(ConfigModel):
    """Clear faults that are gone, and leave FAULT for SAFE if none is present any more."""

    kind: Literal["reset"] = "reset"
    engineer: bool = Field(
        default=False, description="Also end the faults that only an engineer may end."
    )


class Condition(ConfigModel):
    """Drive a decaying swing, which makes the hysteresis memory known."""

    kind: Literal["condition"] = "condition"
    axis: AxisName = None


class Zero(ConfigModel):
    """Make the displacement at the rest voltage the sensor zero."""

    kind: Literal["zero"] = "zero"
    axis: AxisName = None


class Identify(ConfigModel):
    """Drive voltage waveforms, to record data for a model."""

    kind: Literal["identify"] = "identify"
    drive_v: Waveforms = Field(description="Axis: drive voltage over time, V; all others rest.")
    duration_s: DurationS


class Play(ConfigModel):
    """Let the device of an axis play a table of voltages by its own clock."""

    kind: Literal["play"] = "play"
    axis: AxisName = None
    drive_v: TableV = Field(min_length=2, description="Voltages of one period, V.")
    lead_in_v: TableV = Field(default=(), description="Voltages before the first period, V.")
    interval_s: Annotated[float, Quantity(1e-6, 1, "s")] = Field(
        description="Time between two of them, s."
    )
    cycles: Annotated[int, Quantity(1, 100_000)] = Field(description="Number of periods.")
    start_s: StartS = None


class AdoptModel(ConfigModel):
    """Use another model from now on; only while disarmed."""

    kind: Literal["adopt"] = "adopt"
    axis: AxisName = None
    model: ModelFile
    zero_um: PositionUm | None = Field(default=None, description="Sensor zero to restore, µm.")


class Shutdown(ConfigModel):
    """Ramp to the safe voltage and end the daemon."""

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
    | Play
    | AdoptModel
    | Shutdown,
    Field(discriminator="kind"),
]
_CLASSES: Final[Mapping[str, type[ConfigModel]]] = {
    each.model_fields["kind"].default: each for each in get_args(get_args(Request)[0])
}
TABLE: Final[Mapping[str, Endpoint]] = {
    row.name: replace(row, request=_CLASSES[row.name]) for row in REQUEST_ROWS
} | dict(ENDPOINTS)
"""The table of commands: every endpoint, by name."""
REQUESTS: Final = {row.name: _CLASSES[row.name] for row in REQUEST_ROWS}
"""The request classes, by name."""
