"""Model files: an identified inverse model with its ranges, its delay and its origin."""

import json
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import yaml
from pydantic import Field, StringConstraints

from piezod.config.fields import BrokenRule, ConfigModel, Context, Quantity
from piezod.config.first_mode import FoundModeConfig
from piezod.config.plausible import Span
from piezod.config.quantities import DriveV, PercentOfRange, PositionUm
from piezod.config.validate import validate
from piezod.config.yaml_loader import load_yaml
from piezod.errors import ConfigError, Problem

Text: TypeAlias = Annotated[str, StringConstraints(min_length=1, max_length=255)]
Threshold: TypeAlias = Annotated[float, Quantity(1e-9, 1 - 1e-9)]
Weight: TypeAlias = Annotated[float, Quantity(-1e6, 1e6)]
Thresholds: TypeAlias = Annotated[tuple[Threshold, ...], Field(max_length=1000)]
Weights: TypeAlias = Annotated[tuple[Weight, ...], Field(max_length=1000)]
TimeConstants: TypeAlias = Annotated[
    tuple[Annotated[float, Quantity(1e-4, 1e6, "s")], ...], Field(max_length=50)
]
CreepWeights: TypeAlias = Annotated[
    tuple[Annotated[float, Quantity(0, 0.1)], ...], Field(max_length=50)
]
FILE_DELAY_S = Quantity(-0.1, 1, "s")
"""Delays of a model file: negative ones if the samples were reported early."""
_FORM_KEYS = {
    *(f"{side}_stop_{what}" for side in ("right", "left") for what in ("thresholds", "weights")),
    *(f"surface_{what}" for what in ("coefficients", "activation", "prompt_slope")),
}
"""Keys that files of one version only have."""
SURFACE_COEFFICIENTS = 24
"""Number of coefficients of a surface."""


class SourceConfig(ConfigModel):
    """The data that a model was fitted to."""

    file: Text = Field(description="Name of the file.")
    sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")] = Field(
        description="SHA-256 of the file, in hexadecimal."
    )
    read_as: Annotated[str, StringConstraints(min_length=1, max_length=10_000)] | None = Field(
        default=None, description="How its columns were understood; none for a plain CSV file."
    )


class FitConfig(ConfigModel):
    """Errors of the model in predicting drive voltage and position of its data, in % of the ranges.

    Older files have no errors of the position.
    """

    voltage_error_max_pct: PercentOfRange = Field(description="Worst error of the voltage, %.")
    voltage_error_rms_pct: PercentOfRange = Field(description="Rms error of the voltage, %.")
    position_error_max_pct: PercentOfRange | None = Field(
        default=None, description="Worst error of the position, %."
    )
    position_error_rms_pct: PercentOfRange | None = Field(
        default=None, description="Rms error of the position, %."
    )


class PathConfig(ConfigModel):
    """The part of the displacement of a surface that relaxes along the path of the drive."""

    weight: Annotated[float, Quantity(-100, 100)] = Field(
        description="Displacement per change of the state, both as a share of the range."
    )
    decay: Annotated[float, Quantity(0.01, 1000)] = Field(
        description="Relaxation of the state per path of the drive, per range."
    )
    skew: Annotated[float, Quantity(-0.99, 0.99)] = Field(
        description="How much faster it relaxes on its way from zero than to it, as a share."
    )
    exponent: Annotated[float, Quantity(1, 4)] | None = Field(
        default=None, description="If it is above 1, a small state relaxes less; without it 1."
    )


