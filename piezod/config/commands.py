"""Commands: one waveform for all axes, or one for each."""

from typing import Annotated, TypeAlias

from pydantic import Discriminator, Field, Tag

from piezod.config.fields import ConfigModel
from piezod.config.quantities import DurationS, Name
from piezod.config.waveforms.combined import WaveformConfig
from piezod.config.waveforms.waveform import Timed


class CommandPerAxis(Timed):
    """A separate command for each axis."""

    axes: dict[Name, WaveformConfig] = Field(min_length=1, description="Axis: command, µm.")


def _one_or_per_axis(value: object) -> str:
    per_axis = isinstance(value, CommandPerAxis) or (isinstance(value, dict) and "axes" in value)
    return "per axis" if per_axis else "one"


Command: TypeAlias = Annotated[
    Annotated[WaveformConfig, Tag("one")] | Annotated[CommandPerAxis, Tag("per axis")],
    Discriminator(_one_or_per_axis),
]


class WaveFile(ConfigModel):
    """A movement in its own file."""

    command_um: Command = Field(
        description="Position, µm: one for a single axis, or `axes:` with one for each axis."
    )
    duration_s: DurationS = Field(description="Length, s.")
