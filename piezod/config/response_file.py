"""Response files: the measured linear dynamics of an axis, with uncertainties and origin."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final, Literal, TypeAlias

from pydantic import Field

from piezod.config.fields import (
    BrokenRule,
    ConfigModel,
    Context,
    Quantity,
)
from piezod.config.loaded_file import dump, loads
from piezod.config.model_file import SourceConfig, Text
from piezod.config.quantities import DriveV, Fraction
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem

SUM_OF_SHARES: Final = 1e-6
"""Largest deviation of the sum of all shares from one."""
RINGS_BELOW: Final = 0.5
"""Damping ratio below which a resonance is a mode of the mechanics. A filter of the sensor or the
amplifier has more."""

FrequencyHz: TypeAlias = Annotated[float, Quantity(1, 100_000, "Hz")]
Damping: TypeAlias = Annotated[float, Quantity(0.001, 1)]
DelayS: TypeAlias = Annotated[float, Quantity(0, 1, "s")]
UmPerV: TypeAlias = Annotated[float, Quantity(-1e4, 1e4, "µm/V")]


class ResonanceConfig(ConfigModel):
    """A second-order part of a response. Uncertainties are standard ones."""

    frequency_hz: FrequencyHz = Field(description="Undamped frequency, Hz.")
    damping: Damping = Field(description="Damping ratio.")
    share: Annotated[float, Quantity(-1, 2)] = Field(
        default=1.0, description="Its part of the static displacement."
    )
    frequency_uncertainty_hz: Annotated[float, Quantity(0, 1e6, "Hz")] = Field(
        default=0.0, description="Uncertainty of the frequency, Hz."
    )
    damping_uncertainty: Annotated[float, Quantity(0, 1e6)] = Field(
        default=0.0, description="Uncertainty of the damping ratio."
    )
    share_uncertainty: Annotated[float, Quantity(0, 1e6)] = Field(
        default=0.0, description="Uncertainty of the share."
    )


class GainConfig(ConfigModel):
    """Small-signal gain about one voltage: the slope of small loops, not that of large ones."""

    offset_v: DriveV = Field(description="Voltage about which the axis was driven, V.")
    amplitude_v: Annotated[float, Quantity(0, 2000, "V")] = Field(
        description="Largest deviation from it, V."
    )
    um_per_v: UmPerV = Field(description="Gain at low frequencies, µm/V.")
    uncertainty_um_per_v: Annotated[float, Quantity(0, 1e4, "µm/V")] = Field(
        default=0.0, description="Its uncertainty, µm/V."
    )


class ResponseFile(ConfigModel):
    """The linear dynamics of an axis, with a static gain of one."""

    format: Literal["piezod-response"] = "piezod-response"
    version: Literal[1] = 1
    created_at: Text = Field(
        description="Time of the measurement, ISO 8601 with the offset from UTC."
    )
    created_by: Text = Field(description="Program and version that made it.")
    method: Literal["multisine", "recording", "data-sheet"] = Field(
        description="How it was measured, or that it is from data sheets."
    )
    source: SourceConfig | None = Field(default=None, description="Data of the fit.")
    rate_hz: Annotated[float, Quantity(1, 1e6, "Hz")] = Field(description="Rate of the data, Hz.")
    low_hz: Annotated[float, Quantity(0, 1e6, "Hz")] = Field(
        description="Lowest frequency of the fit, Hz."
    )
    high_hz: Annotated[float, Quantity(0, 1e6, "Hz")] = Field(
        description="Highest frequency of the fit, Hz."
    )
    coherence_low: Fraction = Field(description="Lowest coherence of a frequency of the fit.")
    coherence_high: Fraction = Field(description="Highest coherence of a frequency of the fit.")
    gains: tuple[GainConfig, ...] = Field(
        default=(), max_length=100, description="Small-signal gains."
    )
    delay_s: DelayS = Field(
        description="Delay from a voltage at the output to the sample, without the hold, s."
    )
    delay_uncertainty_s: DelayS = Field(default=0.0, description="Its uncertainty, s.")
    resonances: tuple[ResonanceConfig, ...] = Field(
        default=(), max_length=8, description="Second-order parts, by rising frequency."
    )

    @property
    def first_mode(self) -> ResonanceConfig | None:
        """The first mode of the mechanics; None if no resonance rings."""
        return next((each for each in self.resonances if each.damping < RINGS_BELOW), None)

    def _broken_rules(self) -> Iterator[BrokenRule]:
        for key in ("high_hz", "coherence_high"):
            low_key = key.replace("high", "low")
            low, high = getattr(self, low_key), getattr(self, key)
            if not low <= high:
                yield (key,), f"must be at least {low_key}, {low:g} (got {high:g})"
        for index, (before, after) in enumerate(pairwise(self.resonances), start=1):
            if not before.frequency_hz < after.frequency_hz:
                what = f"must be above that of the resonance before it (got {after.frequency_hz:g})"
                yield ("resonances", index, "frequency_hz"), what
        total = sum(each.share for each in self.resonances)
        if self.resonances and not abs(total - 1.0) <= SUM_OF_SHARES:
            yield ("resonances",), f"the shares must add up to 1 (got {total:.9g})"


def load_response(path: Path) -> ResponseFile:
    """Read a response file.

    Raises:
        ConfigError: If it is not a valid response file; the text lists every problem with its
            place.
    """
    document = load_yaml(path)
    if "resonances" not in document.data and "delay_s" not in document.data:
        what = "not a response file; `piezod response` makes response files"
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return validate(document, ResponseFile, Context(path.parent))


def dump_response(response: ResponseFile) -> str:
    """Write a response as the text of a response file; `load_response` gives it back."""
    return dump(response, "Frequency response of an axis for piezod.", exclude_none=True)


LoadedResponse: TypeAlias = Annotated[ResponseFile, loads(ResponseFile, load_response)]
"""A response file, loaded when the configuration is: a copy of the configuration contains it."""
