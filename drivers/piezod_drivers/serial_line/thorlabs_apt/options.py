"""Options of a Thorlabs cube."""

from typing import Annotated, Literal

from pydantic import Field

from piezod.config.fields import Quantity
from piezod_drivers.serial_line.options import PortOptions


class AptOptions(PortOptions):
    """Options of a cube with a USB port of its own."""

    model: Literal["KPZ101", "TPZ001", "KSG101", "TSG001"] = Field(
        description="KPZ101 and TPZ001 are amplifiers, KSG101 and TSG001 are strain gauge readers."
    )
    rtscts: bool = Field(default=True, description="Whether RTS and CTS control the flow.")
    max_v: Literal[75, 100, 150] | None = Field(
        default=None,
        description="Voltage limit that the amplifier must be set to, V; left out: any limit.",
    )
    full_scale_um: Annotated[float, Quantity(0.001, 10_000, "µm")] | None = Field(
        default=None,
        description="Displacement at a reading of 32767, µm; left out: the travel of the actuator, "
        "as the reader reports it.",
    )

    @property
    def is_amplifier(self) -> bool:
        """Whether the cube is an amplifier; else it is a strain gauge reader."""
        return self.model in {"KPZ101", "TPZ001"}
