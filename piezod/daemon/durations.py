"""How long it takes until nobody drives a stage any more; imports nothing but the configuration."""

from typing import Final

from piezod.config.daemon import DaemonConfig

LOOP_ENDS_S: Final = 3.0
"""A loop that has lost its supervisor begins to ramp after 1 s; the rest is for its end."""
RAMP_DOWN_PATIENCE_S: Final = 60.0
"""So much longer than its ramps a ramp-down may take; a slow machine needs some of it to start."""


def ramp_s(config: DaemonConfig) -> float:
    """Return how long the longest way to a safe voltage takes, in s."""
    return max(
        (axis.limits.drive_max_v - axis.limits.drive_min_v) / axis.safety.ramp_v_per_s
        for axis in config.axes.values()
    )


def loop_gone_within_s(config: DaemonConfig) -> float:
    """Return within what time a loop has ended that has lost its supervisor, in s."""
    return LOOP_ENDS_S + ramp_s(config)


def ramped_down_within_s(config: DaemonConfig) -> float:
    """Return after what time `piezod safe` has failed, in s.

    It may have to wait for the ramp of a loop that still lives, and a slow amplifier takes the
    steps of its own late: to end it in the middle of a ramp is worse than to wait.
    """
    return RAMP_DOWN_PATIENCE_S + 3 * ramp_s(config)
