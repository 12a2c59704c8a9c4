"""Options of a controller with GCS 2.0."""

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, Quantity
from piezod_drivers.serial_line.options import LineOptions, WaveEnd, range_rules

Axis: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]{1,8}$")]
Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]


class Gcs2Options(LineOptions):
    """Options of `pi_gcs2`; over TCP the controllers listen at port 50000."""

    axes: tuple[Axis, ...] = Field(
        default=("1",), min_length=1, max_length=8, description="Axes of the controller."
    )
    range_v: tuple[Volts, Volts] | None = Field(
        default=None,
        description="Lowest and highest open-loop value; left out: as VMI? and VMA? report.",
    )
    read_back: Literal["VOL?", "SVA?"] = Field(
        default="VOL?",
        description="Query of the value in force: the measured voltage, or the value that was set.",
    )
    wave_end: WaveEnd = "unknown"
    trigger_outputs: Annotated[int, Quantity(0, 8)] = Field(
        default=0,
        description="Number of digital outputs for the pulses of a scan, OUT1 and on; 0 for none.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        if self.range_v is not None:
            yield from range_rules(self.range_v)