class ModelFile(ConfigModel):
    """A model of a stage over normalised drive and displacement, 0 to 1."""

    format: Literal["piezod-model"] = "piezod-model"
    version: Literal[1, 2, 3] = Field(
        default=1,
        description="1: stop operators; 2: a surface; 3: either, and `held_s`.",
    )
    created_at: Text = Field(description="Time of creation, ISO 8601 with the offset from UTC.")
    created_by: Text = Field(description="Program and version that made it.")
    method: Literal["lms", "least-squares", "surface"] = Field(description="Method of the fit.")
    source: SourceConfig = Field(description="Data of the fit.")
    fit: FitConfig = Field(description="Errors of the fit.")
    drive_low_v: DriveV = Field(description="Drive voltage at 0 of the model, V.")
    drive_high_v: DriveV = Field(description="Drive voltage at 1 of the model, V.")
    position_low_um: PositionUm = Field(description="Position at 0 of the model, µm.")
    position_high_um: PositionUm = Field(description="Position at 1 of the model, µm.")
    delay_s: Annotated[float, FILE_DELAY_S] = Field(
        description="Delay from drive to sensor in the data, whose drive counts as a straight line "
        "from sample to sample, s; negative if samples are told early."
    )
    held_s: Annotated[float, Quantity(0, 10, "s")] | None = Field(
        default=None,
        description="Time for which the drive of the data held each voltage, s; 0 if it changed "
        "evenly. In a loop with another period the delay is another one.",
    )
    creep_time_constants_s: TimeConstants = Field(
        default=(), description="Time constants of the lags of the creep, s."
    )
    creep_weights: CreepWeights = Field(
        default=(), description="Contribution of each lag, as a fraction of the displacement."
    )
    first_mode: FoundModeConfig | None = Field(
        default=None,
        description="First mode that the data show; the loop uses it if the axis has none.",
    )
    right_stop_thresholds: Thresholds = Field(
        default=(), description="Increasing, between 0 and 1; version 1."
    )
    right_stop_weights: Weights = Field(default=(), description="One for each right threshold.")
    left_stop_thresholds: Thresholds = Field(
        default=(), description="Increasing, between 0 and 1; version 1."
    )
    left_stop_weights: Weights = Field(default=(), description="One for each left threshold.")
    surface_coefficients: Weights = Field(
        default=(), description="c_ij of the surface, version 2: 4 for each of 6 widths."
    )
    surface_activation: Annotated[float, Quantity(0, 0.1)] = Field(
        default=0.0,
        description="Growth of the lag per e-fold of the rate, as a share of the drive's range.",
    )
    surface_prompt_slope: Annotated[float, Quantity(0, 10)] = Field(
        default=0.0, description="Slope of the part of the displacement that has no such lag."
    )
    surface_path: PathConfig | None = Field(
        default=None, description="Part that relaxes along the path of the drive, if data show it."
    )

    @property
    def is_surface(self) -> bool:
        """Whether it is a surface, and not made of stop operators."""
        return bool(self.surface_coefficients)

    @property
    def operators(self) -> str:
        """Its operators, for people."""
        if self.is_surface:
            return "a surface"
        count = len(self.right_stop_thresholds)
        return f"{count} operator{'' if count == 1 else 's'} on each side"

    @property
    def span(self) -> Span:
        """The voltages and the travel of the model."""
        travel_um = self.position_high_um - self.position_low_um
        return Span(self.drive_low_v, self.drive_high_v, travel_um)

    def with_weights(self, weights: Sequence[float]) -> Self:
        """Return the model with other weights.

        Args:
            weights: Left stops first, as in the loop; or the coefficients of the surface.
        """
        if self.is_surface:
            return self.model_copy(update={"surface_coefficients": tuple(weights)})
        left = len(self.left_stop_thresholds)
        return self.model_copy(
            update={
                "left_stop_weights": tuple(weights[:left]),
                "right_stop_weights": tuple(weights[left:]),
            }
        )

    def _broken_rules(self) -> Iterator[BrokenRule]:
        yield from _broken_order("drive_high_v", self.drive_high_v, "drive_low_v", self.drive_low_v)
        yield from _broken_order(
            "position_high_um", self.position_high_um, "position_low_um", self.position_low_um
        )
        if len(self.creep_weights) != len(self.creep_time_constants_s):
            what = (
                "needs one entry for each time constant "
                f"(got {len(self.creep_weights)} for {len(self.creep_time_constants_s)})"
            )
            yield ("creep_weights",), what
        total = sum(self.creep_weights)
        if not total < 1.0:
            what = f"sum must be below 1, otherwise creep cannot be removed (got {total:g})"
            yield ("creep_weights",), what
        yield from self._broken_form()
        yield from _broken_side("right", self.right_stop_thresholds, self.right_stop_weights)
        yield from _broken_side("left", self.left_stop_thresholds, self.left_stop_weights)

    def _broken_form(self) -> Iterator[BrokenRule]:
        form, surface = f"a file of version {self.version}", self.version == 2
        if (self.held_s is None) == (self.version == 3):
            what = "held_s, in s: 1 / rate_hz of the loop that drove"
            yield ("held_s",), f"{form} has {what if self.version == 3 else 'no held_s'}"
        if self.version == 3:
            surface = self.is_surface
            form += " with a surface" if surface else " with stops"
        needed, got = SURFACE_COEFFICIENTS if surface else 0, len(self.surface_coefficients)
        # The texts name the key, because a missing one has no place in the file.
        if got != needed:
            yield ("surface_coefficients",), f"{form} has {needed} surface_coefficients (got {got})"
        for key in ("surface_activation", "surface_path"):
            if getattr(self, key) and not surface:
                yield (key,), f"{form} has no {key}"
        for key in ("right_stop_thresholds", "left_stop_thresholds"):
            if bool(getattr(self, key)) == surface:
                yield (key,), f"{form} has {'no' if surface else 'at least one of'} {key}"


