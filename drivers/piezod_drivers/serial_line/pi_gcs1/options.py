"""Options of a controller with GCS 1."""

from collections.abc import Iterator
from typing import Annotated, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, Quantity
from piezod_drivers.serial_line.options import PortOptions, TimeoutMs, range_rules

Axis: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Z]$")]
Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]


class Gcs1Options(PortOptions):
    """Options of `pi_gcs1`; an E-816 is delivered with 38 400 or 115 200 bit/s."""

    rtscts: bool = Field(default=True, description="Whether RTS and CTS control the flow.")
    timeout_ms: TimeoutMs = Field(default=50.0, description="Longest wait for each reply, ms.")
    axes: tuple[Axis, ...] = Field(
        default=("A",), min_length=1, max_length=12, description="Axes of the controller."
    )
    range_v: tuple[Volts, Volts] = Field(
        default=(-20.0, 120.0), description="Lowest and highest voltage of its amplifiers, V."
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from range_rules(self.range_v)
