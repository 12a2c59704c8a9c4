"""Table files: a learned waveform with the conditions under which it was learned."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import yaml
from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, ConfigModel, Context, Quantity
from piezod.config.model_file import Text
from piezod.config.quantities import DriveV, Name, PercentOfRange, PositionUm
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem

Sha256: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
MOST_POINTS = 1_000_000


class DeviceIdentity(ConfigModel):
    """Identity of the device that played, as it reported it."""

    maker: Text = Field(description="Maker.")
    model: Text = Field(description="Model.")
    serial: Text = Field(description="Serial number.")


class TableFile(ConfigModel):
    """A learned waveform; the lists have one entry for each point of its period."""

    format: Literal["piezod-table"] = "piezod-table"
    version: Literal[1] = 1
    created_at: Text = Field(description="Time of creation, ISO 8601 with the offset from UTC.")
    created_by: Text = Field(description="Program and version that made it.")
    axis: Name = Field(description="Axis.")
    waveform: Text = Field(description="Name of the waveform.")
    device: DeviceIdentity = Field(description="Device that played.")
    model_sha256: Sha256 = Field(description="SHA-256 of the model of hysteresis.")
    interval_ns: Annotated[int, Quantity(1, 10**12, "ns")] = Field(
        description="Time between two points, ns."
    )
    sensor_delay_s: Annotated[float, Quantity(0, 0.1, "s")] = Field(
        description="Part of the delay that is the sensor's, s."
    )
    rest_v: DriveV = Field(description="Voltage at rest before each play, V.")
    passes: Text = Field(description="Name of the pass that made the table.")
    error_max_pct: PercentOfRange = Field(description="Largest measured error, % of the swing.")
    error_rms_pct: PercentOfRange = Field(description="Rms measured error, % of the swing.")
    command_um: tuple[PositionUm, ...] = Field(
        max_length=MOST_POINTS, description="Command at each point, µm."
    )
    wanted_um: tuple[PositionUm, ...] = Field(
        max_length=MOST_POINTS, description="Input of the inverse model, learned, µm."
    )
    drive_v: tuple[DriveV, ...] = Field(
        max_length=MOST_POINTS, description="Voltage of the table, V."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        points = len(self.command_um)
        for key in ("wanted_um", "drive_v"):
            if len(getattr(self, key)) != points:
                what = f"needs one entry for each of {points} points of command_um"
                yield (key,), f"{what} (got {len(getattr(self, key))})"


def load_table(path: Path) -> TableFile:
    """Read a table file.

    Raises:
        ConfigError: If it is not a valid table file; the text lists every problem with its place.
    """
    document = load_yaml(path)
    if document.data.get("format") != "piezod-table":
        what = "not a table file, its format is not piezod-table"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return validate(document, TableFile, Context(path.parent))


def dump_table(table: TableFile) -> str:
    """Write a table as the text of a table file; `load_table` gives back the same table."""
    document = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in table.model_dump().items()
    }
    text = yaml.safe_dump(
        document, sort_keys=False, allow_unicode=True, width=100, default_flow_style=None
    )
    return f"# Learned table of a waveform for piezod.\n{text}"
