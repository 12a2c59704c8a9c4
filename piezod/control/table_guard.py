"""The check of a table before it is loaded into a device that plays it by its own clock.

Once a play has started, no guard sees its voltages any more. So the table passes as a whole: every
value, every step, the step from the lead-in to the period, and the wrap of the period.
"""

from collections.abc import Sequence

import numpy as np

from piezod.control.guard import Limits
from piezod.devices.player import Table
from piezod.units import NS_PER_S

_ROUNDING = 1e-9
"""A step may exceed the slew rate by this share: values are rounded in binary."""


def table_refusal(table: Table, limits: Sequence[Limits]) -> str:
    """Return why a table must not be played; empty if it may.

    Args:
        table: The table, in V, with one column for each of the limits.
        limits: Limits of each axis.
    """
    values_v = np.vstack([table.lead_in, table.period, table.period[:1]])
    for column, each in zip(values_v.T, limits, strict=True):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            return f"point {bad[0]} of the table is {column[bad[0]]}, allowed: finite voltages"
        outside = np.flatnonzero((column < each.drive_min_v) | (column > each.drive_max_v))
        if outside.size:
            at = int(outside[np.argmax(np.abs(column[outside]))])
            return (
                f"point {at} of the table is {column[at]:.4g} V, allowed range "
                f"{each.drive_min_v:g} to {each.drive_max_v:g} V"
            )
        step_v = np.abs(np.diff(column))
        allowed_v = each.slew_v_per_s * table.interval_ns / NS_PER_S
        worst = int(np.argmax(step_v))
        if step_v[worst] > allowed_v * (1.0 + _ROUNDING):
            after = "the wrap of the table" if worst == step_v.size - 1 else f"point {worst}"
            return (
                f"after {after} the voltage changes by {step_v[worst]:.4g} V in one interval, "
                f"allowed: at most {allowed_v:.4g} V, the slew rate of the axis; play it slower or "
                "make it smaller"
            )
    return ""
