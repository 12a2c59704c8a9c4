"""Options of an amplifier of piezosystem jena."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from piezod.config.fields import BrokenRule, Quantity
from piezod_drivers.serial_line.options import LineOptions, TimeoutMs, WaveEnd, range_rules
from piezod_drivers.serial_line.psj.profiles import PROFILES, ProfileName, PsjProfile, ReadingUse

Volts = Annotated[float, Quantity(-200, 500, "V")]


class PsjOptions(LineOptions):
    """Options of an amplifier of piezosystem jena; the default of `baud` depends on the profile."""

    profile: ProfileName = Field(description="Model of the device.")
    reads: ReadingUse | None = Field(
        default=None,
        description="Use of the device's reading (mess, rk, rd, meas): nothing, an input with a "
        "position in µm, or the voltage in force in V. Left out: as suits the model. A d-Drive "
        "refreshes its reading only every 500 ms, so its default is nothing.",
    )
    range_v: tuple[Volts, Volts] = Field(
        default=(-20.0, 130.0),
        description="Lowest and highest voltage, V; limits that the device reports narrow it.",
    )
    remote: bool = Field(
        default=False,
        description="Confirms that you have put an NV40 under remote control and in open loop, at "
        "rest voltage. Only for nv40-1, and for an nv40 that does not report it.",
    )
    wave_end: WaveEnd = "unknown"
    timeout_ms: TimeoutMs = Field(default=50.0, description="Longest wait for each reply, ms.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        yield from range_rules(self.range_v)
        if self.remote and not self.profile.startswith("nv40"):
            yield ("remote",), f"not for {self.profile}, whose state is read: leave it out"
        if self.wave_end != "unknown" and self.profile != "nv200":
            yield ("wave_end",), f"not for {self.profile}, which plays no tables: leave it out"

    def configured_profile(self) -> PsjProfile:
        """Return the profile, with the configured baud rate and use of the reading."""
        known = PROFILES[self.profile]
        return known._replace(baud=self.baud_or(known.baud), reads=self.reads or known.reads)
