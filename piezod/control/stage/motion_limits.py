"""The range of positions that may be commanded, from the configuration and the model of an axis.

`allowed_range_um` decides which positions may be commanded; every adapter gets its range from here.
"""

from piezod.config.daemon import StageAxisConfig
from piezod.control.law.model import StageModel
from piezod.errors import ModelError


def allowed_range_um(config: StageAxisConfig, model: StageModel | None) -> tuple[float, float]:
    """Return the lowest and the highest position that may be commanded, in µm.

    It is the range of the configuration, as far as the identified model and the drive limits reach.
    What is learned does not change it.

    Args:
        config: Configuration of the axis.
        model: Identified model with its zero at rest; None if the axis has none.

    Raises:
        ModelError: If no position of the configured range can be reached, or there is no range.
    """
    asked_um = config.command_range_um
    if model is None:
        if asked_um is None:
            message = "the axis has neither a model nor a command_range_um: set one of them"
            raise ModelError(message)
        return asked_um
    reach_um = model.reach_um(config.limits.drive_min_v, config.limits.drive_max_v)
    if asked_um is None:
        return reach_um
    low_um, high_um = max(asked_um[0], reach_um[0]), min(asked_um[1], reach_um[1])
    if not low_um < high_um:
        raise ModelError(f"no position of {_beyond(asked_um, reach_um)}")
    return low_um, high_um


def range_beyond_reach(config: StageAxisConfig, model: StageModel | None) -> str:
    """Return that the configured range is wider than what can be reached; empty if it is not."""
    asked_um = config.command_range_um
    if model is None or asked_um is None:
        return ""
    reach_um = model.reach_um(config.limits.drive_min_v, config.limits.drive_max_v)
    if reach_um[0] <= asked_um[0] and asked_um[1] <= reach_um[1]:
        return ""
    return f"not every position of {_beyond(asked_um, reach_um)}"


def _beyond(asked_um: tuple[float, float], reach_um: tuple[float, float]) -> str:
    return (
        f"command_range_um, {asked_um[0]:g} to {asked_um[1]:g} µm, can be reached: model and "
        f"limits reach from {reach_um[0]:.4g} to {reach_um[1]:.4g} µm, and commands beyond are "
        "refused; correct command_range_um, or identify the axis over more of its voltages"
    )
