"""What the configuration in force says about an axis."""

from math import nan
from typing import NamedTuple, Self

from piezod.config.daemon import StageAxisConfig
from piezod.messages.documents import Document


class AxisFacts(NamedTuple):
    """Limits of an axis.

    Attributes:
        range_um: Lowest and highest position, in µm; NaN if the configuration has none.
        drive_v: Lowest and highest drive voltage, in V.
        speed_um_per_s: Speed of movements, in µm/s.
        has_sensor: Whether the axis has a sensor.
    """

    range_um: tuple[float, float]
    drive_v: tuple[float, float]
    speed_um_per_s: float
    has_sensor: bool

    @classmethod
    def of(cls, axis: Document) -> Self:
        """Return the facts of an axis.

        Args:
            axis: Its part of the configuration, as the daemon returns it.
        """
        low_um, high_um = axis.get("command_range_um") or (nan, nan)
        default_um_per_s = StageAxisConfig.model_fields["speed_um_per_s"].default
        return cls(
            (low_um, high_um),
            (axis["limits"]["drive_min_v"], axis["limits"]["drive_max_v"]),
            axis.get("speed_um_per_s", default_um_per_s),
            axis.get("sensor") is not None,
        )
