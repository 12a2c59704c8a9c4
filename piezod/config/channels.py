"""Channels of devices and the calibration of their values."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf
from typing import Annotated, Any, Final, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules
from piezod.config.polynomial import evaluate, is_monotonic
from piezod.config.quantities import Name

ChannelName: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:/-]{1,64}$")]
"""Name of a channel, as the device or its driver defines it."""

Value: TypeAlias = Annotated[float, Quantity(-1e9, 1e9)]


class LineCalibration(ConfigModel):
    """A straight line: physical = gain · value + offset."""

    kind: Literal["line"] = "line"
    gain: Value = Field(
        default=1.0, description="µm, or V at the actuator, per unit of the channel."
    )
    offset: Value = Field(
        default=0.0, description="µm, or V at the actuator, at the channel's value 0."
    )

    @model_validator(mode="after")
    def _check_gain(self) -> Self:
        if abs(self.gain) < 1e-9:
            what = f"too small to be inverted (got {self.gain:g}), allowed: at least ±1e-9"
            raise_rules([(("gain",), what)])
        return self

    def physical_range(self) -> tuple[float, float]:
        """Return the lowest and the highest possible physical value."""
        return -inf, inf


class PolynomialCalibration(ConfigModel):
    """physical = c0 + c1·value + c2·value² + …, strictly monotonic over its range."""

    kind: Literal["polynomial"] = "polynomial"
    coefficients: tuple[Value, ...] = Field(
        min_length=2, max_length=12, description="c0, c1, c2, …: µm or V at the actuator."
    )
    values: tuple[Value, Value] = Field(
        description="Lowest and highest value of the channel, the range of the polynomial."
    )

    @model_validator(mode="after")
    def _check_values(self) -> Self:
        if not self.values[0] < self.values[1]:
            raise_rules([(("values", 1), "must be above the first of the two")])
        if not is_monotonic(self.coefficients, *self.values):
            low, high = self.values
            what = f"must rise, or fall, everywhere from {low:g} to {high:g}, its `values`"
            raise_rules([(("coefficients",), what)])
        return self

    def physical_range(self) -> tuple[float, float]:
        """Return the lowest and the highest possible physical value."""
        ends = [evaluate(self.coefficients, value) for value in self.values]
        return min(ends), max(ends)


class TableCalibration(ConfigModel):
    """A curve of straight lines through measured points."""

    kind: Literal["table"] = "table"
    values: tuple[Value, ...] = Field(
        min_length=2, max_length=10_000, description="Values of the channel."
    )
    physical: tuple[Value, ...] = Field(
        min_length=2,
        max_length=10_000,
        description="µm, or V at the actuator, at those values; strictly rising or falling.",
    )
    side: Literal["near", "far"] | None = Field(
        default=None,
        description="Used side of the maximum, for values with a maximum, as the light of a fibre "
        "sensor over its gap. The points are then in the order of the growing gap.",
    )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        # All broken rules at once, so that one correction of the file is enough.
        if len(self.values) != len(self.physical):
            n, wanted = len(self.physical), len(self.values)
            yield ("physical",), f"needs one entry for each value (got {n} for {wanted})"
        if not _monotonic(self.physical):
            yield ("physical",), "must be strictly rising or strictly falling"
        if self.side is None:
            if not _monotonic(self.values):
                what = "must be strictly rising or strictly falling; for a curve with a "
                yield ("values",), what + "maximum, name the side that is used: side: near, or far"
            return
        used = self.values[self._side()]
        if len(used) < 2:
            yield ("side",), f"no values {_BEYOND[self.side]} the maximum"
        elif not _monotonic(used):
            what = f"must be strictly {_SLOPE[self.side]} {_BEYOND[self.side]} the maximum"
            yield ("values",), what

    def points(self) -> list[tuple[float, float]]:
        """Return each used value with its physical value."""
        side = self._side()
        return list(zip(self.values[side], self.physical[side], strict=True))

    def physical_range(self) -> tuple[float, float]:
        """Return the lowest and the highest possible physical value."""
        used = self.physical[self._side()]
        return min(used), max(used)

    def _side(self) -> slice:
        if self.side is None:
            return slice(None)
        # The maximum belongs to both sides: it ends the rising one and starts the falling one.
        greatest = self.values.index(max(self.values))
        return slice(None, greatest + 1) if self.side == "near" else slice(greatest, None)


_BEYOND: Final = {"near": "before", "far": "after"}
_SLOPE: Final = {"near": "rising", "far": "falling"}


def _monotonic(numbers: Sequence[float]) -> bool:
    steps = [later - earlier for earlier, later in pairwise(numbers)]
    return all(step > 0 for step in steps) or all(step < 0 for step in steps)


Calibration: TypeAlias = Annotated[
    LineCalibration | PolynomialCalibration | TableCalibration, Field(discriminator="kind")
]


class LightConfig(ConfigModel):
    """A channel with the light level of a fibre sensor."""

    channel: ChannelName = Field(description="Name of the channel, an input of the same device.")
    nominal: Annotated[float, Quantity(1e-9, 1e9)] = Field(
        description="Value of the channel at the light of the calibration."
    )
    least: Annotated[float, Quantity(0, 1e9)] = Field(
        description="Smallest value for a valid sample."
    )
    divides: bool = Field(
        default=True, description="Whether the sensor's value is divided by light / nominal."
    )


class _Channel(ConfigModel):
    """A channel of a device."""

    device: Name = Field(description="Name of the device.")
    channel: ChannelName | None = Field(
        default=None, description="Name of the channel; default: the name of the axis."
    )


class OutputConfig(_Channel):
    """The channel that drives an axis."""

    calibration: Calibration = Field(
        default=LineCalibration(), description="From the channel's value to V at the actuator."
    )


class InputConfig(_Channel):
    """A channel that is read, and its calibration to µm."""

    calibration: Calibration = Field(
        default=LineCalibration(), description="From the channel's value to µm."
    )
    light: LightConfig | None = Field(
        default=None, description="Light of a fibre sensor; default: not measured."
    )


class SensorConfig(InputConfig):
    """The channel that measures an axis."""

    beside: tuple[ChannelName, ...] = Field(
        default=(),
        max_length=8,
        description="Inputs of the same device that a scan records beside, as those of a detector.",
    )


def _named(value: Any) -> Any:
    # Before the validation: `sensor: stage` is the short form of `sensor: {device: stage}`.
    return {"device": value} if isinstance(value, str) else value


Output: TypeAlias = Annotated[OutputConfig, BeforeValidator(_named)]
"""A device's name alone means its channel with the name of the axis, not calibrated."""

SensorInput: TypeAlias = Annotated[SensorConfig, BeforeValidator(_named)]
"""Short form as for `Output`."""

Input: TypeAlias = Annotated[InputConfig, BeforeValidator(_named)]
"""Short form as for `Output`."""
