"""Options of an nPoint LC.400."""

from typing import Annotated

from pydantic import Field

from piezod.config.fields import Quantity
from piezod_drivers.serial_line.options import Baud, PortOptions


class Lc400Options(PortOptions):
    """Options of an LC.400 at its virtual serial port."""

    baud: Baud = Field(default=230_400, description="Bits per second, as set on the device.")
    axes: Annotated[int, Quantity(1, 3)] = Field(
        default=3, description="Number of channels: 1, 2 or 3."
    )
    range_um: Annotated[float, Quantity(0.1, 100_000, "µm")] | None = Field(
        default=None,
        description="Range of the stages, µm; left out: as the controller reports it, if in µm.",
    )
