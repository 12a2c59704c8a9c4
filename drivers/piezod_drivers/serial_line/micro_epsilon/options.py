"""Options of a Micro-Epsilon sensor."""

from typing import Annotated, Literal

from pydantic import Field

from piezod.config.fields import Quantity
from piezod_drivers.serial_line.micro_epsilon.profiles import PROFILES, SensorProfile
from piezod_drivers.serial_line.options import Baud, PortOptions


class MicroEpsilonOptions(PortOptions):
    """Options of a sensor that streams over RS-422."""

    model: Literal[
        "ILD1220", "ILD1320", "ILD1402", "ILD1420", "ILD1700", "ILD1750", "ILD1900", "ODC2520"
    ] = Field(description="Family of the sensor.")
    baud: Baud = Field(
        default=921_600,
        description="Bits per second; left out: as delivered, 921600, or 115200 for ILD1402, "
        "ILD1700 and ODC2520.",
    )
    range_mm: Annotated[float, Quantity(0.1, 1000, "mm")] | None = Field(
        default=None,
        description="Measuring range, mm; left out: as the sensor reports it; ILD1402 and ILD1700 "
        "do not report it.",
    )

    @property
    def profile(self) -> SensorProfile:
        """The properties of the stream."""
        return PROFILES[self.model]

    @property
    def bits_per_s(self) -> int:
        """The configured bit rate, else that of the profile."""
        return self.baud_or(self.profile.baud)
