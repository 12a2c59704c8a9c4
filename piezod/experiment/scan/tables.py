"""The voltages of a scan, by the inverse model of each axis; learning corrects them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from piezod.devices.scan_table import Mask, ScanTable
from piezod.experiment.play.task import KnownAxis, static_gain
from piezod.experiment.scan.plan import ScanPlan
from piezod.hysteresis.memory import FloatArray

_JOIN = 0.5
"""Share of a lead-in, at its end, in which it goes over to a corrected table."""


class AxisVoltages(NamedTuple):
    """Voltages of one axis, before corrections."""

    lead_in_v: FloatArray  #: (l,) voltages before the first sweep, in V.
    line_v: FloatArray  #: (p · m,) shape of the line, with the mean 0, in V.
    offset_v: FloatArray  #: (sweeps,) offset of each sweep, in V.


def swept_voltages(
    known: KnownAxis, plan: ScanPlan, wanted_um: FloatArray, in_force_v: float
) -> AxisVoltages:
    """Return the voltages of the fast axis.

    Args:
        known: The axis.
        plan: The plan.
        wanted_um: (p · m,) input of the inverse model, in µm.
        in_force_v: Voltage at which the lead-in begins, in V.

    Raises:
        DataError: If the input leaves the range of the model.
    """
    table = known.maker.table(wanted_um, in_force_v, 1)
    mean_v = float(np.mean(table.period_v))
    return AxisVoltages(table.lead_in_v, table.period_v - mean_v, np.full(plan.sweeps, mean_v))


def stepped_voltages(
    known: KnownAxis, plan: ScanPlan, levels_um: FloatArray, in_force_v: float
) -> AxisVoltages:
    """Return the voltages of an axis that goes from level to level, shape (sweeps,), in µm.

    Raises:
        DataError: If a level leaves the range of the model.
    """
    gain = static_gain(known.creep, plan.duration_s / max(plan.sweeps, 1))
    lead_in_v, offset_v = known.maker.levels(levels_um / gain, in_force_v)
    period = plan.points * plan.sweeps_per_period
    return AxisVoltages(lead_in_v, np.zeros(period), offset_v)


class Corrections(NamedTuple):
    """What the record of a frame has added to the voltages."""

    offset_v: FloatArray  #: (sweeps, axes) added to the offset of each sweep, in V.
    scale: FloatArray  #: (sweeps, axes) size of the line in each sweep.

    @classmethod
    def none(cls, plan: ScanPlan) -> "Corrections":
        """Return no correction."""
        shape = plan.sweeps, len(plan.axes)
        return cls(np.zeros(shape), np.ones(shape))


def scan_table(
    plan: ScanPlan, voltages: Sequence[AxisVoltages], corrections: Corrections, pulses: Mask
) -> ScanTable:
    """Return the table of a scan; all lead-ins end together.

    Args:
        plan: The plan.
        voltages: Voltages of each axis, in the order of the plan.
        corrections: Corrections of the frame.
        pulses: (q · points,) its pulses.
    """
    longest = max(axis.lead_in_v.size for axis in voltages)
    lead_in_v = np.stack(
        [
            np.concatenate(
                (np.full(longest - axis.lead_in_v.size, axis.lead_in_v[0]), axis.lead_in_v)
            )
            for axis in voltages
        ],
        axis=1,
    )
    offset_v = np.stack([axis.offset_v for axis in voltages], axis=1) + corrections.offset_v
    joining = round(_JOIN * min(axis.lead_in_v.size for axis in voltages))
    ramp = 0.5 - 0.5 * np.cos(np.pi * np.arange(1, joining + 1) / joining)
    tail, centre = lead_in_v[-joining:], offset_v[0] - corrections.offset_v[0]
    more = corrections.offset_v[0] + (corrections.scale[0] - 1.0) * (tail - centre)
    # A correction may ask for a little more than the range, from which the lead-in comes.
    lowest_v, highest_v = lead_in_v.min(axis=0), lead_in_v.max(axis=0)
    lead_in_v[-joining:] = np.clip(tail + ramp[:, None] * more, lowest_v, highest_v)
    return ScanTable(
        axes=plan.axes,
        interval_ns=plan.interval_ns,
        lead_in_v=lead_in_v,
        line_v=np.stack([axis.line_v for axis in voltages], axis=1),
        offset_v=offset_v,
        scale=corrections.scale,
        blend=plan.blend,
        pulses=pulses,
        framed=plan.framed,
        frame_points=plan.high,
        pause=plan.pause,
    )


def known_delays_s(known: Mapping[str, KnownAxis], plan: ScanPlan) -> FloatArray:
    """Return the delay of each sensor, in the order of the plan, in s."""
    return np.array([known[name].sensor_delay_s for name in plan.axes])
