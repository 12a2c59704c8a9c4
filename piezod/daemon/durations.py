"""How long the loop and `piezod safe` may take to end; imports only the configuration."""

from typing import Final

from piezod.config.daemon import DaemonConfig
from piezod.control.in_force import OUTPUT_WAIT_S

LOOP_ENDS_S: Final = 3.0
"""Time of a loop without its ramp, in s: it begins the ramp 1 s after the last beat of a
supervisor that has ended, and needs the rest to end."""
RAMP_DOWN_PATIENCE_S: Final = 60.0
"""How much longer than its ramps `piezod safe` may take, in s; a slow machine needs some of it to
start."""


def ramp_s(config: DaemonConfig) -> float:
    """Return the duration of the longest ramp to a safe voltage, in s."""
    return max(
        (axis.limits.drive_max_v - axis.limits.drive_min_v) / axis.safety.ramp_v_per_s
        for axis in config.axes.values()
    )


def loop_gone_within_s(config: DaemonConfig) -> float:
    """Return the time after which a loop without its supervisor has ended, in s."""
    return LOOP_ENDS_S + ramp_s(config) + OUTPUT_WAIT_S


def ramped_down_within_s(config: DaemonConfig) -> float:
    """Return the time after which `piezod safe` has failed, in s.

    It may have to wait for the ramp of a loop that still runs, and a slow amplifier delays its own
    steps: a wait is better than an end in the middle of a ramp.
    """
    return RAMP_DOWN_PATIENCE_S + 3 * ramp_s(config) + 2 * OUTPUT_WAIT_S
