"""The trim of an axis: a slow integral of the measured error on top of an inverse model."""

from collections.abc import Iterator
from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from piezod.config.fields import BrokenRule, ConfigModel, Quantity, raise_rules

TrimBase: TypeAlias = Literal["feedforward", "adaptive"]


class TrimConfig(ConfigModel):
    """What mode `trimmed` adds to an inverse model."""

    base: TrimBase = Field(default="feedforward", description="Mode that the trim is added to.")
    gain_per_s: Annotated[float, Quantity(0.01, 5000, "1/s")] = Field(
        default=50.0, description="Gain of the integral: an error fades with 1/gain, 1/s."
    )
    authority_pct: Annotated[float, Quantity(0.1, 20, "%")] = Field(
        default=5.0, description="Most that the trim may add, either way, % of the range."
    )
    first_mode_hz: Annotated[float, Quantity(1, 100_000, "Hz")] | None = Field(
        default=None, description="First mechanical mode, for the check of stability, Hz."
    )
    first_mode_damping: Annotated[float, Quantity(0.001, 1)] | None = Field(
        default=None, description="Damping ratio of that mode."
    )

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        raise_rules(self._broken_rules())
        return self

    def _broken_rules(self) -> Iterator[BrokenRule]:
        values = {key: getattr(self, key) for key in ("first_mode_hz", "first_mode_damping")}
        missing = [key for key, value in values.items() if value is None]
        if len(missing) == 1:
            (given,) = values.keys() - missing
            yield (given,), f"needs {missing[0]} too, give both or none"
