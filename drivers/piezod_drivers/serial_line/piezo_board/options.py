"""Options of a player board."""

from collections.abc import Iterator
from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import BrokenRule, ConfigModel, Quantity
from piezod_drivers.serial_line.options import Baud, PortOptions

Volts: TypeAlias = Annotated[float, Quantity(-1000, 1000, "V")]
Rows: TypeAlias = Annotated[int, Quantity(0, 65_535)]


class PulseOptions(ConfigModel):
    """Pulses at the lines of a board, in step with a play."""

    point: Rows = Field(default=1, description="A pulse at every so many points; 0 for none.")
    line: Rows = Field(
        default=0, description="A pulse at every so many points; 0 for one in each period."
    )


class BoardOptions(PortOptions):
    """Options of `piezo_board`."""

    baud: Baud = Field(default=500_000, description="Bits per second, as the firmware has it.")
    channels: Annotated[int, Quantity(1, 2)] = Field(
        default=1, description="Number of channels of the firmware."
    )
    output_v: tuple[Volts, Volts] = Field(
        default=(0.0, 5.0), description="Voltages of the outputs at their lowest and highest code."
    )
    input_v: tuple[Volts, Volts] = Field(
        default=(0.0, 5.0), description="Voltages of the inputs at their lowest and highest code."
    )
    watchdog_ms: Annotated[int, Quantity(300, 60_000, "ms")] = Field(
        default=1000,
        description="After this silence of the computer the board ends a play and goes to its safe "
        "voltage, ms.",
    )
    play_on: Literal["command", "start edge", "step edges"] = Field(
        default="command",
        description="What starts a play: the command, or an edge at the trigger input; with `step "
        "edges` each further edge is a point.",
    )
    pulses: PulseOptions = Field(default_factory=PulseOptions, description="Lines during a play.")

    def _broken_rules(self) -> Iterator[BrokenRule]:
        for key, range_v in (("output_v", self.output_v), ("input_v", self.input_v)):
            if range_v[0] == range_v[1]:
                yield (key, 1), "must differ from the first of the two"
