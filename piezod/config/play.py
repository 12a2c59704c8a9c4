"""Waveforms that a device plays from a table, in an experiment."""

from collections.abc import Iterator
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.config.quantities import DurationS, FrequencyHz, OneLine, PauseS, PercentOfRange
from piezod.config.waveforms.paths import AnyLines
from piezod.config.waveforms.shapes import AnyPeriodic

PlayedCommand: TypeAlias = Annotated[AnyPeriodic | AnyLines, Field(discriminator="kind")]
IntervalUs: TypeAlias = Annotated[float, Quantity(0.1, 1e6, "µs")]
Passes: TypeAlias = Annotated[int, Quantity(0, 50)]


class WaveConfig(ConfigModel):
    """One periodic command."""

    name: OneLine = Field(min_length=1, max_length=40, description="Name.")
    command_um: PlayedCommand = Field(
        description="One period of the position, µm: a sine, a triangle, or points whose last one "
        "is the first one again."
    )
    reference: OneLine = Field(
        default="", max_length=60, description="Source of `reference_pct`, for people."
    )
    reference_pct: dict[Literal["max", "rms", "mean"], PercentOfRange] = Field(
        default_factory=dict, description="Published errors of such a waveform, % of the swing."
    )

    @property
    def period_s(self) -> float:
        """Duration of a period, in s."""
        begin_s, end_s = self.command_um.begin_and_end_s()
        return end_s - begin_s

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        broken = self.command_um.broken_period()
        raise_rules((("command_um", *path), what) for path, what in broken)
        return self


class PlayConfig(ConfigModel):
    """Waveforms that a device plays, with a table that is learned pass by pass."""

    interval_us: IntervalUs = Field(
        default=50.0, description="Time between two points of the table, µs."
    )
    passes: Passes = Field(default=6, description="Largest number of corrections.")
    settle_s: PauseS = Field(
        default=5.0, description="Time of the waveform before the periods that count, s."
    )
    record_s: DurationS = Field(default=2.0, description="Time of the periods that count, s.")
    lowest_hz: FrequencyHz = Field(
        default=10.0, description="Lowest frequency of the measured response, Hz."
    )
    highest_hz: FrequencyHz = Field(
        default=3000.0,
        description="Highest frequency that is measured, commanded and learned, Hz.",
    )
    amplitude_pct: Annotated[float, Quantity(0.1, 20, "%")] = Field(
        default=3.0,
        description="Largest deviation of the position while the response is measured, % of range.",
    )
    waves: tuple[WaveConfig, ...] = Field(min_length=1, description="The waveforms.")

    @property
    def interval_ns(self) -> int:
        """Time between two points of the table, in ns."""
        return round(1000.0 * self.interval_us)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        half_hz = 0.5e6 / self.interval_us
        if not self.highest_hz < half_hz:
            what = f"out of range (got {self.highest_hz:g} Hz), allowed: below {half_hz:g} Hz"
            yield ("highest_hz",), f"{what}, half of the rate of the table"
        if not self.lowest_hz < self.highest_hz / 10.0:
            what = f"must be below a tenth of highest_hz (got {self.lowest_hz:g} Hz)"
            yield ("lowest_hz",), what
        names = [wave.name for wave in self.waves]
        for index, wave in enumerate(self.waves):
            if wave.name in names[:index]:
                yield ("waves", index, "name"), f"appears twice (got {wave.name!r})"
            frequency_hz = 1.0 / wave.period_s
            if not frequency_hz <= self.highest_hz:
                what = f"repeats at {frequency_hz:g} Hz, allowed: at most highest_hz"
                yield ("waves", index, "command_um"), f"{what}, {self.highest_hz:g} Hz"
