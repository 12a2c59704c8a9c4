"""The limits of the axes of a stage, from the configuration in force."""

from typing import NamedTuple

from piezod.config.daemon import StageAxisConfig
from piezod.messages.documents import Document


class AxisLimits(NamedTuple):
    """Limits of an axis.

    Attributes:
        low_um: Lowest position, in µm.
        high_um: Highest position, in µm.
        speed_um_per_s: Largest speed, in µm/s.
    """

    low_um: float
    high_um: float
    speed_um_per_s: float


def limits_in(config: Document) -> dict[str, AxisLimits]:
    """Return the limits of the axes that have a range of commands, by the names of the axes.

    Args:
        config: The configuration in force, as the daemon returns it.
    """
    default_um_per_s = StageAxisConfig.model_fields["speed_um_per_s"].default
    limits = {}
    for name, axis in config["axes"].items():
        if range_um := axis.get("command_range_um"):
            low_um, high_um = range_um
            fastest_um_per_s = axis.get("speed_um_per_s", default_um_per_s)
            limits[name] = AxisLimits(low_um, high_um, fastest_um_per_s)
    return limits
