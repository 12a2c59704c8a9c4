"""Coupling files: how far each actuator of a stage moves the sensors of the others."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import (
    BrokenRule,
    ConfigModel,
    Context,
    Quantity,
)
from piezod.config.loaded_file import dump, loads
from piezod.config.model_file import Text
from piezod.config.quantities import Name
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml

Row: TypeAlias = dict[Name, Annotated[float, Quantity(-1e6, 1e6)]]
MOST_SHARE: Final = 0.5
"""Actuators that move each other by more than this are no actuators of their own."""

Share: TypeAlias = Annotated[float, Quantity(-MOST_SHARE, MOST_SHARE)]

MOST_LAG_S: Final = 0.1
"""A coupling that is later than this is creep or heat, which no lag describes."""

LagS: TypeAlias = Annotated[float, Quantity(0, MOST_LAG_S)]


class CouplingFile(ConfigModel):
    """How far the actuators of a stage move the sensors of the others."""

    format: Literal["piezod-coupling"] = Field(
        default="piezod-coupling", description="Kind of the file."
    )
    version: Literal[1] = Field(default=1, description="Version of the format.")
    created_at: Text = Field(default="unknown", description="Time of the fit, ISO 8601.")
    created_by: Text = Field(default="hand", description="Program and version that made it.")
    source: Text = Field(default="unknown", description="Record of the fit.")
    shares: dict[Name, dict[Name, Share]] = Field(
        description="Axis: what its sensor shows if another axis moves by 1 µm, µm."
    )
    lags_s: dict[Name, dict[Name, LagS]] = Field(
        default={},
        description="Axis: how much later its sensor shows that, s; 0 for those left out.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        for name, row in self.shares.items():
            if name in row:
                yield ("shares", name, name), "is 1 by definition, leave it out"
        for name, lags in self.lags_s.items():
            for other in lags.keys() - self.shares.get(name, {}).keys():
                yield ("lags_s", name, other), "has no share in `shares`"


def load_coupling(path: Path) -> CouplingFile:
    """Read a coupling file.

    Raises:
        ConfigError: If it is not a valid coupling file; the text lists every problem.
    """
    return validate(load_yaml(path), CouplingFile, Context(path.parent))


def dump_coupling(coupling: CouplingFile) -> str:
    """Write a coupling as the text of a coupling file; `load_coupling` gives it back."""
    return dump(coupling, "How far the axes of a stage move each other, for piezod.")


LoadedCoupling: TypeAlias = Annotated[CouplingFile, loads(CouplingFile, load_coupling)]
"""A coupling file, loaded when the configuration is: a copy of the configuration contains it."""
