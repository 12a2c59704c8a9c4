"""What each kind of waveform must know, and what the waveforms of a request may cost.

A kind is one class. It makes a `Waveform`, which has a value, bounds and a highest frequency, so
that no part of piezod has to guess what a new kind does. Values are in the unit of the enclosing
key: µm under `command_um`, V under `drive_v`.
"""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Final, Self, TypeAlias, get_args

from pydantic import Field, model_validator

from piezod.config.fields import ConfigModel, Quantity, raise_rules
from piezod.config.quantities import Level
from piezod.config.waveforms.formulas import Value
from piezod.errors import PiezodError

Packed: TypeAlias = dict[str, Any]
"""What the loop needs of a waveform: plain values, bytes, lists and dicts, with its `kind`."""

MAX_POINTS: Final = 16_000
"""Most points, levels and turning points in the waveforms of a request: they fill its mailbox."""
MAX_TERMS: Final = 128
"""Most sinusoids and other parts in the waveforms of a request: they are summed in every cycle."""


class WaveformCostError(PiezodError):
    """Raised if waveforms are too large for the loop."""

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}: {remedy}")
        self.what, self.remedy = what, remedy


class Budget:
    """How many points and terms waveforms may still have; by default there is no limit."""

    def __init__(self, points: float = inf, terms: float = inf) -> None:
        self.points, self._terms = points, terms

    def take(self, terms: int, points: int = 0) -> None:
        """Take terms and points.

        Raises:
            WaveformCostError: If so many are not left.
        """
        self.points, self._terms = self.points - points, self._terms - terms
        if self.points < 0:
            what = f"the waveforms have too many points, allowed: at most {MAX_POINTS} in all"
            remedy = "send fewer points, or reversals of a larger min_swing or a shorter duration"
            raise WaveformCostError(what, remedy)
        if self._terms < 0:
            what = f"the waveforms have too many parts, allowed: at most {MAX_TERMS} in all"
            remedy = "sum fewer, or send the sum as points"
            raise WaveformCostError(f"{what}, each sinusoid of a multisine counted", remedy)


@dataclass(frozen=True, slots=True)
class Waveform:
    """A command or a drive over time, in the unit of its configuration."""

    value: Value  #: Returns the value at a time in s. Real-time safe.
    low: float  #: Lower bound of all values.
    high: float  #: Upper bound of all values.
    highest_hz: float  #: Highest frequency, in Hz; 0 without any.

    def built(self, duration_s: float) -> "Waveform":  # noqa: ARG002 - as a model is built
        """Return the waveform itself: the loop finds it in a request, in place of its model."""
        return self

    def sample(self, t_s: Iterable[float]) -> list[float]:
        """Return the values at many times, in s; they are exactly those of `value`."""
        return [self.value(float(each_s)) for each_s in t_s]


class Timed(ConfigModel):
    """A waveform, a part of one, or what has one."""

    def slowed(self, factor: float) -> Self:
        """Return the same values, so many times slower; the units say which fields change.

        Raises:
            DataError: If its times are fixed.
        """
        slower = {}
        for name, field in type(self).model_fields.items():
            units = [each.unit for each in field.metadata if isinstance(each, Quantity)]
            slower[name] = _slowed(getattr(self, name), "".join(units), factor)
        return self.model_copy(update=slower)


def _slowed(value: Any, unit: str, factor: float) -> Any:
    match value, unit:
        case _, "s":
            return value * factor
        case _, "Hz" | "per s":
            return value / factor
        case Timed(), _:
            return value.slowed(factor)
        case tuple(), _:
            return tuple(_slowed(each, "", factor) for each in value)
        case dict(), _:
            return {key: _slowed(each, "", factor) for key, each in value.items()}
        case _:
            return value


class WaveformModel(Timed):
    """A waveform in a configuration or a request, with its own `kind`."""

    @abstractmethod
    def packed(self, duration_s: float, budget: Budget) -> Packed:
        """Return what the loop needs.

        Args:
            duration_s: Longest time that will be evaluated, in s.
            budget: What it may cost.

        Raises:
            WaveformCostError: If it costs more.
        """

    @classmethod
    @abstractmethod
    def unpacked(cls, packed: Packed) -> Waveform:
        """Return the waveform that `packed` has packed. Real-time safe."""

    def built(self, duration_s: float) -> Waveform:
        """Return the waveform.

        Args:
            duration_s: Longest time that will be evaluated, in s. A path of random reversals ends
                at the first turning point after that; its beginning does not depend on it.
        """
        return self.unpacked(self.packed(duration_s, Budget()))

    def bounds(self) -> tuple[float, float]:
        """Return the lowest and the highest possible value."""
        waveform = self.built(0.0)
        return waveform.low, waveform.high

    def highest_hz(self) -> float:
        """Return the highest frequency, in Hz; 0 for straight lines and steps, which have none."""
        return self.built(0.0).highest_hz

    def sendable(self) -> "WaveformModel":
        """Return the waveform without names of files, which a daemon does not read."""
        return self


class Swinging(WaveformModel):
    """A waveform between two values."""

    low: Level = Field(description="Lowest value; the waveform starts here.")
    high: Level = Field(description="Highest value.")

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        if not self.low < self.high:
            what = f"must be above low (got {self.high:g}, low is {self.low:g})"
            raise_rules([(("high",), what)])
        return self


def by_kind(union: Any) -> Mapping[str, Any]:
    """Return the models of a union by the value of `kind` that selects each."""
    models = get_args(union)
    return {get_args(each.model_fields["kind"].annotation)[0]: each for each in models}
