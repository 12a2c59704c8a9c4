"""What a configuration may say about an amplifier of piezosystem jena."""

from collections.abc import Iterator
from typing import Annotated

from pydantic import Field

from piezod.config.fields import BrokenRule, Quantity
from piezod_drivers.serial_line.options import LineOptions, TimeoutMs, ordered
from piezod_drivers.serial_line.psj.profiles import MODELS, Profile, PsjModel, Reads

Volts = Annotated[float, Quantity(-200, 500, "V")]


class PsjOptions(LineOptions):
    """Options of an amplifier of piezosystem jena; `baud` is the model's own unless it is given."""

    profile: Profile = Field(description="Which model it is.")
    reads: Reads | None = Field(
        default=None,
        description="What its reading (mess, rk, rd, meas) is used for: nothing, a position in µm "
        "that is an input, or the voltage in force in V. Left out: what suits the model; a "
        "d-Drive refreshes it every 500 ms only, so it reads nothing.",
    )
    range_v: tuple[Volts, Volts] = Field(
        default=(-20.0, 130.0),
        description="Lowest and highest voltage, V; what the device tells narrows it.",
    )
    remote: bool = Field(
        default=False,
        description="Whether you have put an NV40 under remote control and in open loop, with its "
        "voltage at rest; it does not tell. Only for nv40 and nv40-1.",
    )
    timeout_ms: TimeoutMs = Field(default=50.0, description="How long to wait for each reply, ms.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from super()._broken_rules()
        yield from ordered(self.range_v)
        if self.remote and not self.profile.startswith("nv40"):
            yield ("remote",), f"is not for {self.profile}, which is asked: leave it out"

    def model(self) -> PsjModel:
        """Return the model, with its baud rate and its reading as they are given."""
        model = MODELS[self.profile]
        return model._replace(baud=self.baud_or(model.baud), reads=self.reads or model.reads)