def _broken_order(high_key: str, high: float, low_key: str, low: float) -> Iterator[BrokenRule]:
    if not low < high:
        yield (high_key,), f"must be above {low_key}, {low:g} (got {high:g})"


def _broken_side(
    side: str, thresholds: tuple[float, ...], weights: tuple[float, ...]
) -> Iterator[BrokenRule]:
    for index, (before, threshold) in enumerate(pairwise(thresholds), start=1):
        if not before < threshold:
            what = f"must be above the threshold before it (got {threshold:g})"
            yield (f"{side}_stop_thresholds", index), what
    if len(weights) != len(thresholds):
        what = f"needs one entry for each threshold (got {len(weights)} for {len(thresholds)})"
        yield (f"{side}_stop_weights",), what


def load_model(path: Path) -> ModelFile:
    """Read a model file.

    Raises:
        ConfigError: If it is not a valid model file; the text lists every problem with its place.
    """
    document = load_yaml(path)
    # A wrong file would give an error for each of its keys: one message says it better.
    if not document.data.keys() & ModelFile.model_fields.keys():
        what = (
            "not a model file, it has none of the keys of one; `piezod identify` makes model files"
        )
        raise ConfigError(Problem(str(path), 0, 0, "", what))
    return validate(document, ModelFile, Context(path.parent))


def dump_model(model: ModelFile) -> str:
    """Write a model as the text of a model file; `load_model` gives back the same model."""
    document = model.model_dump(exclude_none=True)
    # Without the keys of the other form.
    kept = {key: value for key, value in document.items() if value or key not in _FORM_KEYS}
    return "# Model of a stage for piezod.\n" + _block(kept, "")


def _block(mapping: Mapping[str, Any], indent: str) -> str:
    return "".join(f"{indent}{key}:{_value(value, indent)}" for key, value in mapping.items())


def _value(value: object, indent: str) -> str:
    if isinstance(value, dict):
        return "\n" + _block(value, indent + "  ")
    if isinstance(value, tuple):
        # json writes the shortest text that reads back as the same double.
        lines = textwrap.wrap(f"[{', '.join(map(json.dumps, value))}]", 90, break_on_hyphens=False)
        return "".join(f"\n{indent}  {line}" for line in lines) + "\n"
    if isinstance(value, str):
        # Always quoted, so that no text is read back as a number or a bool.
        return " " + yaml.safe_dump(value, default_style='"', allow_unicode=True, width=10_000)
    return f" {json.dumps(value)}\n"
