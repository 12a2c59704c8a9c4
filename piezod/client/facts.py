"""What the configuration in force says about the axes of a stage."""

from math import nan
from typing import NamedTuple, Self

from piezod.config.daemon import OnTargetConfig, StageAxisConfig
from piezod.messages.documents import Document
from piezod.messages.shown import unit_of


class AxisFacts(NamedTuple):
    """Limits of an axis."""

    #: Lowest and highest position, in µm; NaN if the configuration has none.
    range_um: tuple[float, float]
    speed_um_per_s: float  #: Largest speed, in µm/s.
    drive_v: tuple[float, float] = (nan, nan)  #: Lowest and highest drive voltage, in V.
    tolerance_um: float = OnTargetConfig().tolerance_um  #: Tolerance of `on_target`, in µm.
    has_sensor: bool = True  #: Whether the axis has a sensor.
    #: How long a movement over the whole range takes at the largest speed, in s; NaN without a
    #: range.
    longest_move_s: float = nan
    unit: str = "µm"  #: Unit of its positions: µm, or µrad of a user axis.

    @classmethod
    def of(cls, axis: Document, longest_move_s: float) -> Self:
        """Return the facts of an axis.

        Args:
            axis: Its part of the configuration, as the daemon returns it.
            longest_move_s: See the attribute.
        """
        low_um, high_um = axis.get("command_range_um") or (nan, nan)
        default_um_per_s = StageAxisConfig.model_fields["speed_um_per_s"].default
        limits = axis.get("limits", {})  # a user axis has no voltage
        return cls(
            (low_um, high_um),
            axis.get("speed_um_per_s", default_um_per_s),
            (limits.get("drive_min_v", nan), limits.get("drive_max_v", nan)),
            axis.get("on_target", {}).get("tolerance_um", cls._field_defaults["tolerance_um"]),
            axis.get("sensor") is not None or not limits,
            longest_move_s,
            axis.get("unit", "µm"),
        )

    @property
    def has_range(self) -> bool:
        """Whether there is a range of positions."""
        low_um, high_um = self.range_um
        return low_um < high_um

    @property
    def ascii_unit(self) -> str:
        """Unit of its positions for programs that know no µ."""
        return unit_of("position_um", self.unit).ascii

    def why_not(self, position_um: float) -> str:
        """Return why the axis cannot move to a position; empty if it can."""
        low_um, high_um = self.range_um
        if low_um <= position_um <= high_um:
            return ""
        unit = self.ascii_unit
        return f"{position_um:g} {unit}, allowed range {low_um:g} to {high_um:g} {unit}"

    def why_not_speed(self, speed_um_per_s: float) -> str:
        """Return why a speed is not allowed; empty if it is."""
        if 0.0 < speed_um_per_s <= self.speed_um_per_s:
            return ""
        fastest = self.speed_um_per_s
        unit = self.ascii_unit
        return f"speed {speed_um_per_s:g} {unit}/s, allowed: above 0, at most {fastest:g}"


def facts_in(config: Document) -> dict[str, AxisFacts]:
    """Return the facts of all axes, by their names.

    Args:
        config: The configuration in force, as the daemon returns it.
    """
    longest_s = config.get("longest_move_s", {})
    axes = {**config.get("user_axes", {}), **config["axes"]}
    return {name: AxisFacts.of(axis, longest_s.get(name, nan)) for name, axis in axes.items()}
