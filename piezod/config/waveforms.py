"""Waveforms: a command or a drive voltage over time, and its bounds.

Values are in the unit of the enclosing key: µm under `command_um`, V under `drive_v`. A waveform
starts at t = 0. A periodic one starts at its lowest value and rises, so that with `low: 0` it
leaves the rest position without a step.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import Field, PrivateAttr, model_validator

from piezod.config.envelopes import ConstantEnvelope, Envelope
from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.config.files import ExistingFile, Point, read_points
from piezod.config.quantities import DurationS, FrequencyHz, Level, Seed, Size, TimeS

Bounds: TypeAlias = tuple[float, float]

# A path with more turning points per second is noise.
MAX_TURNS_PER_S: Final = 200


class Setpoint(ConfigModel):
    """One constant value."""

    kind: Literal["setpoint"]
    level: Level = Field(description="The value.")

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        return self.level, self.level


class Swinging(ConfigModel):
    """Common fields of sine, triangle and reversals."""

    low: Level = Field(description="Lowest value; the waveform starts here.")
    high: Level = Field(description="Highest value.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.low < self.high:
            what = f"must be above low (got {self.high:g}, low is {self.low:g})"
            raise_rules([(("high",), what)])
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        return self.low, self.high


class Periodic(Swinging):
    """Common fields of sine and triangle."""

    frequency_hz: FrequencyHz = Field(description="Frequency, Hz.")
    envelope: Envelope = Field(
        default=ConstantEnvelope(), description="Change of the swing over time."
    )
    anchor: Literal["low", "middle"] = Field(
        default="low", description="Level that stays constant while the swing changes."
    )


class Sine(Periodic):
    """A sinusoid between two values."""

    kind: Literal["sine"]


class Triangle(Periodic):
    """A symmetric triangle between two values."""

    kind: Literal["triangle"]


class Component(ConfigModel):
    """One sinusoid of a multisine."""

    amplitude: Size = Field(description="Amplitude: half of the peak-to-peak value.")
    frequency_hz: FrequencyHz = Field(description="Frequency, Hz.")
    phase_deg: Annotated[float, Quantity(-360, 360, "°")] = Field(
        default=0.0, description="Phase at t = 0, relative to the lowest point, °."
    )


class Multisine(ConfigModel):
    """A sum of sinusoids, each raised by its amplitude so that the sum stays above `low`."""

    kind: Literal["multisine"]
    low: Level = Field(description="Value if all sinusoids are at their lowest point.")
    components: tuple[Component, ...] = Field(
        min_length=1, max_length=64, description="The sinusoids."
    )

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        high = self.low  # each sinusoid runs from 0 to twice its amplitude
        for component in self.components:
            high += 2 * component.amplitude
        return self.low, high


class Staircase(ConfigModel):
    """Levels one after the other; the last level is held."""

    kind: Literal["staircase"]
    levels: tuple[Level, ...] = Field(min_length=1, max_length=10_000, description="The levels.")
    dwell_s: DurationS = Field(description="Duration of each level, s.")

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        return min(self.levels), max(self.levels)


class Reversals(Swinging):
    """Straight lines between random turning points; the seed determines them."""

    kind: Literal["reversals"]
    min_swing: Size = Field(description="Smallest distance between two turning points.")
    min_speed: Size = Field(description="Lowest speed, per s.")
    max_speed: Size = Field(description="Highest speed, per s.")
    seed: Seed = Field(description="Seed of turning points and speeds.")

    @model_validator(mode="after")
    def _check_sizes(self) -> Self:
        raise_rules(self._broken_sizes())
        return self

    def _broken_sizes(self) -> Iterator[BrokenRule]:
        span, fastest = self.high - self.low, self.min_swing * MAX_TURNS_PER_S
        if self.min_swing > span:
            what = f"longer than the range (got {self.min_swing:g}), allowed: at most {span:g}"
            yield ("min_swing",), what
        if self.max_speed < self.min_speed:
            what = f"below min_speed (got {self.max_speed:g}), allowed: at least {self.min_speed:g}"
            yield ("max_speed",), what
        if self.max_speed > fastest:
            what = f"more than {MAX_TURNS_PER_S} times min_swing per s (got {self.max_speed:g})"
            yield ("max_speed",), f"{what}, allowed: at most {fastest:g}"


class Points(ConfigModel):
    """Points joined by straight lines; the first and the last value are held."""

    kind: Literal["points"]
    points: tuple[tuple[TimeS, Level], ...] = Field(
        min_length=1,
        max_length=10_000,
        description="Pairs of time in s and value, times increasing.",
    )

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        for index, ((before_s, _), (time_s, _)) in enumerate(pairwise(self.points), start=1):
            if not before_s < time_s:
                what = f"must be later than the point before it (got {time_s:g} s)"
                raise_rules([(("points", index), what)])
        return self

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        values = [value for _, value in self.points]
        return min(values), max(values)


class Csv(ConfigModel):
    """Points from a file, joined by straight lines; the first and the last value are held."""

    kind: Literal["csv"]
    path: ExistingFile = Field(description="CSV file with a header, relative to this file.")
    column: str = Field(description="Column with the values; the times are in the column t_s.")
    _points: tuple[Point, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _read(self) -> Self:
        try:
            # Read here and not in the run: the points are checked, and the file may change later.
            self._points = read_points(self.path, self.column)
        except ValueError as error:
            raise_rules([(("path",), str(error))])
        return self

    @property
    def points(self) -> tuple[Point, ...]:
        """Pairs of time in s and value, times increasing; as read when the model was made."""
        return self._points

    def bounds(self) -> Bounds:
        """Return the lowest and the highest possible value."""
        values = [value for _, value in self._points]
        return min(values), max(values)


SingleWaveform: TypeAlias = Annotated[
    Setpoint | Sine | Triangle | Multisine | Staircase | Reversals | Points | Csv,
    Field(discriminator="kind"),
]
