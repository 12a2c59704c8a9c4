"""What a configuration may say about a Thorlabs cube."""

from typing import Annotated, Literal

from pydantic import Field

from piezod.config.fields import Quantity
from piezod_drivers.serial_line.options import PortOptions


class AptOptions(PortOptions):
    """Options of a cube on a USB port of its own."""

    model: Literal["KPZ101", "TPZ001", "KSG101", "TSG001"] = Field(
        description="KPZ101 and TPZ001 are amplifiers, KSG101 and TSG001 strain gauge readers."
    )
    rtscts: bool = Field(default=True, description="Whether RTS and CTS hold up the flow.")
    max_v: Literal[75, 100, 150] | None = Field(
        default=None,
        description="Voltage limit that the amplifier must be set to, V; left out: any is right.",
    )
    full_scale_um: Annotated[float, Quantity(0.001, 10_000, "µm")] | None = Field(
        default=None,
        description="Displacement at a reading of 32767, µm; left out: the travel that the reader "
        "was told by its actuator.",
    )

    @property
    def is_amplifier(self) -> bool:
        """Whether it drives an actuator; else it reads a strain gauge."""
        return self.model in {"KPZ101", "TPZ001"}
