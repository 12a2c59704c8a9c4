"""What a configuration may say about a controller that speaks GCS 2.0."""

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, StringConstraints, model_validator

from piezod.config.fields import Quantity, raise_rules
from piezod_drivers.serial_line.options import LineOptions

Axis: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_]{1,8}$")]
Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]


class Options(LineOptions):
    """Options of `pi_gcs2`; over TCP the controllers listen at port 50000."""

    axes: tuple[Axis, ...] = Field(
        default=("1",), min_length=1, max_length=8, description="Axes that the controller has."
    )
    range_v: tuple[Volts, Volts] | None = Field(
        default=None,
        description="Lowest and highest open-loop value; left out: what VMI? and VMA? tell.",
    )
    read_back: Literal["VOL?", "SVA?"] = Field(
        default="VOL?",
        description="Which query tells what is in force: the measured voltage, or the value set.",
    )

    @model_validator(mode="after")
    def _check_range(self) -> Self:
        if self.range_v is not None and not self.range_v[0] < self.range_v[1]:
            raise_rules([(("range_v", 1), "must be above the first of the two")])
        return self
